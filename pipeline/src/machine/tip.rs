//! A motion of the bucket's teeth: `[tip]`.
//!
//! The teeth start at a place and go on by pieces, straight lines and arcs, at one speed. The axes whose reference is
//! of kind `tip` follow it together. How the cylinders move is planned from this table and the mechanism when a
//! controller is made.

use mechanism::AXES;

use super::{
    axis::{Axis, ReferenceSource},
    document::Section,
};

/// Range of places, m, and of pitches and angles, degrees.
const PLACES: std::ops::RangeInclusive<f64> = -100.0..=100.0;
const PITCHES: std::ops::RangeInclusive<f64> = -720.0..=720.0;
/// Pieces that a task may have.
const MOST_PIECES: usize = 100;

/// A motion of the teeth.
#[derive(Debug, Clone, PartialEq)]
pub struct TipTask {
    /// Where the teeth start, `[x, z]` in m.
    pub start: [f64; 2],
    /// Pitch of the bucket at the start, from the x axis to the teeth, degrees.
    pub pitch: f64,
    /// Speed of the teeth along the pieces, m/s. They go slower where an axis or the pump cannot follow.
    pub speed: f64,
    /// Position at which the telescope stays, m; `None` where the plan moves the telescope and spares the boom.
    pub telescope: Option<f64>,
    /// The pieces, one after the other.
    pub pieces: Vec<TipPiece>,
}

/// A piece of the way, from the end of the one before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipPiece {
    /// Its shape.
    pub shape: TipShape,
    /// Pitch at its end, degrees; it changes evenly along the piece. `None` where it stays as it is.
    pub pitch: Option<f64>,
}

/// The shape of a piece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TipShape {
    /// A straight line to this place, `[x, z]` in m.
    Line([f64; 2]),
    /// An arc about a centre.
    Arc {
        /// The centre, `[x, z]` in m.
        center: [f64; 2],
        /// Angle by which the teeth go on, counter-clockwise, degrees.
        angle: f64,
    },
}

impl TipTask {
    /// Reads the table; `None` where it is not given. `has_mechanism` says whether the machine has a `[mechanism]`.
    pub(super) fn read(mut section: Section, has_mechanism: bool) -> Option<Self> {
        if !section.is_given() {
            return None;
        }
        if !has_mechanism {
            section.refuse("", "a table without [mechanism]", "[mechanism] beside it: it says where the teeth are");
        }
        let task = Self {
            start: section.key("start", "Where the teeth start, [x, z]").point(PLACES, "m"),
            pitch: section
                .key("pitch", "Pitch of the bucket at the start, from the x axis to the teeth")
                .number(PITCHES, "degrees"),
            speed: section
                .key("speed", "Speed of the teeth along the way; slower where an axis or the pump cannot follow")
                .number(1e-3..=10.0, "m/s"),
            telescope: section
                .key("telescope", "Position at which the telescope stays")
                .rule("the telescope moves, so that the boom moves as little as possible")
                .optional_number(0.0..=100.0, "m"),
            pieces: section.list("piece").into_iter().map(TipPiece::read).collect(),
        };
        if !(1..=MOST_PIECES).contains(&task.pieces.len()) {
            let found = format!("{} pieces", task.pieces.len());
            section.refuse("piece", found, format!("1 to {MOST_PIECES} tables [[tip.piece]]"));
        }
        section.finish();
        Some(task)
    }

    /// Refuses axes that follow the teeth without a task, and a task that only some of the four axes follow.
    pub(super) fn expect_followers(task: Option<&Self>, section: &Section, axes: &[Axis]) {
        let follows = |axis: &Axis| axis.reference == ReferenceSource::Tip;
        let followers = axes.iter().filter(|axis| follows(axis)).count();
        let is_complete = axes.len() >= AXES && axes[..AXES].iter().all(follows) && followers == AXES;
        let names = || axes.iter().take(AXES).map(|axis| axis.name.as_str()).collect::<Vec<_>>().join(", ");
        if followers > 0 && !(is_complete && task.is_some()) {
            let found = format!("{followers} axes with reference.kind = \"tip\"");
            let allowed = format!("a table [tip] and this kind for all of {}, or for none", names());
            section.refuse("", found, allowed);
        }
    }
}

impl TipPiece {
    fn read(mut section: Section) -> Self {
        let is_arc = section.is_present("center");
        let shape = if is_arc {
            section.forbid("to", "no end of an arc, which follows from center and angle");
            TipShape::Arc {
                center: section.key("center", "Centre of an arc, [x, z]").point(PLACES, "m"),
                angle: section
                    .key("angle", "Angle of an arc, counter-clockwise as seen with the machine facing right")
                    .number(PITCHES, "degrees"),
            }
        } else {
            section.forbid("angle", "no angle of a straight line; an arc has a center as well");
            TipShape::Line(section.key("to", "End of a straight line, [x, z]").point(PLACES, "m"))
        };
        let pitch = section
            .key("pitch", "Pitch of the bucket at the end of the piece")
            .rule("as at the end of the piece before")
            .optional_number(PITCHES, "degrees");
        section.finish();
        Self { shape, pitch }
    }
}
