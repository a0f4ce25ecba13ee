//! Limited memory in the true sense: the last N rows count, each as much as any other, and no row before them.
//!
//! ```text
//! theta(k) = argmin  |R0 (theta - theta0)|^2 + sum of (y(i) - phi(i)' theta)^2, k - N < i <= k
//! ```
//!
//! theta0 is what training found. R0 is weak: R0' R0 is the training's information divided by the number of its
//! rows, one average training row. It keeps the problem solvable while nothing moves, and is the bound of the
//! covariance. Until N rows have come, the training's stand for those that are missing: the window starts full of
//! the rows of its triangle, scaled so that together they weigh as N average training rows, or as all, if there were
//! fewer.
//!
//! Each update takes the new row in, and then takes out the one of N samples ago, both rank-one changes of U D U'.
//!
//! Trap: what is taken out again leaves its rounding behind. Therefore a second triangle collects the rows as they
//! come; after N samples it holds exactly those of the window, and the factors are made from it afresh. That
//! costs one rotation per sample and one inversion of a triangle every N samples, and looks at no row twice.
//!
//! Trap: where one row is nearly all that is known in a direction, the rest is rounding once it leaves. A row that is a
//! thousand times as large as an average training row (by phi' (R0' R0)^-1 phi) is taken in scaled down to that.
//! Should a row in spite of that not be taken out safely, it stays until the factors are made afresh.
//!
//! Limited memory is as old as recursive estimation: Jazwinski: Limited memory optimal filtering, IEEE Transactions on
//! Automatic Control 13, 1968. The two rank-one changes are Bierman's (Factorization Methods for Discrete Sequential
//! Estimation, 1977).

use super::{Adapted, Method};
use crate::{dot, least_squares::Triangle, recursive::RecursiveLeastSquares};

/// Largest phi' (R0' R0)^-1 phi of a row, in its units: 1000 average training rows, squared.
const LARGEST_ROW: f64 = 1e6;
/// Largest phi' P phi of a row that is taken out, of 1: the change of P divides by what is left.
const MOST_OF_A_DIRECTION: f64 = 1.0 - 1e-9;
/// Bound on d_j relative to the training: none, since the window itself bounds it.
const NO_BOUND: f64 = 1e100;

/// The estimator `window:N`.
#[derive(Debug, Clone)]
pub struct Window {
    n: usize,
    factors: RecursiveLeastSquares,
    /// theta0.
    center: Vec<f64>,
    /// R0, n rows of n; the row of a held coefficient has a one on the diagonal and nothing else.
    prior: Vec<f64>,
    prior_factors: RecursiveLeastSquares,
    held: Vec<bool>,
    /// R0 and the rows since the factors were last made afresh, as deviations from theta0.
    recent: Triangle,
    /// N rows of n + 1: phi with zeros for held coefficients, then y - phi' theta0.
    ring: Vec<f64>,
    /// Where the oldest row stands.
    at: usize,
    row: Vec<f64>,
}

impl Window {
    /// For `n` coefficients and the last `rows` rows.
    pub fn new(n: usize, rows: usize) -> Self {
        Self {
            n,
            factors: RecursiveLeastSquares::new(n),
            center: vec![0.0; n],
            prior: vec![0.0; n * n],
            prior_factors: RecursiveLeastSquares::new(n),
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

    /// Makes `recent` the prior alone.
    fn forget_recent(&mut self) {
        self.recent.clear();
        self.prior.chunks_exact(self.n).for_each(|row| self.recent.add(row, 0.0));
    }

    /// Makes the factors from `recent`, which then starts again.
    fn renew(&mut self) {
        self.factors.start_bounded(&self.recent, &self.held, NO_BOUND);
        for ((theta, deviation), center) in self.row.iter_mut().zip(self.factors.theta()).zip(&self.center) {
            *theta = center + deviation;
        }
        self.factors.set_theta(&self.row);
        self.forget_recent();
    }

    /// Fills the window with the rows of R0, each as often as another, that together weigh `weight` times R0' R0.
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
        self.prior_factors.start_bounded(&self.recent, held, NO_BOUND);
        self.fill(count.min(self.rows() as f64));
        self.renew();
    }

    fn set_theta(&mut self, theta: &[f64]) {
        self.center.copy_from_slice(theta);
        self.factors.set_theta(theta);
    }

    fn update(&mut self, phi: &[f64], target: f64) -> Adapted {
        let (n, rows) = (self.n, self.rows());
        let factor = 1.0 - 1.0 / rows as f64;
        let size = self.prior_factors.leverage(phi);
        let weight = if size > LARGEST_ROW { (LARGEST_ROW / size).sqrt() } else { 1.0 };
        let predicted = dot(phi, self.factors.theta());
        let innovation = target - predicted;
        if !(innovation.is_finite() && size.is_finite()) {
            return Adapted { innovation, factor: 1.0, bounded: false };
        }
        self.row.iter_mut().zip(phi).for_each(|(value, phi)| *value = weight * phi);
        self.factors.update(&self.row, weight * target, 1.0);

        let slot = &mut self.ring[self.at * (n + 1)..(self.at + 1) * (n + 1)];
        let (leaving, deviation) = slot.split_at_mut(n);
        let left = self.factors.remove(leaving, deviation[0] + dot(leaving, &self.center), MOST_OF_A_DIRECTION);

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

    fn factors(&self) -> &RecursiveLeastSquares {
        &self.factors
    }
}
