//! Magnitude and rate of a command.
//!
//! ```text
//! |u(k)| <= u_max        |u(k) - u(k-1)| <= r T
//! ```
//!
//! u valve command, u_max `command_limit`, r `command_rate` in 1/s, T period in s. Trap: neutral is always allowed
//! at once; a rate limit on the way to neutral would keep a machine moving that is to stop.

use pipeline::machine::Control;

/// What a command may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Largest magnitude of a command.
    pub magnitude: f64,
    /// Largest change of a command from one tick to the next.
    pub step: f64,
}

impl Limits {
    /// The limits of an axis that is commanded every `period` seconds.
    pub fn new(control: &Control, period: f64) -> Self {
        Self { magnitude: control.command_limit, step: control.command_rate * period }
    }

    /// The allowed command nearest to `wanted` after `last`; neutral for what is not finite.
    pub fn apply(&self, wanted: f64, last: f64) -> f64 {
        if !wanted.is_finite() {
            return 0.0;
        }
        wanted.max(last - self.step).min(last + self.step).max(-self.magnitude).min(self.magnitude)
    }

    /// Lowest and highest command.
    pub fn range(&self) -> (f64, f64) {
        (-self.magnitude, self.magnitude)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn magnitude_and_rate_both_hold_and_nonsense_is_neutral() {
        let limits = Limits { magnitude: 0.5, step: 0.1 };
        assert_eq!(limits.apply(1.0, 0.2), 0.2 + 0.1);
        assert_eq!(limits.apply(-1.0, 0.2), 0.2 - 0.1);
        assert_eq!(limits.apply(1.0, 0.45), 0.5);
        assert_eq!(limits.apply(f64::NAN, 0.4), 0.0);
        assert_eq!(limits.apply(f64::INFINITY, 0.4), 0.0);
    }
}
