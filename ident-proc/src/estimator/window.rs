//! Limited memory in the strict sense: the last N rows count equally, and no row before them counts.
//!
//! ```text
//! theta(k) = argmin  |R0 (theta - theta0)|^2 + sum of (y(i) - phi(i)' theta)^2, k - N < i <= k
//! ```
//!
//! theta0 coefficients after training; phi regressor and y target of a row. R0 is weak: R0' R0 is the information of
//! the training divided by the number of its rows, that of one average training row. It keeps the problem solvable
//! while nothing moves, and it bounds the covariance. Until N rows have come, rows of the training take the place of
//! the missing ones: the window starts full of the rows of its triangle, scaled so that together they weigh as much as
//! N average training rows, or as all training rows if there were fewer.
//!
//! Each update takes the new row in, and then takes the row of N samples ago out. Both are rank-one changes of U D U'.
//!
//! Trap: taking a row out leaves rounding errors. Therefore a second triangle collects the rows as they come. After N
//! samples it holds exactly the rows of the window, and the covariance is computed from it anew. That costs one
//! rotation per sample and one inversion of a triangle every N samples, and no row is processed twice.
//!
//! Trap: where one row holds nearly all information in a direction, only rounding errors are left when it leaves. A row
//! that is a thousand times as large as an average training row (by phi' (R0' R0)^-1 phi) is therefore scaled down to
//! that size. A row that still cannot be taken out safely stays until the covariance is computed anew.
//!
//! Source: Jazwinski: Limited memory optimal filtering, IEEE Transactions on Automatic Control 13, 1968. The rank-one
//! changes: Bierman, Factorization Methods for Discrete Sequential Estimation, 1977.

use super::{Adapted, Method};
use crate::{dot, least_squares::Triangle, recursive::RecursiveLeastSquares};

/// Largest phi' (R0' R0)^-1 phi of a row: the square of 1000 average training rows.
const LARGEST_ROW: f64 = 1e6;
/// Largest phi' P phi of a row that is taken out. The change of P divides by the difference to 1.
const MOST_OF_A_DIRECTION: f64 = 1.0 - 1e-9;
/// Bound on d_j relative to the training: practically none, since the window itself bounds it.
const NO_BOUND: f64 = 1e100;

/// The estimator `window:N`.
#[derive(Debug, Clone)]
pub struct Window {
    n: usize,
    recursion: RecursiveLeastSquares,
    /// theta0.
    center: Vec<f64>,
    /// R0, n rows of n; the row of a held coefficient has a one on the diagonal and nothing else.
    prior: Vec<f64>,
    prior_recursion: RecursiveLeastSquares,
    held: Vec<bool>,
    /// R0 and the rows since the covariance was last computed anew, with targets as deviations from theta0.
    recent: Triangle,
    /// N rows of n + 1: phi with zeros for held coefficients, then y - phi' theta0.
    ring: Vec<f64>,
    /// Index of the oldest row.
    at: usize,
    row: Vec<f64>,
}

impl Window {
    /// For `n` coefficients and the last `rows` rows.
    pub fn new(n: usize, rows: usize) -> Self {
        Self {
            n,
            recursion: RecursiveLeastSquares::new(n),
            center: vec![0.0; n],
            prior: vec![0.0; n * n],
            prior_recursion: RecursiveLeastSquares::new(n),
            held: vec![false; n],
            recent: Triangle::new(n),
            ring: vec![0.0; rows.max(1) * (n + 1)],
            at: 0,
            row: vec![0.0; n],
        }
    }

    /// N.
    fn rows(&self) -> usize {
        self.ring.len() / (self.n + 1)
    }

    /// Reduces `recent` to the prior.
    fn forget_recent(&mut self) {
        self.recent.clear();
        self.prior.chunks_exact(self.n).for_each(|row| self.recent.add(row, 0.0));
    }

    /// Computes coefficients and covariance from `recent`, which then starts anew.
    fn renew(&mut self) {
        self.recursion.start_bounded(&self.recent, &self.held, NO_BOUND);
        for ((theta, deviation), center) in self.row.iter_mut().zip(self.recursion.theta()).zip(&self.center) {
            *theta = center + deviation;
        }
        self.recursion.set_theta(&self.row);
        self.forget_recent();
    }

    /// Fills the window with the rows of R0, each equally often, which together weigh `weight` times R0' R0.
    fn fill(&mut self, weight: f64) {
        let (n, rows) = (self.n, self.rows());
        for (k, slot) in self.ring.chunks_exact_mut(n + 1).enumerate() {
            let i = k % n;
            let times = rows / n + usize::from(i < rows % n);
            let scale = if self.held[i] { 0.0 } else { (weight / times as f64).sqrt() };
            slot[n] = 0.0;
            for (value, prior) in slot.iter_mut().zip(&self.prior[i * n..(i + 1) * n]) {
                *value = scale * prior;
            }
            self.recent.add(&slot[..n], 0.0);
        }
        self.at = 0;
    }
}

impl Method for Window {
    fn start(&mut self, data: &Triangle, held: &[bool], _residual_sigma: f64) {
        let (n, count) = (self.n, data.count().max(1) as f64);
        data.solve(&mut self.center);
        self.held.copy_from_slice(held);
        for (i, row) in self.prior.chunks_exact_mut(n).enumerate() {
            for (j, value) in row.iter_mut().enumerate() {
                *value = match (held[i], held[j]) {
                    (false, false) if j >= i => data.entry(i, j) / count.sqrt(),
                    (true, true) if i == j => 1.0,
                    _ => 0.0,
                };
            }
        }
        self.forget_recent();
        self.prior_recursion.start_bounded(&self.recent, held, NO_BOUND);
        self.fill(count.min(self.rows() as f64));
        self.renew();
    }

    fn set_theta(&mut self, theta: &[f64]) {
        self.center.copy_from_slice(theta);
        self.recursion.set_theta(theta);
    }

    fn update(&mut self, phi: &[f64], target: f64) -> Adapted {
        let (n, rows) = (self.n, self.rows());
        let factor = 1.0 - 1.0 / rows as f64;
        let size = self.prior_recursion.leverage(phi);
        let weight = if size > LARGEST_ROW { (LARGEST_ROW / size).sqrt() } else { 1.0 };
        let predicted = dot(phi, self.recursion.theta());
        let innovation = target - predicted;
        if !(innovation.is_finite() && size.is_finite()) {
            return Adapted { innovation, factor: 1.0, bounded: false };
        }
        self.row.iter_mut().zip(phi).for_each(|(value, phi)| *value = weight * phi);
        self.recursion.update(&self.row, weight * target, 1.0);

        let slot = &mut self.ring[self.at * (n + 1)..(self.at + 1) * (n + 1)];
        let (leaving, deviation) = slot.split_at_mut(n);
        let left = self.recursion.remove(leaving, deviation[0] + dot(leaving, &self.center), MOST_OF_A_DIRECTION);

        deviation[0] = weight * target - dot(&self.row, &self.center);
        for ((slot, value), held) in leaving.iter_mut().zip(&self.row).zip(&self.held) {
            *slot = if *held { 0.0 } else { *value };
        }
        self.recent.add(leaving, deviation[0]);
        self.at += 1;
        if self.at == rows {
            self.at = 0;
            self.renew();
        }
        Adapted { innovation, factor, bounded: !left || weight < 1.0 }
    }

    fn recursion(&self) -> &RecursiveLeastSquares {
        &self.recursion
    }
}
