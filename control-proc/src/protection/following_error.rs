//! Following error: an axis that is not where it should be is stopped.
//!
//! ```text
//! stop     after |e| > e_max + 0.2 s |v_r| for 200 ms
//! ```
//!
//! e error m, v_r speed of the target m/s, e_max `following_error` m. Source: following-error limits of numerical
//! controls, with a floor and a part that grows with the speed. [`crate::model::trust`] takes the model away before, where there
//! is one.
//!
//! Trap: a floor below what the axis needs at its worst, cold and uncommissioned, stops a machine that is all right; so
//! it is the machine file's to say.

/// What the speed adds, s.
const BY_SPEED: f64 = 0.2;
/// How long the error has to be beyond, s.
const TIME: f64 = 0.2;

/// Watches the error of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct FollowingError {
    floor: f64,
    period: f64,
    /// Ticks in a row beyond the bound.
    beyond: u64,
}

impl FollowingError {
    /// With this floor, m, for an axis that is looked at every `period` s.
    pub fn new(floor: f64, period: f64) -> Self {
        Self { floor, period, beyond: 0 }
    }

    /// Forgets: the axis begins to follow.
    pub fn reset(&mut self) {
        self.beyond = 0;
    }

    /// Whether the axis is to stop, `elapsed` ticks after the last look, with an `error` of m from a target of `speed` m/s.
    pub fn update(&mut self, elapsed: u64, error: f64, speed: f64) -> bool {
        // Written so that NaN is beyond.
        let is_within = error.abs() <= self.floor + BY_SPEED * speed.abs();
        self.beyond = if is_within { 0 } else { self.beyond.saturating_add(elapsed) };
        self.beyond as f64 * self.period >= TIME
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tick at which it stops.
    fn stops(error: impl Fn(u64) -> f64, speed: f64) -> Option<u64> {
        let mut following = FollowingError::new(0.03, 0.01);
        (0..200).find(|k| following.update(1, error(*k), speed))
    }

    #[test]
    fn an_error_beyond_the_bound_for_its_time_stops() {
        assert_eq!(stops(|k| if k >= 50 { 0.0301 } else { 0.0 }, 0.0), Some(69));
        assert_eq!(stops(|k| if k >= 50 { -0.0301 } else { 0.0 }, 0.0), Some(69));
        assert_eq!(stops(|_| 0.0701, 0.2), Some(19));
        assert_eq!(stops(|_| f64::NAN, 0.0), Some(19));
        // Ticks that nobody worked count.
        let mut following = FollowingError::new(0.03, 0.01);
        assert!(following.update(20, 0.04, 0.0));
    }

    #[test]
    fn a_smaller_or_shorter_one_does_not() {
        assert_eq!(stops(|_| 0.0299, 0.0), None);
        assert_eq!(stops(|_| 0.0699, -0.2), None);
        assert_eq!(stops(|k| if k % 20 == 0 { 0.0 } else { 1.0 }, 0.0), None);
    }
}
