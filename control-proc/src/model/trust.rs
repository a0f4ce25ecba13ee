//! Trust in the model: after a following error under it, the fallback controls for a while.
//!
//! ```text
//! distrusted for 5 s     after |e| > e_b + 0.2 s |v_r| + e_0 for 200 ms while the model controls
//! e_0(k) = |e(k)| while another controller controls,    e_0(k-1) exp(-n T / 1 s) while the model does
//! ```
//!
//! e following error m; e_b 30 mm or half of `following_error`, whichever is less, so that the model goes before the
//! axis is stopped; v_r speed of the reference m/s; e_0 error m that the model has taken over and is given time to
//! correct; n ticks since the last look; T period s. The rule and its constants are those of
//! [`crate::protection::following_error`]. While the command is at its limit nothing counts: no model could do more.
//!
//! Trap: a model can predict well and be approved, and its loop can still swing. Only the axis shows it.

use crate::protection::following_error::{Deviation, FollowingError};

/// Highest floor of the bound, m.
const HIGHEST_FLOOR: f64 = 0.03;
/// Floor of the bound as share of `following_error`, at which the axis is stopped.
const FLOOR_SHARE: f64 = 0.5;
/// Time in which the error that the model has taken over falls to a third, s.
const CORRECTION_TIME: f64 = 1.0;
/// Time for which a distrusted model does not control, s.
const DISTRUST_TIME: f64 = 5.0;

/// Whether the model of one axis is trusted.
#[derive(Debug, Clone, PartialEq)]
pub struct Trust {
    bound: FollowingError,
    period: f64,
    /// Ticks for which the model is still distrusted.
    distrusted: u64,
    /// e_0, m.
    taken_over: f64,
}

impl Trust {
    /// For an axis that stops at this following error, m, and is looked at every `period` s.
    pub fn new(following_error: f64, period: f64) -> Self {
        let floor = HIGHEST_FLOOR.min(FLOOR_SHARE * following_error);
        Self { bound: FollowingError::new(floor, period), period, distrusted: 0, taken_over: 0.0 }
    }

    /// Trusts the model again: the axis begins to follow.
    pub fn reset(&mut self) {
        self.bound.reset();
        (self.distrusted, self.taken_over) = (0, 0.0);
    }

    /// Whether the model may control at this tick. `by_model`: it made the last command. `at_limit`: the last command
    /// was at its limit.
    pub fn update(&mut self, deviation: &Deviation, by_model: bool, at_limit: bool) -> bool {
        self.taken_over = match by_model {
            true => self.taken_over * (-(deviation.elapsed as f64) * self.period / CORRECTION_TIME).exp(),
            // `max` leaves out what is not a number.
            false => deviation.error.abs().max(0.0),
        };
        self.distrusted = self.distrusted.saturating_sub(deviation.elapsed);
        if !by_model || at_limit {
            self.bound.reset();
        } else if self.bound.update(deviation, self.taken_over) {
            self.bound.reset();
            self.distrusted = (DISTRUST_TIME / self.period).ceil() as u64;
        }
        self.distrusted == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(error: f64, speed: f64) -> Deviation {
        Deviation { elapsed: 1, error, speed }
    }

    /// Number of ticks at which the model may control, at this speed of the reference and with these errors.
    fn trusted(speed: f64, error: impl Fn(usize) -> f64, by_model: bool) -> usize {
        let mut trust = Trust::new(0.06, 0.01);
        (0..1000).filter(|k| trust.update(&at(error(*k), speed), by_model, false)).count()
    }

    #[test]
    fn an_error_taken_over_has_a_second_and_a_command_at_its_limit_is_no_fault() {
        for (at_limit, decays, expected) in [(false, true, 500..501), (false, false, 50..60), (true, false, 500..501)] {
            let mut trust = Trust::new(0.06, 0.01);
            trust.update(&at(0.1, 0.0), false, false);
            let error = |k: usize| if decays { 0.1 * (-0.01 * k as f64).exp() } else { 0.1 };
            let trusted = (0..500).filter(|k| trust.update(&at(error(*k), 0.0), true, at_limit)).count();
            assert!(expected.contains(&trusted), "{at_limit} {decays}: {trusted}");
        }
        let mut trust = Trust::new(0.06, 0.01);
        trust.update(&at(f64::NAN, 0.0), false, false);
        assert!((0..100).filter(|_| trust.update(&at(0.04, 0.0), true, false)).count() < 30);
    }

    #[test]
    fn a_large_error_that_stays_takes_the_model_away_for_five_seconds() {
        assert_eq!(trusted(0.0, |k| if (100..130).contains(&k) { 0.04 } else { 0.0 }, true), 500);
        assert_eq!(trusted(0.0, |k| if k == 100 { f64::NAN } else { 0.0 }, true), 1000);
        assert!(trusted(0.0, |_| f64::NAN, true) < 100);
    }

    #[test]
    fn short_or_small_errors_and_those_at_speed_or_under_the_fallback_do_not() {
        assert_eq!(trusted(0.0, |k| if (100..119).contains(&k) { 0.04 } else { 0.0 }, true), 1000);
        assert_eq!(trusted(0.0, |_| 0.029, true), 1000);
        assert_eq!(trusted(0.2, |_| 0.06, true), 1000);
        assert_eq!(trusted(0.0, |_| 0.5, false), 1000);
    }

    #[test]
    fn missing_samples_count_as_they_do_for_the_axis() {
        let gap = Deviation { elapsed: 20, error: 0.04, speed: 0.0 };
        let mut trust = Trust::new(0.06, 0.01);
        assert!(!trust.update(&gap, true, false));
        // 500 ticks of distrust are over after 25 looks of 20 ticks.
        let fine = Deviation { error: 0.0, ..gap };
        assert_eq!((0..100).take_while(|_| !trust.update(&fine, true, false)).count(), 24);
    }
}
