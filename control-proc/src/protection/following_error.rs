//! The bound on the following error.
//!
//! ```text
//! beyond   after |e| > e_b + 0.2 s |v_r| + e_0 for 200 ms
//! ```
//!
//! e following error m, reference minus position; e_b floor m; v_r speed of the reference m/s; e_0 allowance m. Source:
//! following-error limits of numerical controls, with a floor and a part that grows with the speed.
//!
//! Two users apply this rule. [`super::Protection`] stops the axis; its floor is `following_error` of the machine file
//! and its allowance is 0. [`crate::model::trust`] takes the model away earlier; its floor is lower, and its allowance
//! is the error that the model has taken over.
//!
//! Ticks whose samples are missing count as beyond if the tick after them is: `elapsed` ticks are added at once.
//!
//! Trap: a floor below the error that an axis needs at its worst, cold and without a commissioned model, stops a
//! healthy machine. Therefore the machine file sets it.

/// Addition to the bound for each m/s of the reference's speed, s: a lag of this length is no fault.
const SPEED_ALLOWANCE: f64 = 0.2;
/// Time for which the error has to be beyond its bound, s: a disturbance that is over earlier is no fault.
const DURATION: f64 = 0.2;

/// How far an axis is from its reference at one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// Ticks since the last look, 1 when no sample is missing.
    pub elapsed: u64,
    /// Reference minus position, m.
    pub error: f64,
    /// Speed of the reference, m/s.
    pub speed: f64,
}

/// The bound of one axis, and for how long the error has been beyond it.
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

    /// Begins to count anew.
    pub fn reset(&mut self) {
        self.beyond = 0;
    }

    /// Whether the error has been beyond its bound for too long, with an allowance of `allowance` m at this tick.
    pub fn update(&mut self, deviation: &Deviation, allowance: f64) -> bool {
        let bound = self.floor + SPEED_ALLOWANCE * deviation.speed.abs() + allowance;
        // Written so that NaN is beyond.
        let is_within = deviation.error.abs() <= bound;
        self.beyond = if is_within { 0 } else { self.beyond.saturating_add(deviation.elapsed) };
        self.beyond as f64 * self.period >= DURATION
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tick at which the error has been beyond the bound for too long.
    fn stops(error: impl Fn(u64) -> f64, speed: f64, allowance: f64) -> Option<u64> {
        let mut following = FollowingError::new(0.03, 0.01);
        (0..200).find(|k| following.update(&Deviation { elapsed: 1, error: error(*k), speed }, allowance))
    }

    #[test]
    fn an_error_beyond_the_bound_for_its_time_stops() {
        assert_eq!(stops(|k| if k >= 50 { 0.0301 } else { 0.0 }, 0.0, 0.0), Some(69));
        assert_eq!(stops(|k| if k >= 50 { -0.0301 } else { 0.0 }, 0.0, 0.0), Some(69));
        assert_eq!(stops(|_| 0.0701, 0.2, 0.0), Some(19));
        assert_eq!(stops(|_| f64::NAN, 0.0, 0.0), Some(19));
        assert_eq!(stops(|_| 0.0701, 0.0, 0.04), Some(19));
        // Ticks without a sample count.
        let mut following = FollowingError::new(0.03, 0.01);
        assert!(following.update(&Deviation { elapsed: 20, error: 0.04, speed: 0.0 }, 0.0));
    }

    #[test]
    fn a_smaller_or_shorter_error_does_not_stop() {
        assert_eq!(stops(|_| 0.0299, 0.0, 0.0), None);
        assert_eq!(stops(|_| 0.0699, -0.2, 0.0), None);
        assert_eq!(stops(|_| 0.0699, 0.0, 0.04), None);
        assert_eq!(stops(|k| if k % 20 == 0 { 0.0 } else { 1.0 }, 0.0, 0.0), None);
    }
}
