//! A motion of the bucket's teeth: `[tip]`.
//!
//! The teeth start at a place and go on by pieces, straight lines and arcs, at one speed. The axes whose reference is
//! of kind `tip` follow it together. How the cylinders move is planned from this table and the mechanism when a
//! controller is made. A CSV file may have the way, place by place.

use std::path::{Path, PathBuf};

use mechanism::AXES;

use crate::{
    columns::{Table, TableError, TableProblem},
    nearest::did_you_mean,
};

use super::{
    axis::{Axis, ReferenceSource},
    document::Section,
};

/// Range of pitches and angles, degrees.
const PITCHES: std::ops::RangeInclusive<f64> = -720.0..=720.0;
/// Positions of a cylinder, m.
const POSITIONS: std::ops::RangeInclusive<f64> = 0.0..=100.0;
/// Pieces that a task may have, and those of a file.
const MOST_PIECES: usize = 100;
const MOST_ROWS: usize = 1000;
/// Columns of a file: place of the teeth, m, and pitch of the bucket, degrees.
const PLACE: [&str; 2] = ["x", "z"];
const PITCH: &str = "pitch";
/// How far the way of a file may pass its corners where the machine file does not say it, m.
const ROUNDING: f64 = 0.01;
/// Distance, m, and turn, degrees, below which two rows are the same.
const SAME: f64 = 1e-6;

/// A motion of the teeth.
#[derive(Debug, Clone, PartialEq)]
pub struct TipTask {
    /// Where the teeth start, `[x, z]` in m.
    pub start: [f64; 2],
    /// Pitch of the bucket at the start, from the x axis to the teeth, degrees.
    pub pitch: f64,
    /// Speed of the teeth along the pieces, m/s. They go slower where an axis or the pump cannot follow.
    pub speed: f64,
    /// Where telescope or boom stays; `None` where the plan chooses the boom, and spares it.
    pub free: Option<TipFree>,
    /// How far the way may pass a corner between two straight lines, m, so that the teeth need not stand there. 0: they
    /// go through all corners.
    pub rounding: f64,
    /// The file that has the pieces.
    pub file: Option<PathBuf>,
    /// The pieces, one after the other.
    pub pieces: Vec<TipPiece>,
    /// What a comparison leaves out.
    pub without: TipWithout,
}

/// Measures of a motion of the teeth that a comparison leaves out, to show what each of them is worth. No key of the
/// machine file: every machine has all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TipWithout {
    /// The plan keeps the speed of the task, whatever axes, pump and virtual walls can give.
    pub scaling: bool,
    /// Time goes on along the way at its full pace, however far the teeth lag behind.
    pub waiting: bool,
}

/// A piece of the way, from the end of the one before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipPiece {
    /// Its shape.
    pub shape: TipShape,
    /// Pitch at its end, degrees; it changes evenly along the piece. `None` where it stays as it is.
    pub pitch: Option<f64>,
    /// Where telescope or boom is at its end; `None` where the plan chooses it.
    pub free: Option<TipFree>,
}

/// The axis of the four that place and pitch of the teeth leave free, where a person chose its position, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TipFree {
    /// Of the telescope.
    Telescope(f64),
    /// Of the boom.
    Boom(f64),
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
    /// Where x and z of a place may be, m.
    pub const PLACES: std::ops::RangeInclusive<f64> = -100.0..=100.0;
    /// How fast the teeth may go, m/s.
    pub const SPEEDS: std::ops::RangeInclusive<f64> = 1e-3..=10.0;

    /// Reads the table; `None` where it is not given. `has_mechanism` says whether the machine has a `[mechanism]`.
    /// Files are relative to `folder`.
    pub(super) fn read(mut section: Section, has_mechanism: bool, folder: &Path) -> Option<Self> {
        if !section.is_given() {
            return None;
        }
        if !has_mechanism {
            section.refuse("", "a table without [mechanism]", "[mechanism] beside it: it says where the teeth are");
        }
        let file = section
            .key("file", "CSV file with the way, row by row, in the place of start and pieces: x and z in m, and pitch")
            .optional_text()
            .map(|file| folder.join(file));
        let speed = section
            .key("speed", "Speed of the teeth along the way; slower where an axis or the pump cannot follow")
            .number(Self::SPEEDS, "m/s");
        let free = TipFree::read(
            &mut section,
            ["Position at which the telescope stays", "Position at which the boom stays"],
            "the plan moves boom and telescope, the boom as little as possible",
        );
        let rounding = section
            .key("rounding", "How far the way may pass a corner of two straight lines, so that the teeth go on there")
            .rule("0.01 m with file, else 0: they go through corners, and stand there")
            .number_or(if file.is_some() { ROUNDING } else { 0.0 }, 0.0..=1.0, "m");
        let (start, pitch, pieces) = match &file {
            Some(file) => read_file(&mut section, file),
            None => read_pieces(&mut section),
        };
        if free.is_some()
            && let Some(i) = pieces.iter().position(|piece| piece.free.is_some())
        {
            let found = "a position of its own beside tip.telescope or tip.boom";
            section.refuse(&format!("piece[{i}]"), found, "one for the whole task, or one for each piece");
        }
        section.finish();
        Some(Self { start, pitch, speed, free, rounding, file, pieces, without: TipWithout::default() })
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

/// Start, pitch and pieces.
type Pieces = ([f64; 2], f64, Vec<TipPiece>);

fn pitch_at_start(section: &mut Section) -> f64 {
    section.key("pitch", "Pitch of the bucket at the start, from the x axis to the teeth").number(PITCHES, "degrees")
}

fn read_pieces(section: &mut Section) -> Pieces {
    let start = section.key("start", "Where the teeth start, [x, z]").point(TipTask::PLACES, "m");
    let pitch = pitch_at_start(section);
    let pieces = section.list("piece");
    if !(1..=MOST_PIECES).contains(&pieces.len()) {
        let found = format!("{} pieces", pieces.len());
        section.refuse("piece", found, format!("1 to {MOST_PIECES} tables [[tip.piece]], or a file"));
        return (start, pitch, Vec::new());
    }
    (start, pitch, pieces.into_iter().map(TipPiece::read).collect())
}

/// The way of a file. Its first row is the start; straight lines lead from row to row.
fn read_file(section: &mut Section, file: &Path) -> Pieces {
    // A file from the command line takes the place of the pieces in the machine file.
    let is_overridden = section.is_set("file");
    section.exclude(&["start", "piece"], is_overridden, "not beside file, whose rows are start and pieces");
    let refused = ([0.0; 2], 0.0, Vec::new());
    match read_rows(file) {
        Ok((rows, has_pitch)) => {
            let pitch = if has_pitch {
                section.exclude(&["pitch"], is_overridden, "not beside a file with a column pitch");
                rows.first().and_then(|row| row.1)
            } else {
                Some(pitch_at_start(section))
            };
            let Some(((start, _), pitch)) = rows.first().zip(pitch) else { return refused };
            let piece = |(to, pitch): &Row| TipPiece { shape: TipShape::Line(*to), pitch: *pitch, free: None };
            (*start, pitch, rows[1..].iter().map(piece).collect())
        }
        Err(error) => {
            section.pass_over(&["pitch"]);
            section.refuse_table("file", error);
            refused
        }
    }
}

/// A row of a file: place and pitch.
type Row = ([f64; 2], Option<f64>);

/// Places and pitches of a file, and whether it has pitches.
fn read_rows(file: &Path) -> Result<(Vec<Row>, bool), TableError> {
    let table = Table::read(file)?;
    let has_pitch = table.has(PITCH);
    let names: Vec<&str> = PLACE.into_iter().chain(has_pitch.then_some(PITCH)).collect();
    let columns = table.numbers(&names, "")?;
    let known = [PLACE[0], PLACE[1], PITCH];
    // A separator at the end of the header makes a column without a name.
    if let Some(unknown) = table.names().find(|name| !name.is_empty() && !known.contains(name)) {
        let found = format!("column \"{unknown}\"");
        let allowed = format!("columns {}{}", known.join(", "), did_you_mean(unknown, known));
        return Err(table.error(vec![TableProblem { line: Some(1), field: None, found, allowed }]));
    }
    let [x, z] = [&columns.values[0], &columns.values[1]];
    let pitch = |i: usize| has_pitch.then(|| columns.values[2][i]);
    let rows: Vec<_> = (0..x.len()).map(|i| ([x[i], z[i]], pitch(i))).collect();
    let mut problems = Vec::new();
    for (i, (([x, z], pitch), line)) in rows.iter().zip(&columns.lines).enumerate() {
        let mut refuse = |name: &str, found: String, allowed: &str| {
            let (field, allowed) = (Some((i + 1, name.to_owned())), allowed.to_owned());
            problems.push(TableProblem { line: Some(*line), field, found, allowed });
        };
        let before = i.checked_sub(1).map(|before| rows[before]);
        if !TipTask::PLACES.contains(x) || !TipTask::PLACES.contains(z) {
            refuse("x", format!("[{x}, {z}]"), "-100 to 100 m");
        } else if pitch.is_some_and(|pitch| !PITCHES.contains(&pitch)) {
            refuse(PITCH, format!("{}", pitch.unwrap_or_default()), "-720 to 720 degrees");
        } else if before.is_some_and(|(at, turned)| {
            (at[0] - x).hypot(at[1] - z) < SAME && turned.zip(*pitch).is_none_or(|(one, two)| (one - two).abs() < SAME)
        }) {
            refuse("x", format!("[{x}, {z}]"), "another place, or another pitch, than the row before has");
        }
    }
    if !(2..=MOST_ROWS).contains(&rows.len()) {
        let (found, allowed) = (format!("{} rows", rows.len()), format!("2 to {MOST_ROWS} rows below the header"));
        problems.push(TableProblem { line: None, field: None, found, allowed });
    }
    if problems.is_empty() { Ok((rows, has_pitch)) } else { Err(table.error(problems)) }
}

impl TipPiece {
    fn read(mut section: Section) -> Self {
        let is_arc = section.is_present("center");
        let shape = if is_arc {
            section.forbid("to", "no end of an arc, which follows from center and angle");
            TipShape::Arc {
                center: section.key("center", "Centre of an arc, [x, z]").point(TipTask::PLACES, "m"),
                angle: section
                    .key("angle", "Angle of an arc, counter-clockwise as seen with the machine facing right")
                    .number(PITCHES, "degrees"),
            }
        } else {
            section.forbid("angle", "no angle of a straight line; an arc has a center as well");
            TipShape::Line(section.key("to", "End of a straight line, [x, z]").point(TipTask::PLACES, "m"))
        };
        let pitch = section
            .key("pitch", "Pitch of the bucket at the end of the piece")
            .rule("as at the end of the piece before")
            .optional_number(PITCHES, "degrees");
        let free = TipFree::read(
            &mut section,
            ["Position of the telescope at the end of the piece", "Position of the boom at the end of the piece"],
            "the plan chooses it",
        );
        section.finish();
        Self { shape, pitch, free }
    }
}

impl TipFree {
    /// Reads `telescope` or `boom`, with these meanings.
    fn read(section: &mut Section, [telescope, boom]: [&'static str; 2], without: &'static str) -> Option<Self> {
        let [set_telescope, set_boom] = ["telescope", "boom"].map(|key| section.is_set(key));
        let telescope = section.key("telescope", telescope).rule(without).optional_number(POSITIONS, "m");
        let boom = section.key("boom", boom).rule(without).optional_number(POSITIONS, "m");
        match (telescope, boom) {
            // One from the command line takes the place of the other one in the machine file.
            (Some(_), Some(boom)) if set_telescope == set_boom => {
                section.refuse("boom", format!("{boom} m beside telescope"), "one of boom and telescope");
                None
            }
            (Some(telescope), _) if !set_boom => Some(Self::Telescope(telescope)),
            (_, boom) => boom.map(Self::Boom),
        }
    }
}
