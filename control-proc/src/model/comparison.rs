//! Which of two models has predicted better of late.
//!
//! ```text
//! J(k) = lambda^n J(k-1) + sum of the n new squares e^2        W(k) = lambda^n W(k-1) + n        lambda = exp(-T/3 s)
//! the adaptive model is better     from  J_a/W_a < 0.9^2 J_c/W_c   until   J_a/W_a > J_c/W_c
//! ```
//!
//! e h-step error m, of the adaptive (a) and the classical, held model (c), T period s. A snapshot holds count, mean and
//! m2 of all errors so far; what they gain from one snapshot to the next are the new squares.
//!
//! The held model was identified offline, on a part of the data that was made for it, and is the one that is used until
//! the other has shown that it is better.
//!
//! The trap: errors since the start say little of a model that has learned something wrong ten seconds ago; and one
//! bound in the place of two would change the model to and fro, each time with a step in the command.

use pipeline::statistics::ErrorStatistics;

/// Memory, s.
const MEMORY: f64 = 3.0;
/// Ratio of the root mean squares below which the adaptive model is better, and above which it is not any more.
const BETTER: (f64, f64) = (0.9, 1.0);
/// Errors before anything is said.
const LEAST: f64 = 50.0;

/// The comparison for one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    forgetting: f64,
    adaptive: Window,
    classical: Window,
    is_better: bool,
}

/// J and W of one model.
#[derive(Debug, Clone, PartialEq, Default)]
struct Window {
    squares: f64,
    weight: f64,
    seen: u64,
    sum: f64,
}

impl Comparison {
    /// For snapshots every `period` s.
    pub fn new(period: f64) -> Self {
        Self {
            forgetting: (-period / MEMORY).exp(),
            adaptive: Window::default(),
            classical: Window::default(),
            is_better: false,
        }
    }

    /// Whether the adaptive model predicts better than the classical one.
    pub fn is_better(&self) -> bool {
        self.is_better
    }

    /// Takes in the errors of the next snapshot.
    pub fn update(&mut self, adaptive: &ErrorStatistics, classical: &ErrorStatistics) {
        self.adaptive.update(adaptive, self.forgetting);
        self.classical.update(classical, self.forgetting);
        if self.adaptive.weight < LEAST || self.classical.weight < LEAST {
            self.is_better = false;
            return;
        }
        let bound = if self.is_better { BETTER.1 } else { BETTER.0 };
        // What is not a number is worse than any.
        let (adaptive, classical) = (self.adaptive.mean(), self.classical.mean());
        self.is_better = adaptive.is_finite() && (!classical.is_finite() || adaptive < bound * bound * classical);
    }
}

impl Window {
    fn update(&mut self, errors: &ErrorStatistics, forgetting: f64) {
        let sum = errors.m2 + errors.count as f64 * errors.mean * errors.mean;
        if errors.count < self.seen || !sum.is_finite() {
            // The identifier has begun anew, or its figures are lost.
            *self = Self { seen: errors.count, sum: if sum.is_finite() { sum } else { 0.0 }, ..Self::default() };
            return;
        }
        let new = (errors.count - self.seen) as f64;
        let kept = forgetting.powf(new);
        self.squares = kept * self.squares + (sum - self.sum).max(0.0);
        self.weight = kept * self.weight + new;
        (self.seen, self.sum) = (errors.count, sum);
    }

    fn mean(&self) -> f64 {
        self.squares / self.weight
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks at which the adaptive model counts as better, with errors of this size for both.
    fn better(adaptive: impl Fn(usize) -> f64, classical: impl Fn(usize) -> f64) -> Vec<usize> {
        let (mut recent, mut a, mut c) =
            (Comparison::new(0.01), ErrorStatistics::default(), ErrorStatistics::default());
        (0..4000)
            .filter(|k| {
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                a.push(sign * adaptive(*k));
                c.push(sign * classical(*k));
                recent.update(&a, &c);
                recent.is_better()
            })
            .collect()
    }

    #[test]
    fn a_held_model_that_has_become_worse_is_told_within_seconds_and_again_when_it_is_good_again() {
        let told = better(|_| 1e-3, |k| if (1000..2000).contains(&k) { 2e-3 } else { 0.9e-3 });
        let (first, last) = (told[0], told[told.len() - 1]);
        println!("better from {first} to {last}");
        assert!((1000..1100).contains(&first) && (2000..3000).contains(&last));
        assert_eq!(told.len(), last - first + 1);
    }

    #[test]
    fn equal_models_and_few_errors_say_nothing() {
        assert!(better(|_| 1e-3, |_| 1e-3).is_empty());
        assert!(better(|_| 0.95e-3, |_| 1e-3).is_empty());
        assert!(better(|_| f64::NAN, |_| 1e-3).is_empty());
        assert!((50..60).contains(&better(|_| 1e-4, |_| 1e-3)[0]));
    }

    #[test]
    fn an_identifier_that_begins_anew_is_judged_anew() {
        let mut recent = Comparison::new(0.01);
        let (mut a, mut c) = (ErrorStatistics::default(), ErrorStatistics::default());
        for _ in 0..200 {
            a.push(1e-3);
            c.push(1e-2);
            recent.update(&a, &c);
        }
        assert!(recent.is_better);
        recent.update(&ErrorStatistics::default(), &ErrorStatistics::default());
        assert!(!recent.is_better());
    }
}
