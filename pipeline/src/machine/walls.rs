//! Virtual walls: `[walls]`.
//!
//! Places that no part of boom, arm and bucket may pass. The bodies are known by their pins; each of them stands out
//! beyond its pins by the clearance at most. The bucket is known by its teeth and by corners.

use ::mechanism::Mechanism;

use super::document::Section;

/// Range of places, m.
const PLACES: std::ops::RangeInclusive<f64> = -100.0..=100.0;
/// Corners of the bucket that may be given.
pub const MOST_CORNERS: usize = 8;

/// Walls that boom, arm and bucket do not cross.
#[derive(Debug, Clone, PartialEq)]
pub struct Walls {
    /// Deepest place below ground, m.
    pub depth: Option<f64>,
    /// Highest place above ground, m.
    pub height: Option<f64>,
    /// Farthest place forward of the centre of swing, m.
    pub reach: Option<f64>,
    /// How far boom, arm and the linkage of the bucket stand out beyond their pins, m.
    pub clearance: f64,
    /// Heaviest load of the bucket, kg.
    pub payload: f64,
    /// Corners of the bucket beside its teeth, from the bucket pin, x towards the teeth, m.
    pub corners: Vec<[f64; 2]>,
}

impl Walls {
    /// Reads the table; `None` where it is not given. `mechanism` is that of the machine.
    pub(super) fn read(mut section: Section, mechanism: Option<&Mechanism>) -> Option<Self> {
        if !section.is_given() {
            return None;
        }
        if mechanism.is_none() {
            section.refuse("", "a table without [mechanism]", "[mechanism] beside it: it says where the bodies are");
        }
        let none = "no wall";
        let walls = Self {
            depth: section
                .key("depth", "Deepest place below ground that no part of boom, arm and bucket passes")
                .rule(none)
                .optional_number(PLACES, "m"),
            height: section
                .key("height", "Highest place above ground that no part of boom, arm and bucket passes")
                .rule(none)
                .optional_number(PLACES, "m"),
            reach: section
                .key("reach", "Farthest place forward of the centre of swing that no part passes")
                .rule(none)
                .optional_number(PLACES, "m"),
            clearance: section
                .key("clearance", "How far boom, arm and the linkage of the bucket stand out beyond their pins")
                .number(0.0..=5.0, "m"),
            payload: section
                .key("payload", "Heaviest load that the bucket carries: the machine swings with it when an axis stops")
                .number(0.0..=1e6, "kg"),
            corners: section.list("corner").into_iter().map(read_corner).collect(),
        };
        if walls.depth.or(walls.height).or(walls.reach).is_none() {
            section.refuse("", "no wall", "at least one of depth, height and reach");
        }
        if let Walls { depth: Some(depth), height: Some(height), .. } = walls
            && height <= -depth
        {
            let allowed = format!("above {} m, the lowest place that depth leaves", -depth);
            section.refuse("height", format!("{height} m"), allowed);
        }
        let carried = mechanism.map_or(0.0, |mechanism| mechanism.masses.payload.mass);
        if walls.payload < carried {
            let allowed = format!("mechanism.payload.mass, {carried} kg, or more");
            section.refuse("payload", format!("{} kg", walls.payload), allowed);
        }
        if !(1..=MOST_CORNERS).contains(&walls.corners.len()) {
            let found = format!("{} corners of the bucket", walls.corners.len());
            section.refuse("corner", found, format!("1 to {MOST_CORNERS} tables [[walls.corner]]"));
        }
        section.finish();
        Some(walls)
    }
}

fn read_corner(mut section: Section) -> [f64; 2] {
    let at = section
        .key("at", "Corner of the bucket, from the bucket pin: x towards the teeth, z to the side of the link")
        .point(PLACES, "m");
    section.finish();
    at
}
