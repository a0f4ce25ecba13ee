//! Exponential forgetting with a constant factor, eqs. (18)-(20).
//!
//! ```text
//! weight of a row of k samples ago: lambda^k            memory: 1 / (1 - lambda) samples
//! ```
//!
//! lambda forgetting factor. Traps: a coefficient without excitation is forgotten too, up to the bound of the
//! [covariance](crate::recursive). No one factor suits both a machine that warms up and one that stays as it is.

use super::{Adapted, Method};
use crate::{
    least_squares::Triangle,
    recursive::{Change, RecursiveLeastSquares},
};

/// The estimator `constant:L`.
#[derive(Debug, Clone)]
pub struct Exponential {
    recursion: RecursiveLeastSquares,
    factor: f64,
}

impl Exponential {
    /// For `n` coefficients with the forgetting factor `factor` in (0, 1].
    pub fn new(n: usize, factor: f64) -> Self {
        Self { recursion: RecursiveLeastSquares::new(n), factor }
    }
}

impl Method for Exponential {
    fn start(&mut self, data: &Triangle, held: &[bool], _residual_sigma: f64) {
        self.recursion.start(data, held);
    }

    fn set_theta(&mut self, theta: &[f64]) {
        self.recursion.set_theta(theta);
    }

    fn update(&mut self, phi: &[f64], target: f64) -> Adapted {
        let mut factor = 1.0;
        let update = self.recursion.update_by(phi, target, |_, _| {
            factor = self.factor;
            Change::forget(factor)
        });
        Adapted { innovation: update.innovation, factor, bounded: update.bounded }
    }

    fn recursion(&self) -> &RecursiveLeastSquares {
        &self.recursion
    }
}
