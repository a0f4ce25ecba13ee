//! Directional forgetting: old information leaves only where new comes in.
//!
//! ```text
//! S = P^-1         zeta = phi' P phi
//! S <- S - (1 - mu) / zeta phi phi' + phi phi'                       (in the place of (19))
//! theta <- theta + P phi / (mu + zeta) e                             (18), (20) with the factor mu
//! ```
//!
//! The first term multiplies what is known about the output of this row, 1 / zeta, by the factor mu and leaves all that
//! is known about the rest, given that output; the second takes the row in. Together S changes by a multiple of
//! phi phi' and nothing else, so that v' S v stays for every v at right angles to phi: a coefficient that is not
//! excited forgets nothing, however long that lasts. S stays positive definite since mu > 0. As a covariance it is one
//! update with the variance 1 / eps, eps = 1 - (1 - mu) / zeta, negative where more leaves than comes in.
//!
//! ```text
//! mu = 1 - (1 - lambda) min(1, s)         s = phi' Pm phi / n
//! ```
//!
//! Pm is the inverse of the average training row's information, so that an average training row has s = 1. Trap: with
//! mu = lambda for all rows, as published, the size of a row does not matter to what it forgets, (phi phi') / zeta,
//! but it does to what it brings; rows of nothing but noise then empty the covariance in all directions, one after the
//! other. With s both are in proportion: as long as s <= 1, phi' P phi tends to (1 - lambda) / n of phi' Pm phi, from
//! above and from below, whatever the size of the rows, and rows of zero do nothing. That holds for the directions that
//! come; among rows of very different size the others can still grow, up to the bound of the
//! [covariance](crate::recursive).
//!
//! The price: each sample forgets one direction out of n, so that the memory is n / (1 - lambda) samples in all, and
//! longer in a direction that is excited rarely. Where the columns are nearly equal, as those of a position are, it is
//! slow to follow.
//!
//! Kulhavy: Restricted exponential forgetting in real-time identification, Automatica 23, 1987, forgets after the row
//! instead of before it. Cao and Schwartz: A directional forgetting algorithm based on the decomposition of the
//! information matrix, Automatica 36, 2000, and Lai and Bernstein, SIFt-RLS: Subspace of Information Forgetting
//! Recursive Least Squares, 2024, take S phi phi' S in the place of phi phi'; the latter leave rows below a threshold
//! out. Bittanti, Bolzern, Campi: Convergence and exponential convergence of identification algorithms with
//! directional forgetting factor, Automatica 26, 1990, show what can be said of the first.

use super::{Adapted, Method};
use crate::{
    least_squares::Triangle,
    recursive::{Change, RecursiveLeastSquares},
};

/// Smallest magnitude of eps: there the row leaves the covariance as it is.
const LEAST_CHANGE: f64 = 1e-12;

/// The estimator `directional:L`.
#[derive(Debug, Clone)]
pub struct Directional {
    factors: RecursiveLeastSquares,
    /// As after training.
    training: RecursiveLeastSquares,
    factor: f64,
    /// From phi' P phi of the training to s: its rows by the number of free coefficients.
    size: f64,
}

impl Directional {
    /// For `n` coefficients with the factor `factor` in (0, 1].
    pub fn new(n: usize, factor: f64) -> Self {
        Self { factors: RecursiveLeastSquares::new(n), training: RecursiveLeastSquares::new(n), factor, size: 0.0 }
    }
}

impl Method for Directional {
    fn start(&mut self, data: &Triangle, held: &[bool], _residual_sigma: f64) {
        self.factors.start(data, held);
        self.training.start(data, held);
        let free = held.iter().filter(|held| !**held).count();
        self.size = data.count() as f64 / free.max(1) as f64;
    }

    fn set_theta(&mut self, theta: &[f64]) {
        self.factors.set_theta(theta);
    }

    fn update(&mut self, phi: &[f64], target: f64) -> Adapted {
        let size = self.size * self.training.leverage(phi);
        let mut factor = 1.0;
        let update = self.factors.update_by(phi, target, |_, leverage| {
            // A row of zero, or one of held coefficients alone, tells nothing.
            if leverage <= f64::MIN_POSITIVE {
                return Change::forget(1.0);
            }
            // Not greater than 1, also where the size has overflowed.
            let part = if size < 1.0 { size } else { 1.0 };
            let forgotten = (1.0 - self.factor) * part;
            factor = 1.0 - forgotten;
            let change = 1.0 - forgotten / leverage;
            let change = if change.abs() < LEAST_CHANGE { LEAST_CHANGE } else { change };
            // The gain of the coefficients, 1 / (mu + zeta), is 1 / eps of 1 / (1 / eps + zeta).
            Change { variance: change.recip(), growth: 1.0, step: change.recip() }
        });
        Adapted { innovation: update.innovation, factor, bounded: update.bounded }
    }

    fn factors(&self) -> &RecursiveLeastSquares {
        &self.factors
    }
}
