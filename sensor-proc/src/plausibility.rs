//! Whether a position is to be believed.
//!
//! ```text
//! range:  -tolerance <= y <= stroke + tolerance, or the jump there was none that an axis makes
//! speed:  |y(k) - y_good|                <= n v_max T + margin
//!         |y(k) - y_good - n v_good T|   <=   v_max T + margin        for n <= 3
//! base:   after an implausible position, n > 3: |y(k) - y(k-1)| <= v_max T + margin, for 0.5 s
//! stuck:  the raw value has not changed at all for stuck_after
//! ```
//!
//! y position in m, v_max `max_speed` in m/s, T period in s, y_good the last good position, n ticks since, v_good median
//! of the last three speeds between good positions, m/s, margin 5 counts.
//!
//! A single position far out of the stroke is a wrong one, not an axis out of its stroke; the next one there is.
//!
//! What an encoder has been seen to do wrongly is never reached by waiting: a position that has jumped by more than an
//! axis can move in a tick stays implausible, so whoever controls has stopped long before it is taken as a new base,
//! which it has to be some time or an axis with a new cable could not be put back into service. Where nothing was seen
//! at all the way that is possible grows with the time. The median leaves out a single wrong speed, that of an error
//! too small to be seen as one.
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
/// Ticks over which a position is foretold by a speed: after as many without one the controller has latched.
const BRIDGE: u32 = 3;
/// How long a position that cannot be has to go on as an axis does until it is believed: many times what the controller
/// takes to latch, and less than a person takes to reset it.
pub const NEW_BASE: Duration = Duration::from_millis(500);

/// Checks the positions of one axis, tick by tick.
#[derive(Debug, Clone)]
pub struct Plausibility {
    range: (f64, f64),
    step: f64,
    margin: f64,
    period: f64,
    stuck_after: u32,
    new_base_ticks: u32,
    good: Option<f64>,
    ticks_since_good: u32,
    /// Speeds between the last good positions, m per tick.
    speeds: [f64; 3],
    /// A position since the last good one was not believed.
    suspect: bool,
    /// Ticks in a row that positions have gone on as an axis does.
    steady: u32,
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
            new_base_ticks: samples_of(NEW_BASE, period).max(1) as u32,
            good: None,
            ticks_since_good: 0,
            speeds: [0.0; 3],
            suspect: false,
            steady: 0,
            last: f64::NAN,
            unchanged: 0,
            sample: AxisSample::default(),
        }
    }

    /// Judges the position of this tick, m, `elapsed` ticks after the last; `None` when nothing arrived. `encoder_error`
    /// is the encoder's own word.
    pub fn judge(&mut self, elapsed: u64, position: Option<f64>, encoder_error: bool) -> AxisSample {
        let elapsed = u32::try_from(elapsed.max(1)).unwrap_or(u32::MAX);
        self.ticks_since_good = self.ticks_since_good.saturating_add(elapsed);
        let mut faults = if encoder_error { sample_fault::ENCODER } else { 0 };
        match position {
            None => {
                faults |= sample_fault::STALE;
                self.steady = 0;
            }
            Some(position) => {
                let goes_on = !encoder_error && (position - self.last).abs() <= self.within(f64::from(elapsed));
                self.steady = if goes_on { self.steady.saturating_add(elapsed) } else { 0 };
                self.unchanged = if position == self.last { self.unchanged.saturating_add(elapsed) } else { 0 };
                self.last = position;
                // Written so that NaN is out of range.
                let is_out = !(self.range.0..=self.range.1).contains(&position);
                let is_near = self.is_near(position);
                if is_out && (is_near || goes_on || !position.is_finite()) {
                    faults |= sample_fault::RANGE;
                } else if is_out || !is_near {
                    faults |= sample_fault::SPEED;
                }
                self.suspect |= faults & (sample_fault::RANGE | sample_fault::SPEED) != 0;
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
            self.take(position);
        }
        self.sample
    }

    /// The farthest that an axis moves in so many ticks, noise included, m.
    fn within(&self, ticks: f64) -> f64 {
        self.step * ticks + self.margin
    }

    /// Whether the axis can be at this position after the last good one.
    fn is_near(&self, position: f64) -> bool {
        let Some(good) = self.good else { return true };
        let ticks = f64::from(self.ticks_since_good);
        let way = position - good;
        if self.ticks_since_good <= BRIDGE {
            let [a, b, c] = self.speeds;
            let median = a.max(b).min(a.min(b).max(c));
            way.abs() <= self.within(ticks) && (way - ticks * median).abs() <= self.within(1.0)
        } else if self.suspect {
            self.steady >= self.new_base_ticks
        } else {
            way.abs() <= self.within(ticks)
        }
    }

    /// Takes a position (m) as good.
    fn take(&mut self, position: f64) {
        let way = position - self.good.unwrap_or(position);
        let per_tick = way / f64::from(self.ticks_since_good);
        // A new base says nothing of a speed.
        self.speeds = if self.suspect && self.ticks_since_good > BRIDGE {
            [0.0; 3]
        } else {
            [self.speeds[1], self.speeds[2], per_tick]
        };
        self.sample.velocity = self.speeds[2] / self.period;
        self.sample.position = position;
        self.good = Some(position);
        (self.ticks_since_good, self.suspect) = (0, false);
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
            let sample = check.judge(1, Some(0.5 + 0.004 * f64::from(k)), false);
            assert_eq!(sample.faults, 0);
            assert_eq!(sample.position, 0.5 + 0.004 * f64::from(k));
            assert!(k == 0 || (sample.velocity - 0.4).abs() < 1e-9);
        }
    }

    #[test]
    fn each_fault_holds_the_last_good_position() {
        for (position, error, expected) in [
            (Some(1.340), false, sample_fault::SPEED),
            (Some(-0.006), false, sample_fault::SPEED),
            (Some(f64::NAN), false, sample_fault::RANGE),
            (Some(f64::INFINITY), false, sample_fault::RANGE),
            (Some(0.75), false, sample_fault::SPEED),
            (Some(0.6), true, sample_fault::ENCODER),
            (None, false, sample_fault::STALE),
        ] {
            let mut check = boom();
            check.judge(1, Some(0.6), false);
            let sample = check.judge(1, position, error);
            assert_eq!((sample.faults, sample.position), (expected, 0.6), "{position:?}");
        }
    }

    #[test]
    fn an_axis_that_leaves_its_stroke_is_out_of_range_at_once_and_one_that_jumps_out_with_the_second() {
        for (last, inside, outside) in [(1.333, 1.3389, 1.3391), (0.001, -0.0049, -0.0051)] {
            let mut check = boom();
            check.judge(1, Some(last), false);
            assert_eq!(check.judge(1, Some(inside), false).faults, 0);
            assert_eq!(check.judge(1, Some(outside), false).faults, sample_fault::RANGE);
        }
        let mut check = boom();
        check.judge(1, Some(0.6), false);
        assert_eq!(check.judge(1, Some(2.0), false).faults, sample_fault::SPEED);
        assert_eq!(check.judge(1, Some(2.0), false).faults, sample_fault::RANGE);
        // The first of all there is has nothing to jump from.
        assert_eq!(boom().judge(1, Some(2.0), false).faults, sample_fault::RANGE);
    }

    #[test]
    fn what_is_just_allowed_passes() {
        let mut check = boom();
        assert_eq!(check.judge(1, Some(1.3389), false).faults, 0);
        assert_eq!(check.judge(1, Some(1.3289), false).faults, 0, "10 mm in 10 ms are 1 m/s");
        assert_eq!(check.judge(1, Some(1.3180), false).faults, sample_fault::SPEED);
        // Two ticks after the last good one it is possible, but nothing has moved before.
        assert_eq!(check.judge(1, Some(1.3180), false).faults, sample_fault::SPEED);
        assert_eq!(check.judge(1, Some(1.3184), false).faults, 0, "10.5 mm from there");
    }

    /// An axis that moves at `speed` m/s, and what is said of it, `error` m of tick being added to the true position.
    fn said(speed: f64, ticks: u32, error: impl Fn(u32) -> f64) -> Vec<(f64, AxisSample)> {
        let mut check = boom();
        let counted = |y: f64| (y * 1e4).round() * 1e-4;
        (0..ticks)
            .map(|k| {
                let y = 0.4 + speed * 0.01 * f64::from(k);
                (y, check.judge(1, Some(counted(y + error(k))), false))
            })
            .collect()
    }

    #[test]
    fn one_wrong_position_is_dropped_if_it_is_far_off_and_the_next_is_believed_either_way() {
        for speed in [0.0, 0.25, -0.25] {
            for bit in 0..14 {
                for sign in [-1.0, 1.0] {
                    let error = sign * 1e-4 * f64::from(1 << bit);
                    let said = said(speed, 40, |k| if k == 20 { error } else { 0.0 });
                    for (k, (y, sample)) in said.iter().enumerate() {
                        // One tick's worth at 1 m/s and five counts.
                        let is_dropped = k == 20 && error.abs() > 0.0105;
                        assert!(!is_dropped || sample.faults != 0, "{speed} {error} {k}");
                        assert!(k == 20 || sample.faults & sample_fault::UNUSABLE == 0, "{speed} {error} {k}");
                        assert!(is_dropped || (sample.position - y).abs() < error.abs() + 1e-4);
                    }
                }
            }
        }
    }

    #[test]
    fn a_step_of_twenty_millimetres_is_not_followed_while_anybody_acts_on_it() {
        for speed in [0.0, 0.2, -0.2] {
            for step in [0.02, -0.02] {
                // The axis comes to a stand within some ticks, as one does whose controller has latched.
                let mut check = boom();
                let (mut y, mut v) = (0.6f64, speed);
                for k in 0..40 {
                    if k >= 20 {
                        v *= 0.7;
                    }
                    y += v * 0.01;
                    let seen = y + if k >= 20 { step } else { 0.0 };
                    let sample = check.judge(1, Some((seen * 1e4).round() * 1e-4), false);
                    assert_eq!(sample.faults & sample_fault::SPEED != 0, k >= 20, "{speed} {step} {k}");
                }
                // Half a second of standing there makes it a new base, without a speed.
                let ticks = (0..100).take_while(|_| check.judge(1, Some(y + step), false).faults & 7 != 0).count();
                assert!((25..=35).contains(&ticks), "{ticks}");
                let sample = check.judge(1, Some(y + step), false);
                assert_eq!((sample.position, sample.velocity), (y + step, 0.0));
            }
        }
    }

    #[test]
    fn an_encoder_that_jumps_about_never_makes_a_new_base() {
        let mut check = boom();
        check.judge(1, Some(0.6), false);
        for k in 0..1000 {
            let position = 0.8 + 0.02 * f64::from(k % 2);
            assert_eq!(check.judge(1, Some(position), false).faults, sample_fault::SPEED);
        }
        // Nor does one that says itself that it is wrong, nor one that is silent in between.
        for k in 0..1000 {
            assert_ne!(check.judge(1, Some(0.8), k % 40 == 0).faults & sample_fault::UNUSABLE, 0);
        }
        for k in 0..1000 {
            let position = if k % 40 == 0 { None } else { Some(0.8) };
            assert_ne!(check.judge(1, position, false).faults & sample_fault::UNUSABLE, 0);
        }
    }

    #[test]
    fn where_nothing_was_seen_the_possible_way_grows_with_the_time() {
        let mut check = boom();
        check.judge(1, Some(0.6), false);
        for _ in 0..3 {
            assert_eq!(check.judge(1, None, false).faults, sample_fault::STALE);
        }
        assert_eq!(check.clone().judge(1, Some(0.641), false).faults, sample_fault::SPEED);
        assert_eq!(check.judge(1, Some(0.64), false).faults, 0);
        // The same where the ticks themselves are missing.
        assert_eq!(check.judge(5, Some(0.69), false).faults, 0);
        assert_eq!(check.judge(u64::MAX, Some(0.2), false).faults, 0);
    }

    #[test]
    fn a_value_that_never_changes_is_marked_after_its_time() {
        let mut check = boom();
        for k in 0..40 {
            let sample = check.judge(1, Some(0.5), false);
            assert_eq!(sample.faults & sample_fault::STUCK != 0, k >= 30, "tick {k}");
            assert_eq!((sample.position, sample.unchanged), (0.5, k));
        }
        assert_eq!(check.judge(1, Some(0.5001), false).faults, 0);
    }
}
