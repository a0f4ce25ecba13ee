//! What the simulated sensors of an axis do beyond their resolution: keys of `[axis.NAME.plant]`, all off without them.
//! The acquisition does not know these values.
//!
//! The noise of a position sensor is in the unit of what it measures: m at the cylinder, rad at the joint. The two have
//! keys of their own, and the key of the other kind is refused.

use super::encoder::AngleKind;
use crate::machine::document::Section;

/// Errors of the simulated sensors of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorErrors {
    /// Standard deviation of the encoder's noise, m; rad of a sensor at the joint.
    pub encoder_noise: f64,
    /// Zero error of a sensor at the joint, rad: what it measures too much.
    pub angle_error: f64,
    /// Bandwidth of an inclinometer, Hz; `None` without a lag.
    pub bandwidth: Option<f64>,
    /// Standard deviation of the noise of a chamber pressure, Pa.
    pub pressure_noise: f64,
}

/// The sensors of an axis, as far as their errors depend on them.
#[derive(Clone, Copy)]
pub(super) struct Sensors {
    /// Which angle is measured; `None` with a sensor at the cylinder.
    pub kind: Option<AngleKind>,
    /// Whether the kind comes from the command line in the place of the file's.
    pub is_overridden: bool,
    /// Whether the axis has pressure transducers.
    pub has_pressures: bool,
}

impl SensorErrors {
    pub(super) fn read(section: &mut Section, sensors: Sensors) -> Self {
        const AT_JOINT: &str = "no such key here: the sensor is at the joint and has angle_noise, in rad";
        const AT_CYLINDER: &str = "no such key here: the sensor is at the cylinder and has encoder_noise, in m";
        const WITHOUT_LAG: &str = "no such key here: only an inclinometer has a bandwidth";
        const NO_PRESSURES: &str = "no such key here: without [axis.NAME.pressure] no pressure is measured";
        let mut errors = Self { encoder_noise: 0.0, angle_error: 0.0, bandwidth: None, pressure_noise: 0.0 };
        if sensors.kind.is_none() {
            section.exclude(&["angle_noise", "angle_error"], sensors.is_overridden, AT_CYLINDER);
            let noise = "Standard deviation of the encoder's noise; of a sensor at the cylinder";
            errors.encoder_noise = section.key("encoder_noise", noise).number_or(0.0, 0.0..=0.1, "m");
        } else {
            section.exclude(&["encoder_noise"], sensors.is_overridden, AT_JOINT);
            let noise = "Standard deviation of the noise of a sensor at the joint";
            errors.encoder_noise = section.key("angle_noise", noise).number_or(0.0, 0.0..=0.1, "rad");
            let error = "Zero error of a sensor at the joint: what it measures too much";
            errors.angle_error = section.key("angle_error", error).number_or(0.0, -0.5..=0.5, "rad");
        }
        if sensors.kind == Some(AngleKind::Inclinometer) {
            let meaning = "Bandwidth of an inclinometer, the corner of a first-order lag; without it no lag";
            errors.bandwidth = section.key("angle_bandwidth", meaning).optional_number(0.01..=1000.0, "Hz");
        } else {
            section.exclude(&["angle_bandwidth"], sensors.is_overridden, WITHOUT_LAG);
        }
        if sensors.has_pressures {
            let noise = "Standard deviation of the noise of a chamber pressure";
            errors.pressure_noise = section.key("pressure_noise", noise).number_or(0.0, 0.0..=1e6, "Pa");
        } else {
            section.exclude(&["pressure_noise"], false, NO_PRESSURES);
        }
        errors
    }
}
