//! Plausibility of the chamber pressures of one axis.
//!
//! ```text
//! -p_0 - 0.02 R <= p <= R
//! ```
//!
//! p measured pressure, R range of the transducer, both in Pa above the atmosphere; p_0 pressure of the atmosphere, Pa.
//! A chamber whose oil cavitates is up to p_0 below zero. Below that is room for the noise and the zero error of a
//! transducer (assumed: 2 % of its range); a cable that is cut reads far below that.
//!
//! **Result.** Both pressures, or neither: NaN takes the place of values that are not usable. A machine without
//! transducers has no pressures and no fault. Where the machine file names transducers, values that are missing from a
//! reading are a fault like values out of range.

use std::ops::RangeInclusive;

use pipeline::{
    machine::PressureTransducers,
    message::{AxisSample, EncoderValue, sample_fault},
};

/// Part of the range by which a measured pressure may be below that of an empty chamber.
const ZERO_ERROR: f64 = 0.02;
/// Pressure of the atmosphere, Pa.
const ATMOSPHERE: f64 = 101_325.0;

/// Checks the pressures of one axis.
#[derive(Debug, Clone)]
pub struct PressureCheck {
    /// Plausible pressures, Pa; none without transducers.
    range: Option<RangeInclusive<f64>>,
}

impl PressureCheck {
    /// The check of these transducers.
    pub fn new(transducers: Option<&PressureTransducers>) -> Self {
        Self { range: transducers.map(|transducers| -ATMOSPHERE - ZERO_ERROR * transducers.range..=transducers.range) }
    }

    /// Puts the pressures of a reading into `sample`; there is no `value` when no reading arrived.
    pub fn judge(&self, value: Option<&EncoderValue>, sample: &mut AxisSample) {
        (sample.piston_pressure, sample.rod_pressure, sample.has_pressures) = (f64::NAN, f64::NAN, 0);
        let (Some(range), Some(value)) = (&self.range, value) else { return };
        // NaN is outside every range.
        if value.has_pressures != 0 && range.contains(&value.piston_pressure) && range.contains(&value.rod_pressure) {
            (sample.piston_pressure, sample.rod_pressure) = (value.piston_pressure, value.rod_pressure);
            sample.has_pressures = 1;
        } else {
            sample.faults |= sample_fault::PRESSURE;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(transducers: Option<PressureTransducers>, value: Option<EncoderValue>) -> AxisSample {
        let mut sample = AxisSample::default();
        PressureCheck::new(transducers.as_ref()).judge(value.as_ref(), &mut sample);
        assert_eq!(sample.pressures().is_none(), sample.piston_pressure.is_nan() && sample.rod_pressure.is_nan());
        sample
    }

    fn value(piston_pressure: f64, rod_pressure: f64) -> EncoderValue {
        EncoderValue { piston_pressure, rod_pressure, has_pressures: 1, ..EncoderValue::default() }
    }

    #[test]
    fn pressures_in_range_pass_and_others_are_a_fault_that_leaves_the_position_alone() {
        let transducers = Some(PressureTransducers { resolution: 1e4, range: 40e6 });
        for (piston, rod) in [(0.0, 0.0), (40e6, -0.9e6), (12e6, 3e6)] {
            let sample = judged(transducers, Some(value(piston, rod)));
            assert_eq!((sample.pressures(), sample.faults), (Some((piston, rod)), 0));
        }
        for (piston, rod) in [(40.01e6, 0.0), (0.0, -0.902e6), (f64::NAN, 1e6), (1e6, f64::INFINITY)] {
            let sample = judged(transducers, Some(value(piston, rod)));
            assert_eq!((sample.pressures(), sample.faults), (None, sample_fault::PRESSURE));
            assert!(sample.usable().is_some());
        }
        let absent = judged(transducers, Some(EncoderValue::default()));
        assert_eq!((absent.pressures(), absent.faults), (None, sample_fault::PRESSURE));
        // Without a reading the position is stale already.
        assert_eq!(judged(transducers, None).faults, 0);
    }

    #[test]
    fn a_machine_without_transducers_has_no_pressures_and_no_fault() {
        for value in [None, Some(EncoderValue::default()), Some(value(1e6, 1e6))] {
            let sample = judged(None, value);
            assert_eq!((sample.pressures(), sample.faults), (None, 0));
        }
    }
}
