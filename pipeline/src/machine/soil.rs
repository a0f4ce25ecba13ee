//! The soil in front of the teeth: `[soil]`.

use super::document::Section;

/// Soil into which the teeth of the bucket cut; angles in degrees, everything else in SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Soil {
    /// Height of the ground at x = 0, m.
    pub level: f64,
    /// Angle at which the ground rises in the direction of x, degrees.
    pub slope: f64,
    /// gamma, N/m3.
    pub unit_weight: f64,
    /// c, Pa.
    pub cohesion: f64,
    /// phi, degrees.
    pub friction_angle: f64,
    /// delta, between soil and steel, degrees.
    pub steel_friction_angle: f64,
    /// c_a, adhesion to steel, Pa.
    pub adhesion: f64,
    /// w, width of the cut, m.
    pub width: f64,
    /// rho, angle of the blade to the ground, degrees.
    pub rake_angle: f64,
    /// Height of the soil that the bucket pushes before it, m.
    pub heap: f64,
    /// Pressure against the edge of the teeth, Pa.
    pub penetration_resistance: f64,
    /// Area of the edge of the teeth, m2.
    pub teeth_area: f64,
}

/// Sum of the angles delta, rho and phi that leaves a failure plane in the soil, degrees.
const MOST_ANGLE: f64 = 170.0;

impl Soil {
    /// Reads the table; `None` where it is not given. `has_mechanism` says whether the machine has a `[mechanism]`.
    pub(super) fn read(mut section: Section, has_mechanism: bool) -> Option<Self> {
        if !section.is_given() {
            return None;
        }
        if !has_mechanism {
            section.refuse("", "a table without [mechanism]", "[mechanism] beside it: the soil acts on its teeth");
        }
        let angle = |section: &mut Section, key, meaning, range| section.key(key, meaning).number(range, "degrees");
        let friction_angle = angle(&mut section, "friction_angle", "phi, angle of internal friction", 5.0..=50.0);
        let steel_friction_angle =
            angle(&mut section, "steel_friction_angle", "delta, angle of friction between soil and steel", 0.0..=40.0);
        let rake = "rho, angle of the cutting blade to the ground; the bucket's pitch does not change it";
        let soil = Self {
            level: section.key("level", "Height of the ground at x = 0").number_or(0.0, -20.0..=20.0, "m"),
            slope: section.key("slope", "Angle at which the ground rises forward, away from the machine").number_or(
                0.0,
                -30.0..=30.0,
                "degrees",
            ),
            unit_weight: section.key("unit_weight", "gamma, weight of the soil").number(5e3..=4e4, "N/m3"),
            cohesion: section.key("cohesion", "c, cohesion of the soil").number(0.0..=2e5, "Pa"),
            friction_angle,
            steel_friction_angle,
            adhesion: section.key("adhesion", "c_a, adhesion of the soil to steel").number_or(0.0, 0.0..=1e5, "Pa"),
            width: section.key("width", "w, width of the cut").number(0.05..=10.0, "m"),
            rake_angle: section.key("rake_angle", rake).number_or(45.0, 15.0..=100.0, "degrees"),
            heap: section
                .key("heap", "Height of the soil that the bucket pushes before it once it is as deep in the ground")
                .number_or(0.0, 0.0..=2.0, "m"),
            penetration_resistance: section
                .key("penetration_resistance", "Pressure of the soil against the edge of the teeth")
                .number_or(0.0, 0.0..=1e8, "Pa"),
            teeth_area: section.key("teeth_area", "Area of the edge of the teeth").number_or(0.02, 1e-4..=1.0, "m2"),
        };
        let angles = soil.friction_angle + soil.steel_friction_angle + soil.rake_angle;
        if angles > MOST_ANGLE {
            let allowed = format!("up to {MOST_ANGLE} degrees together with friction_angle and steel_friction_angle");
            section.refuse("rake_angle", soil.rake_angle.to_string(), allowed);
        }
        section.finish();
        Some(soil)
    }
}
