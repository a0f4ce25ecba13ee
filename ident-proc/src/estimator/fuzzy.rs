//! The fuzzy forgetting factor, step 5 of the paper: Table 1 and eq. (21), and the estimators that use it.
//!
//! ```text
//! e = 3 clip(error / error_universe)        de = 3 clip(change / variation_universe)       clip to [-1, 1]
//! w_ij = min(mu_i(de), mu_j(e))             lambda = sum(w_ij p_ij) / sum(w_ij)                     (21)
//! ```
//!
//! error: one-step prediction error in the unit of the output; change: its difference to that of the sample before.
//! p_ij entry of Table 1 in row i (change) and column j (error); mu memberships; lambda forgetting factor.
//!
//! The terms NB .. PB lie at -3 .. 3. The memberships are curves near zero, for a calm factor, and triangles outside,
//! for speed:
//!
//! ```text
//! NS, ZO, PS:       mu = (1 + cos(pi d / curve_width)) / 2   for distances d < curve_width, else 0
//! NB, NM, PM, PB:   mu = 1 - d / triangle_width              for d < triangle_width, else 0
//! ```
//!
//! The paper prints neither the widths nor the units of the universes. With both widths 1 the memberships of
//! neighbouring terms sum to about 1, and the factor at zero error is exactly that of (ZO, ZO), 1. The prediction error
//! is used and not the tracking error: with the latter, forgetting would follow the controller instead of the plant.
//!
//! The estimator `paper` has the universes as printed, in millimetres, and (19) without a bound on P. The estimator
//! `rules` has the universes and rules of `[fuzzy]`, and the bound of [`RecursiveLeastSquares`].
//!
//! Traps: Table 1 is not symmetric when both signs change. A universe that is small against the noise gives the factor
//! 0.75, a memory of four samples.

use pipeline::machine::{Fuzzy, Level};

use super::{Adapted, Method};
use crate::{dot, least_squares::Triangle, recursive::RecursiveLeastSquares};

/// Number of terms of each input.
const TERMS: usize = 7;

/// The fuzzy forgetting factor of one output.
#[derive(Debug, Clone)]
pub struct FuzzyForgetting {
    settings: Fuzzy,
    error_universe: f64,
    variation_universe: f64,
    last_error: f64,
}

impl FuzzyForgetting {
    /// From its settings and the standard deviation of the residuals of offline identification, in the unit of the
    /// output. The error before the first sample counts as zero.
    pub fn new(settings: Fuzzy, residual: f64) -> Self {
        // With a residual of zero (data without noise) every error would be PB.
        let by_residual = (Fuzzy::UNIVERSE_IN_RESIDUALS * residual).max(f64::MIN_POSITIVE);
        let error_universe = settings.error_universe.unwrap_or(by_residual);
        let variation_universe = settings.variation_universe.unwrap_or(0.5 * error_universe);
        Self { settings, error_universe, variation_universe, last_error: 0.0 }
    }

    /// Error and change of error that count as PB, in the unit of the output.
    pub fn universes(&self) -> (f64, f64) {
        (self.error_universe, self.variation_universe)
    }

    /// The forgetting factor after the prediction error of this sample, in the unit of the output.
    pub fn factor(&mut self, error: f64) -> f64 {
        let change = error - self.last_error;
        self.last_error = error;
        self.evaluate(error, change)
    }

    /// Table 1 and (21) for an error and its change, in the unit of the output.
    pub fn evaluate(&self, error: f64, change: f64) -> f64 {
        let columns = self.memberships(error / self.error_universe);
        let rows = self.memberships(change / self.variation_universe);
        let (mut weighted, mut total) = (0.0, 0.0);
        for (row, levels) in rows.iter().zip(&self.settings.rules) {
            for (column, level) in columns.iter().zip(levels) {
                let weight = row.min(*column);
                weighted += weight * level.factor();
                total += weight;
            }
        }
        // The centre of gravity lies between the terms. Rounding must not move it outside, above all not above 1.
        (weighted / total).clamp(Level::VS.factor(), Level::VB.factor())
    }

    /// Memberships of NB .. PB for a value relative to its universe; one that is not a number counts as PB.
    fn memberships(&self, relative: f64) -> [f64; TERMS] {
        let x = 3.0 * if relative.is_nan() { 1.0 } else { relative.clamp(-1.0, 1.0) };
        std::array::from_fn(|term| {
            let center = term as f64 - 3.0;
            let distance = (x - center).abs();
            if center.abs() <= 1.0 {
                let d = distance / self.settings.curve_width;
                if d < 1.0 { 0.5 * (1.0 + (std::f64::consts::PI * d).cos()) } else { 0.0 }
            } else {
                (1.0 - distance / self.settings.triangle_width).max(0.0)
            }
        })
    }
}

/// The estimators `paper` and `rules`: (18)-(20) with the fuzzy forgetting factor.
#[derive(Debug, Clone)]
pub struct Rules {
    recursion: RecursiveLeastSquares,
    fuzzy: FuzzyForgetting,
    /// Whether the covariance is bounded. (19) has no bound.
    bounded: bool,
}

impl Rules {
    /// The estimator `rules`, for `n` coefficients.
    pub fn new(n: usize, settings: &Fuzzy) -> Self {
        let fuzzy = FuzzyForgetting::new(*settings, 0.0);
        Self { recursion: RecursiveLeastSquares::new(n), fuzzy, bounded: true }
    }

    /// The estimator `paper`, for `n` coefficients.
    pub fn paper(n: usize) -> Self {
        Self { bounded: false, ..Self::new(n, &Fuzzy::PAPER) }
    }
}

impl Method for Rules {
    fn start(&mut self, data: &Triangle, held: &[bool], residual_sigma: f64) {
        let bound = if self.bounded { data.count() as f64 } else { f64::INFINITY };
        self.recursion.start_bounded(data, held, bound);
        self.fuzzy = FuzzyForgetting::new(self.fuzzy.settings, residual_sigma);
    }

    fn set_theta(&mut self, theta: &[f64]) {
        self.recursion.set_theta(theta);
    }

    fn update(&mut self, phi: &[f64], target: f64) -> Adapted {
        let innovation = target - dot(phi, self.recursion.theta());
        if !innovation.is_finite() {
            return Adapted { innovation, factor: 1.0, bounded: false };
        }
        let factor = self.fuzzy.factor(innovation);
        let update = self.recursion.update(phi, target, factor);
        Adapted { innovation: update.innovation, factor, bounded: update.bounded }
    }

    fn recursion(&self) -> &RecursiveLeastSquares {
        &self.recursion
    }

    fn universes(&self) -> Option<(f64, f64)> {
        Some(self.fuzzy.universes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const UNIT: Fuzzy = Fuzzy { error_universe: Some(3.0), variation_universe: Some(3.0), ..Fuzzy::PAPER };

    #[test]
    fn at_every_term_it_is_the_table() {
        let table = [
            ["VS", "VS", "MS", "S", "B", "MB", "MB"],
            ["VS", "MS", "S", "B", "MB", "VB", "B"],
            ["MS", "S", "B", "MB", "MB", "VB", "S"],
            ["S", "S", "VB", "VB", "VB", "S", "MS"],
            ["S", "B", "MB", "VB", "B", "S", "MS"],
            ["S", "MB", "MB", "MB", "S", "MS", "VS"],
            ["MB", "MB", "VB", "S", "S", "VS", "VS"],
        ];
        let fuzzy = FuzzyForgetting::new(UNIT, 1.0);
        for (row, levels) in table.iter().enumerate() {
            for (column, level) in levels.iter().enumerate() {
                let expected = match *level {
                    "VS" => 0.75,
                    "MS" => 0.80,
                    "S" => 0.85,
                    "B" => 0.90,
                    "MB" => 0.95,
                    _ => 1.00,
                };
                let found = fuzzy.evaluate(column as f64 - 3.0, row as f64 - 3.0);
                assert!((found - expected).abs() < 1e-12, "row {row} column {column}: {found}");
            }
        }
    }

    #[test]
    fn between_two_terms_it_is_their_center_of_gravity() {
        // e halfway between PM and PB (triangles, 0.5 each), de at NB: MB and MB; at PB: VS and VS; at ZO: S and MS.
        let fuzzy = FuzzyForgetting::new(UNIT, 1.0);
        assert!((fuzzy.evaluate(2.5, 0.0) - 0.825).abs() < 1e-12);
        // e at 0.5: ZO and PS curves cross at one half; de at ZO: both VB.
        assert!((fuzzy.evaluate(0.5, 0.0) - 1.0).abs() < 1e-12);
        // e at ZO, de a third of the way to NS: mu_ZO = (1 + cos(pi/3))/2 = 0.75, mu_NS = 0.25; VB and MB.
        assert!((fuzzy.evaluate(0.0, -1.0 / 3.0) - (0.75 * 1.0 + 0.25 * 0.95)).abs() < 1e-12);
    }

    #[test]
    fn beyond_the_universe_the_outer_terms_hold() {
        let fuzzy = FuzzyForgetting::new(UNIT, 1.0);
        assert_eq!(fuzzy.evaluate(1e9, 1e9), 0.75);
        assert_eq!(fuzzy.evaluate(f64::INFINITY, f64::NAN), 0.75);
        assert_eq!(fuzzy.evaluate(0.0, 0.0), 1.0);
    }

    #[test]
    fn the_change_is_that_of_successive_errors() {
        let mut fuzzy = FuzzyForgetting::new(UNIT, 1.0);
        assert_eq!(fuzzy.factor(1.0), fuzzy.evaluate(1.0, 1.0));
        assert_eq!(fuzzy.factor(-0.5), fuzzy.evaluate(-0.5, -1.5));
    }

    #[test]
    fn without_universes_they_follow_the_offline_residual() {
        let fuzzy = FuzzyForgetting::new(Fuzzy::RESIDUALS, 2e-4);
        assert_eq!(fuzzy.universes(), (8e-3, 4e-3));
        assert!(FuzzyForgetting::new(Fuzzy::RESIDUALS, 0.0).evaluate(0.0, 0.0) == 1.0);
    }

    #[test]
    fn the_universes_of_the_paper_do_not_follow_the_residual() {
        assert_eq!(FuzzyForgetting::new(Fuzzy::PAPER, 1.0).universes(), (4e-3, 2e-3));
        assert_eq!(Rules::paper(5).universes(), Some((4e-3, 2e-3)));
    }

    proptest! {
        #[test]
        fn it_stays_within_the_table(
            e in -10.0f64..10.0,
            de in -10.0f64..10.0,
            curve in 0.6f64..3.0,
            triangle in 0.6f64..3.0,
        ) {
            let settings = Fuzzy { curve_width: curve, triangle_width: triangle, ..UNIT };
            let factor = FuzzyForgetting::new(settings, 1.0).evaluate(e, de);
            prop_assert!((0.75..=1.0).contains(&factor), "{factor}");
        }
    }
}
