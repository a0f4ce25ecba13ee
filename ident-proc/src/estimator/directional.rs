//! Directional forgetting: old information is removed only where new information comes in.
//!
//! ```text
//! S = P^-1         zeta = phi' P phi
//! S <- S - (1 - mu) / zeta phi phi' + phi phi'                       (in the place of (19))
//! theta <- theta + P phi / (mu + zeta) e                             (18), (20) with the factor mu
//! ```
//!
//! P covariance, S information, phi regressor, e innovation, mu forgetting factor of this row. The first term
//! multiplies the information on the output of this row, 1 / zeta, by mu and leaves all other information, given that
//! output, as it is. The second term takes the row in. Together S changes by a multiple of phi phi', so that v' S v
//! stays for every v at right angles to phi: a coefficient that is not excited forgets nothing, however long that
//! lasts. S stays positive definite since mu > 0. As a covariance it is one update with the variance 1 / eps, eps = 1 -
//! (1 - mu) / zeta, which is negative where more information leaves than comes in.
//!
//! ```text
//! mu = 1 - (1 - lambda) min(1, s)         s = phi' Pm phi / n
//! ```
//!
//! lambda setting of the estimator, n number of coefficients; Pm inverse of the information of the average training
//! row, so that an average training row has s = 1.
//!
//! Trap: with mu = lambda for all rows, as published, a row forgets (phi phi') / zeta whatever its size, but brings in
//! information by its size. Rows of nothing but noise then empty the information in all directions, one after the
//! other. With s both are in proportion. As long as s <= 1, phi' P phi tends to (1 - lambda) / n of phi' Pm phi, from
//! above and from below, for rows of any size, and rows of zero change nothing. That holds for directions that are
//! excited. Among rows of very different size the other directions can still grow, up to the bound of the
//! [covariance](crate::recursive).
//!
//! The cost: each sample forgets one direction out of n, so that the memory is n / (1 - lambda) samples in all, and
//! longer in a direction that is excited rarely. Where the columns are nearly equal, as those of a position are, it
//! follows slowly.
//!
//! Sources: Kulhavy: Restricted exponential forgetting in real-time identification, Automatica 23, 1987, forgets after
//! the row instead of before it. Cao and Schwartz: A directional forgetting algorithm based on the decomposition of the
//! information matrix, Automatica 36, 2000, and Lai and Bernstein, SIFt-RLS: Subspace of Information Forgetting
//! Recursive Least Squares, 2024, take S phi phi' S in the place of phi phi'; the latter leave rows below a threshold
//! out. Bittanti, Bolzern, Campi: Convergence and exponential convergence of identification algorithms with directional
//! forgetting factor, Automatica 26, 1990, analyse the first.

use super::{Adapted, Method};
use crate::{
    least_squares::Triangle,
    recursive::{Change, RecursiveLeastSquares},
};

/// Smallest magnitude of eps. With it the row leaves the covariance nearly as it is.
const LEAST_CHANGE: f64 = 1e-12;

/// The estimator `directional:L`.
#[derive(Debug, Clone)]
pub struct Directional {
    recursion: RecursiveLeastSquares,
    /// The covariance after training.
    training: RecursiveLeastSquares,
    factor: f64,
    /// Factor from phi' P phi of the training to s: number of its rows divided by the number of free coefficients.
    size: f64,
}

impl Directional {
    /// For `n` coefficients with the factor `factor` in (0, 1].
    pub fn new(n: usize, factor: f64) -> Self {
        Self { recursion: RecursiveLeastSquares::new(n), training: RecursiveLeastSquares::new(n), factor, size: 0.0 }
    }
}

impl Method for Directional {
    fn start(&mut self, data: &Triangle, held: &[bool], _residual_sigma: f64) {
        self.recursion.start(data, held);
        self.training.start(data, held);
        let free = held.iter().filter(|held| !**held).count();
        self.size = data.count() as f64 / free.max(1) as f64;
    }

    fn set_theta(&mut self, theta: &[f64]) {
        self.recursion.set_theta(theta);
    }

    fn update(&mut self, phi: &[f64], target: f64) -> Adapted {
        let size = self.size * self.training.leverage(phi);
        let mut factor = 1.0;
        let update = self.recursion.update_by(phi, target, |_, leverage| {
            // A row of zero, or one of held coefficients only, brings no information.
            if leverage <= f64::MIN_POSITIVE {
                return Change::forget(1.0);
            }
            // This comparison also gives 1 where the size has overflowed.
            let part = if size < 1.0 { size } else { 1.0 };
            let forgotten = (1.0 - self.factor) * part;
            factor = 1.0 - forgotten;
            let change = 1.0 - forgotten / leverage;
            let change = if change.abs() < LEAST_CHANGE { LEAST_CHANGE } else { change };
            // The update computes 1 / (1 / eps + zeta); times 1 / eps that is the gain 1 / (mu + zeta).
            Change { variance: change.recip(), growth: 1.0, step: change.recip() }
        });
        Adapted { innovation: update.innovation, factor, bounded: update.bounded }
    }

    fn recursion(&self) -> &RecursiveLeastSquares {
        &self.recursion
    }
}
