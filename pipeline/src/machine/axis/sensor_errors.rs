//! What the simulated sensors of an axis do beyond their resolution: keys of `[axis.NAME.plant]`, all off without them.
//! The acquisition does not know these values.

use crate::machine::document::Section;

/// Errors of the simulated sensors of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorErrors {
    /// Standard deviation of the encoder's noise, m.
    pub encoder_noise: f64,
    /// Standard deviation of the noise of a chamber pressure, Pa.
    pub pressure_noise: f64,
}

impl SensorErrors {
    /// `has_pressures` says that the axis has pressure transducers.
    pub(super) fn read(section: &mut Section, has_pressures: bool) -> Self {
        let noise = "Standard deviation of the encoder's noise";
        let encoder_noise = section.key("encoder_noise", noise).number_or(0.0, 0.0..=0.1, "m");
        let pressure_noise = if has_pressures {
            let noise = "Standard deviation of the noise of a chamber pressure";
            section.key("pressure_noise", noise).number_or(0.0, 0.0..=1e6, "Pa")
        } else {
            section.forbid("pressure_noise", "no such key here: without [axis.NAME.pressure] no pressure is measured");
            0.0
        };
        Self { encoder_noise, pressure_noise }
    }
}
