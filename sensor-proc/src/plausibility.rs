//! Whether a position is to be believed.
//!
//! ```text
//! range:  -tolerance <= y <= stroke + tolerance
//! speed:  |y(k) - y_good| <= max_speed * T * (ticks since y_good) + SPEED_MARGIN counts
//! stuck:  the raw value has not changed at all for stuck_after
//! ```
//!
//! An unusable position is replaced by the last good one and marked; nothing downstream has to guess. Trap: an axis
//! at rest does not change its counts either. Stuck is therefore a mark, and a fault only for whoever knows that the
//! axis is commanded to move: control-proc.

use pipeline::{
    machine::{Axis, samples_of},
    message::{AxisSample, sample_fault},
};
use std::time::Duration;

/// Counts by which quantisation and noise can make a still axis seem to move.
const SPEED_MARGIN: f64 = 5.0;

/// Checks the positions of one axis, tick by tick.
#[derive(Debug, Clone)]
pub struct Plausibility {
    range: (f64, f64),
    step: f64,
    margin: f64,
    period: f64,
    stuck_after: u32,
    good: Option<f64>,
    ticks_since_good: u32,
    last: f64,
    unchanged: u32,
    sample: AxisSample,
}

impl Plausibility {
    /// For one axis at a sample period.
    pub fn new(axis: &Axis, period: Duration) -> Self {
        let encoder = &axis.encoder;
        Self {
            range: (-encoder.tolerance, axis.stroke + encoder.tolerance),
            step: axis.max_speed * period.as_secs_f64(),
            margin: SPEED_MARGIN * encoder.resolution,
            period: period.as_secs_f64(),
            stuck_after: samples_of(encoder.stuck_after, period).max(1) as u32,
            good: None,
            ticks_since_good: 0,
            last: f64::NAN,
            unchanged: 0,
            sample: AxisSample::default(),
        }
    }

    /// Judges the position of this tick, m; `None` when nothing arrived. `encoder_error` is the encoder's own word.
    pub fn judge(&mut self, position: Option<f64>, encoder_error: bool) -> AxisSample {
        self.ticks_since_good = self.ticks_since_good.saturating_add(1);
        let mut faults = if encoder_error { sample_fault::ENCODER } else { 0 };
        match position {
            None => faults |= sample_fault::STALE,
            Some(position) => {
                self.unchanged = if position == self.last { self.unchanged.saturating_add(1) } else { 0 };
                self.last = position;
                // Written so that NaN is out of range.
                if !(self.range.0..=self.range.1).contains(&position) {
                    faults |= sample_fault::RANGE;
                } else if let Some(good) = self.good
                    && (position - good).abs() > self.step * f64::from(self.ticks_since_good) + self.margin
                {
                    faults |= sample_fault::SPEED;
                }
            }
        }
        if self.unchanged >= self.stuck_after {
            faults |= sample_fault::STUCK;
        }
        self.sample.faults = faults;
        self.sample.unchanged = self.unchanged;
        if let Some(position) = position
            && faults & sample_fault::UNUSABLE == 0
        {
            let good = self.good.unwrap_or(position);
            self.sample.velocity = (position - good) / (self.period * f64::from(self.ticks_since_good));
            self.sample.position = position;
            self.good = Some(position);
            self.ticks_since_good = 0;
        }
        self.sample
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::machine::Machine;

    const PERIOD: Duration = Duration::from_millis(10);

    /// The boom: stroke 1.334 m, 1 m/s, counts of 0.1 mm, stuck after 300 ms.
    fn boom() -> Plausibility {
        Plausibility::new(&Machine::load(None, &[]).unwrap().axes[0], PERIOD)
    }

    #[test]
    fn a_moving_axis_is_healthy_and_its_velocity_is_known() {
        let mut check = boom();
        for k in 0..100 {
            let sample = check.judge(Some(0.5 + 0.004 * f64::from(k)), false);
            assert_eq!(sample.faults, 0);
            assert_eq!(sample.position, 0.5 + 0.004 * f64::from(k));
            assert!(k == 0 || (sample.velocity - 0.4).abs() < 1e-9);
        }
    }

    #[test]
    fn each_fault_holds_the_last_good_position() {
        let mut check = boom();
        check.judge(Some(0.6), false);
        for (position, error, expected) in [
            (Some(1.340), false, sample_fault::RANGE),
            (Some(-0.006), false, sample_fault::RANGE),
            (Some(f64::NAN), false, sample_fault::RANGE),
            (Some(f64::INFINITY), false, sample_fault::RANGE),
            (Some(0.75), false, sample_fault::SPEED),
            (Some(0.6), true, sample_fault::ENCODER),
            (None, false, sample_fault::STALE),
        ] {
            let sample = check.judge(position, error);
            assert_eq!((sample.faults, sample.position), (expected, 0.6), "{position:?}");
        }
    }

    #[test]
    fn what_is_just_allowed_passes() {
        let mut check = boom();
        assert_eq!(check.judge(Some(1.3389), false).faults, 0);
        assert_eq!(check.judge(Some(1.3289), false).faults, 0, "10 mm in 10 ms are 1 m/s");
        assert_eq!(check.judge(Some(1.3180), false).faults, sample_fault::SPEED);
        // Two ticks after the last good one twice the way is possible.
        assert_eq!(check.judge(Some(1.3090), false).faults, 0);
    }

    #[test]
    fn a_value_that_never_changes_is_marked_after_its_time() {
        let mut check = boom();
        for k in 0..40 {
            let sample = check.judge(Some(0.5), false);
            assert_eq!(sample.faults & sample_fault::STUCK != 0, k >= 30, "tick {k}");
            assert_eq!((sample.position, sample.unchanged), (0.5, k));
        }
        assert_eq!(check.judge(Some(0.5001), false).faults, 0);
    }
}
