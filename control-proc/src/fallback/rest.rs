//! Rest: an axis that has arrived gets a neutral command.
//!
//! ```text
//! moves -> rests     the references have stood still for 0.3 s, and |e| <= e_rest
//! rests -> moves     a reference moves, or |e| > e_wake
//! ```
//!
//! e following error m, e_rest and e_wake m. While the axis rests, the valve is shut and the oil holds the load.
//!
//! Traps: behind a dead band and dry friction a controller with integral action never arrives: it pushes, breaks loose,
//! overshoots and pushes back, without end. And one bound in the place of two would chatter with the noise of the
//! encoder.

/// Least e_rest in counts of the encoder: less cannot be told from noise.
const REST_COUNTS: f64 = 2.0;
/// Least e_rest, m, for encoders with finer counts.
const LEAST_REST: f64 = 0.25e-3;
/// Ratio of e_wake to e_rest.
const WAKE_RATIO: f64 = 2.0;
/// Time for which the references have to stand still, s.
const STILL_TIME: f64 = 0.3;

/// Whether an axis rests.
#[derive(Debug, Clone, PartialEq)]
pub struct Rest {
    /// e_rest, m.
    bound: f64,
    still_ticks: u32,
    /// Ticks for which the references have stood still.
    still: u32,
    /// Last reference, m.
    reference: f64,
    rests: bool,
}

impl Rest {
    /// For an encoder with `resolution` m per count, called every `period` s.
    pub fn new(resolution: f64, period: f64) -> Self {
        Self {
            bound: (REST_COUNTS * resolution).max(LEAST_REST),
            still_ticks: (STILL_TIME / period).ceil() as u32,
            still: 0,
            reference: f64::NAN,
            rests: false,
        }
    }

    /// Does not rest any more: the axis begins to follow.
    pub fn reset(&mut self) {
        (self.still, self.rests) = (0, false);
    }

    /// Whether the axis rests at this tick, with a following error of `error` m and these references (m), the present
    /// one first.
    pub fn update(&mut self, error: f64, references: &[f64]) -> bool {
        let stands = references.iter().all(|reference| *reference == self.reference);
        self.still = if stands { self.still.saturating_add(1) } else { 0 };
        self.reference = references.first().copied().unwrap_or(f64::NAN);
        let bound = if self.rests { WAKE_RATIO * self.bound } else { self.bound };
        self.rests = self.still >= self.still_ticks && error.abs() <= bound;
        self.rests
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks at which an axis with these errors and references rests.
    fn rests(errors: impl Fn(usize) -> f64, references: impl Fn(usize) -> [f64; 2]) -> Vec<usize> {
        let mut rest = Rest::new(1e-4, 0.01);
        (0..200).filter(|k| rest.update(errors(*k), &references(*k))).collect()
    }

    #[test]
    fn rest_begins_when_the_references_have_stood_still_and_the_error_is_small() {
        assert_eq!(rests(|_| 2e-4, |_| [0.5; 2]), (30..200).collect::<Vec<_>>());
        assert_eq!(rests(|k| if k < 100 { 3e-4 } else { 2e-4 }, |_| [0.5; 2]), (100..200).collect::<Vec<_>>());
        assert!(rests(|_| 2e-4, |k| [0.5 + 1e-5 * k as f64; 2]).is_empty());
        assert!(rests(|_| f64::NAN, |_| [0.5; 2]).is_empty());
    }

    #[test]
    fn rest_ends_when_a_coming_reference_moves_or_the_error_has_doubled() {
        let references = |k: usize| [0.5, if k < 100 { 0.5 } else { 0.6 }];
        assert_eq!(rests(|_| 0.0, references), (30..100).collect::<Vec<_>>());
        let errors = |k: usize| if k < 100 { 0.0 } else { 6e-4 };
        assert_eq!(rests(errors, |_| [0.5; 2]), (30..100).collect::<Vec<_>>());
        // Noise between the bounds does not end the rest.
        assert_eq!(rests(|k| if k < 100 { 0.0 } else { 4e-4 }, |_| [0.5; 2]).len(), 170);
    }
}
