//! The pressure transducers at both chambers: `[axis.NAME.pressure]`. A machine without this table has none.

use crate::machine::document::Section;

/// Pressure transducers of one axis: one at the piston side, one at the rod side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PressureTransducers {
    /// Smallest step of the pressure, Pa.
    pub resolution: f64,
    /// Largest pressure that is measured, Pa above the atmosphere.
    pub range: f64,
}

impl PressureTransducers {
    pub(super) fn read(mut section: Section) -> Option<Self> {
        if !section.is_given() {
            return None;
        }
        let transducers = Self {
            resolution: section
                .key("resolution", "Smallest step of a chamber pressure; without this table there are no transducers")
                .number(1.0..=1e6, "Pa"),
            range: section
                .key("range", "Largest pressure that the transducers measure; a higher one is a fault")
                .number_or(60e6, 1e5..=1e9, "Pa"),
        };
        section.finish();
        Some(transducers)
    }
}
