//! How long a model is trusted: until the axis is not where it should be.
//!
//! ```text
//! distrusted for 5 s     after |e| > e_m + 0.2 s |v_r| + e_0 for 200 ms while a model controls
//! ```
//!
//! e error m, e_m 30 mm or half of `following_error`, whichever is less: before the axis is stopped, v_r speed of the target m/s, e_0 what the model has taken over, which it is given a second for (e_0 falls to
//! a third). A command at its limit is no model's fault: nobody could do more. Source: following-error limits of numerical controls, with a floor and a part
//! that grows with the speed. The fallback, which needs no model, takes over meanwhile.
//!
//! The trap: a model can predict well, and be judged good, and still make a loop that swings: only the axis shows it.

/// Floor at the most, m, and what the speed adds, s.
const BOUND: (f64, f64) = (0.03, 0.2);
/// How long a model is given for an error that it has taken over, s.
const TAKEN_OVER: f64 = 1.0;
/// How long the error has to be beyond, and how long the model is not used then, s.
const TIMES: (f64, f64) = (0.2, 5.0);

/// Whether the model of an axis may control.
#[derive(Debug, Clone, PartialEq)]
pub struct Trust {
    floor: f64,
    period: f64,
    /// Ticks in a row beyond the bound, and ticks left without a model.
    beyond: u32,
    left: u32,
    target: Option<f64>,
    /// e_0.
    taken_over: f64,
}

impl Trust {
    /// For an axis that stops at this following error, m, and is looked at every `period` s.
    pub fn new(following_error: f64, period: f64) -> Self {
        Self { floor: BOUND.0.min(0.5 * following_error), period, beyond: 0, left: 0, target: None, taken_over: 0.0 }
    }

    /// Forgets: the axis begins to follow.
    pub fn reset(&mut self) {
        (self.beyond, self.left, self.target, self.taken_over) = (0, 0, None, 0.0);
    }

    /// Whether a model may control at this tick; `target` and `error` in m, `by_model` whether one did at the last,
    /// `at_limit` whether with all that the command can do.
    pub fn update(&mut self, target: f64, error: f64, by_model: bool, at_limit: bool) -> bool {
        let speed = self.target.map_or(0.0, |before| (target - before) / self.period);
        self.target = Some(target);
        self.taken_over = match by_model {
            true => self.taken_over * (-self.period / TAKEN_OVER).exp(),
            // `max` leaves out what is not a number.
            false => error.abs().max(0.0),
        };
        let is_beyond = error.is_nan() || error.abs() > self.floor + BOUND.1 * speed.abs() + self.taken_over;
        self.beyond = if by_model && !at_limit && is_beyond { self.beyond.saturating_add(1) } else { 0 };
        self.left = self.left.saturating_sub(1);
        if f64::from(self.beyond) * self.period >= TIMES.0 {
            self.beyond = 0;
            self.left = (TIMES.1 / self.period).ceil() as u32;
        }
        self.left == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks at which the model may control, with these targets and errors.
    fn trusted(target: impl Fn(usize) -> f64, error: impl Fn(usize) -> f64, by_model: bool) -> usize {
        let mut trust = Trust::new(0.06, 0.01);
        (0..1000).filter(|k| trust.update(target(*k), error(*k), by_model, false)).count()
    }

    #[test]
    fn what_was_taken_over_has_a_second_and_a_command_at_its_limit_is_no_fault() {
        for (at_limit, decays, expected) in [(false, true, 500..501), (false, false, 50..60), (true, false, 500..501)] {
            let mut trust = Trust::new(0.06, 0.01);
            trust.update(0.5, 0.1, false, false);
            let error = |k: usize| if decays { 0.1 * (-0.01 * k as f64).exp() } else { 0.1 };
            let trusted = (0..500).filter(|k| trust.update(0.5, error(*k), true, at_limit)).count();
            assert!(expected.contains(&trusted), "{at_limit} {decays}: {trusted}");
        }
        let mut trust = Trust::new(0.06, 0.01);
        trust.update(0.5, f64::NAN, false, false);
        assert!((0..100).filter(|_| trust.update(0.5, 0.04, true, false)).count() < 30);
    }

    #[test]
    fn a_large_error_that_stays_takes_the_model_away_for_five_seconds() {
        assert_eq!(trusted(|_| 0.5, |k| if (100..130).contains(&k) { 0.04 } else { 0.0 }, true), 500);
        assert_eq!(trusted(|_| 0.5, |k| if k == 100 { f64::NAN } else { 0.0 }, true), 1000);
        assert!(trusted(|_| 0.5, |_| f64::NAN, true) < 100);
    }

    #[test]
    fn short_small_or_fast_ones_and_those_of_the_fallback_do_not() {
        assert_eq!(trusted(|_| 0.5, |k| if (100..119).contains(&k) { 0.04 } else { 0.0 }, true), 1000);
        assert_eq!(trusted(|_| 0.5, |_| 0.029, true), 1000);
        assert_eq!(trusted(|k| 2e-3 * k as f64, |_| 0.06, true), 1000);
        assert_eq!(trusted(|_| 0.5, |_| 0.5, false), 1000);
    }
}
