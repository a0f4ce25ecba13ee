//! Rest: an axis that has arrived is left alone.
//!
//! ```text
//! moves -> rests     the targets have stood still for 0.3 s, and |e| <= e_rest
//! rests -> moves     a target moves, or |e| > e_wake
//! ```
//!
//! e error m, e_rest and e_wake m; while the axis rests its command is neutral, so that the valve is shut and the oil
//! holds the load.
//!
//! Traps: a controller with integral action never arrives behind a dead band and dry friction: it pushes, breaks loose,
//! overshoots, and pushes back, for good. And one bound in the place of two would chatter with the encoder's noise.

/// e_rest, in counts of the encoder and m, whichever is more: what can be told from noise.
const REST: (f64, f64) = (2.0, 0.25e-3);
/// e_wake by e_rest.
const WAKE: f64 = 2.0;
/// How long the targets have to stand still, s.
const STILL: f64 = 0.3;

/// Whether an axis rests.
#[derive(Debug, Clone, PartialEq)]
pub struct Rest {
    rest: f64,
    still_ticks: u32,
    /// Ticks that the targets have stood still, and where.
    still: u32,
    target: f64,
    rests: bool,
}

impl Rest {
    /// For an encoder with `resolution` m per count, looked at every `period` s.
    pub fn new(resolution: f64, period: f64) -> Self {
        Self {
            rest: (REST.0 * resolution).max(REST.1),
            still_ticks: (STILL / period).ceil() as u32,
            still: 0,
            target: f64::NAN,
            rests: false,
        }
    }

    /// Forgets: the axis begins to follow.
    pub fn reset(&mut self) {
        (self.still, self.rests) = (0, false);
    }

    /// Whether the axis rests at this tick, with an `error` of m and these `targets`, the present one first.
    pub fn update(&mut self, error: f64, targets: &[f64]) -> bool {
        let stands = targets.iter().all(|target| *target == self.target);
        self.still = if stands { self.still.saturating_add(1) } else { 0 };
        self.target = targets.first().copied().unwrap_or(f64::NAN);
        let bound = if self.rests { WAKE * self.rest } else { self.rest };
        self.rests = self.still >= self.still_ticks && error.abs() <= bound;
        self.rests
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks at which an axis with these errors and targets rests.
    fn rests(errors: impl Fn(usize) -> f64, targets: impl Fn(usize) -> [f64; 2]) -> Vec<usize> {
        let mut rest = Rest::new(1e-4, 0.01);
        (0..200).filter(|k| rest.update(errors(*k), &targets(*k))).collect()
    }

    #[test]
    fn it_begins_when_the_targets_have_stood_still_and_the_error_is_small() {
        assert_eq!(rests(|_| 2e-4, |_| [0.5; 2]), (30..200).collect::<Vec<_>>());
        assert_eq!(rests(|k| if k < 100 { 3e-4 } else { 2e-4 }, |_| [0.5; 2]), (100..200).collect::<Vec<_>>());
        assert!(rests(|_| 2e-4, |k| [0.5 + 1e-5 * k as f64; 2]).is_empty());
        assert!(rests(|_| f64::NAN, |_| [0.5; 2]).is_empty());
    }

    #[test]
    fn it_ends_when_a_coming_target_moves_or_the_error_has_doubled() {
        let targets = |k: usize| [0.5, if k < 100 { 0.5 } else { 0.6 }];
        assert_eq!(rests(|_| 0.0, targets), (30..100).collect::<Vec<_>>());
        let errors = |k: usize| if k < 100 { 0.0 } else { 6e-4 };
        assert_eq!(rests(errors, |_| [0.5; 2]), (30..100).collect::<Vec<_>>());
        // Noise between the bounds wakes nobody.
        assert_eq!(rests(|k| if k < 100 { 0.0 } else { 4e-4 }, |_| [0.5; 2]).len(), 170);
    }
}
