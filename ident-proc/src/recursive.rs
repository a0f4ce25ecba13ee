//! Recursive least squares with a forgetting factor, on a factorised covariance.
//!
//! ```text
//! theta(k) = theta(k-1) + K(k) [y(k) - phi(k)' theta(k-1)]                                         (18)
//! P(k)     = 1/lambda [I - K(k) phi(k)'] P(k-1)                                                    (19)
//! K(k)     = P(k-1) phi(k) / (lambda + phi(k)' P(k-1) phi(k))                                      (20)
//! ```
//!
//! P is kept as U D U', U unit upper triangular and D diagonal (Bierman, Factorization Methods for Discrete
//! Sequential Estimation, 1977; with forgetting as in Ljung and Soderstrom, Theory and Practice of Recursive
//! Identification, 1983). P cannot lose its symmetry or become indefinite that way; computed as printed, (19) does
//! after a few thousand samples.
//!
//! Trap, covariance wind-up: while a direction is not excited, (19) divides it by lambda at every sample, and the
//! first sample that does excite it throws the coefficients away. Every d_j is therefore bounded by its
//! value after training times the number of training samples: then the covariance says no less than one average
//! training sample would. Cutting d_j keeps P positive definite.

use std::array::from_fn;

use crate::triangle::Triangle;

/// All loops of an update run over blocks of this many numbers, which the compiler turns into vector instructions.
const LANES: usize = 4;

/// Coefficients of neighbouring columns or rows; what lies beyond the last is zero and stays zero.
type Block = [f64; LANES];

/// Coefficients and covariance of one recursive estimator.
#[derive(Debug, Clone)]
pub struct RecursiveLeastSquares {
    n: usize,
    theta: Vec<Block>,
    /// U in tiles of LANES columns, tile (s, t) at t (t + 1) / 2 + s, s <= t. The ones on the diagonal and the zeros
    /// below are stored too: they map to themselves in an update, so that the tiles on the diagonal are no case of
    /// their own and every loop has a fixed length.
    tiles: Vec<[Block; LANES]>,
    d: Vec<Block>,
    d_limit: Vec<Block>,
    phi: Vec<Block>,
    f: Vec<Block>,
    v: Vec<Block>,
    mu: Vec<Block>,
    gain: Vec<Block>,
}

/// What one update did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Update {
    /// y - phi' theta(k-1).
    pub innovation: f64,
    /// Whether the covariance was cut at its bound.
    pub bounded: bool,
}

impl RecursiveLeastSquares {
    /// Room for `n` coefficients; nothing is known yet and nothing is learned.
    pub fn new(n: usize) -> Self {
        let blocks = vec![[0.0; LANES]; n.div_ceil(LANES)];
        let mut estimator = Self {
            n,
            theta: blocks.clone(),
            tiles: vec![[[0.0; LANES]; LANES]; blocks.len() * (blocks.len() + 1) / 2],
            d: blocks.clone(),
            d_limit: blocks.clone(),
            phi: blocks.clone(),
            f: blocks.clone(),
            v: blocks.clone(),
            mu: blocks.clone(),
            gain: blocks,
        };
        (0..n).for_each(|j| *estimator.u_mut(j, j) = 1.0);
        estimator
    }

    /// Starts from what offline data say: theta = R^-1 z, P = (R'R)^-1, d_limit = d times the rows of the triangle.
    ///
    /// A coefficient that is `held` stays where it is for good: it has no covariance.
    pub fn start(&mut self, data: &Triangle, held: &[bool]) {
        data.solve(&mut self.theta.as_flattened_mut()[..self.n]);
        // R^-1 = U diag(1 / r_jj): column j of U solves R u = r_jj e_j, from the bottom up.
        for j in 0..self.n {
            let diagonal = data.entry(j, j);
            for i in (0..j).rev() {
                let sum: f64 = (i + 1..=j).map(|m| data.entry(i, m) * self.u_at(m, j)).sum();
                let value = if held[i] || held[j] { 0.0 } else { -sum / data.entry(i, i) };
                *self.u_mut(i, j) = value;
            }
            let d = if held[j] { 0.0 } else { 1.0 / (diagonal * diagonal) };
            self.d.as_flattened_mut()[j] = d;
            self.d_limit.as_flattened_mut()[j] = d * data.count() as f64;
        }
    }

    /// Puts other coefficients in the place of the solution of the data; the covariance stays.
    pub fn set_theta(&mut self, theta: &[f64]) {
        self.theta.as_flattened_mut()[..self.n].copy_from_slice(theta);
    }

    /// u_ij, i <= j.
    fn u_at(&self, i: usize, j: usize) -> f64 {
        self.tiles[tile(i, j)][j % LANES][i % LANES]
    }

    fn u_mut(&mut self, i: usize, j: usize) -> &mut f64 {
        &mut self.tiles[tile(i, j)][j % LANES][i % LANES]
    }

    fn d(&self) -> &[f64] {
        &self.d.as_flattened()[..self.n]
    }

    /// The coefficients.
    pub fn theta(&self) -> &[f64] {
        &self.theta.as_flattened()[..self.n]
    }

    /// One update with the forgetting factor `lambda` in (0, 1]; allocates nothing.
    ///
    /// With a regressor or output that is not finite nothing is learned; the innovation shows it.
    pub fn update(&mut self, phi: &[f64], y: f64, lambda: f64) -> Update {
        // The same code three times: where the compiler knows the number of blocks, it unrolls all loops. With the
        // built-in machine's structure the linear form has two blocks, the full form four.
        let phi = &phi[..self.n];
        match self.theta.len() {
            2 => self.update_blocks(2, phi, y, lambda),
            4 => self.update_blocks(4, phi, y, lambda),
            m => self.update_blocks(m, phi, y, lambda),
        }
    }

    #[inline(always)]
    fn update_blocks(&mut self, m: usize, phi: &[f64], y: f64, lambda: f64) -> Update {
        let (tiles, theta, copy) = (&mut self.tiles[..m * (m + 1) / 2], &mut self.theta[..m], &mut self.phi[..m]);
        let (f, v, mu, gain) = (&mut self.f[..m], &mut self.v[..m], &mut self.mu[..m], &mut self.gain[..m]);

        let innovation = y - predict(theta, phi, copy);
        if !innovation.is_finite() {
            return Update { innovation, bounded: false };
        }
        project(tiles, copy, f);
        let (bounded, per_beta) = divide(&mut self.d[..m], &self.d_limit[..m], f, lambda, v, mu);
        gain.fill([0.0; LANES]);
        spread(tiles, v, mu, gain);
        let step = innovation * per_beta;
        for (theta, gain) in theta.iter_mut().zip(gain) {
            *theta = from_fn(|i| theta[i] + gain[i] * step);
        }
        Update { innovation, bounded }
    }

    /// P_ij.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        (i.max(j)..self.n).map(|m| self.u_at(i, m) * self.d()[m] * self.u_at(j, m)).sum()
    }

    /// Sum of the diagonal of P.
    pub fn covariance_trace(&self) -> f64 {
        (0..self.n).map(|i| self.covariance(i, i)).sum()
    }

    /// Whether coefficients and covariance are finite.
    pub fn is_finite(&self) -> bool {
        self.theta.iter().chain(&self.d).chain(self.tiles.as_flattened()).flatten().all(|v| v.is_finite())
    }

    /// Writes the information that coefficients and covariance stand for: R with R'R = P^-1, z = R theta.
    ///
    /// R = D^-1/2 U^-1. A held coefficient gets a row of its own that keeps it at its value, with the weight of
    /// the best known other one.
    pub fn information(&self, information: &mut Triangle, row: &mut [f64]) {
        information.clear();
        let smallest = self.d().iter().copied().filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
        for i in 0..self.n {
            let d = if self.d()[i] > 0.0 { self.d()[i] } else { smallest };
            // Row i of U^-1: entries w_j with w_i = 1 and w U = e_i.
            row.fill(0.0);
            row[i] = 1.0;
            for j in i + 1..self.n {
                row[j] = -(i..j).map(|m| row[m] * self.u_at(m, j)).sum::<f64>();
            }
            let weight = 1.0 / d.sqrt();
            row.iter_mut().for_each(|value| *value *= weight);
            let target = row.iter().zip(self.theta()).map(|(r, t)| r * t).sum();
            information.add(row, target);
        }
    }
}

/// phi' theta; copies phi on the way.
#[inline(always)]
fn predict(theta: &[Block], phi: &[f64], copy: &mut [Block]) -> f64 {
    let (whole, rest) = phi.as_chunks::<LANES>();
    let mut parts = [0.0; LANES];
    for ((phi, theta), copy) in whole.iter().zip(theta).zip(copy.iter_mut()) {
        *copy = *phi;
        parts = from_fn(|i| parts[i] + phi[i] * theta[i]);
    }
    if let (Some(theta), Some(copy)) = (theta.get(whole.len()), copy.get_mut(whole.len())) {
        for (i, phi) in rest.iter().enumerate() {
            copy[i] = *phi;
            parts[i] += phi * theta[i];
        }
    }
    sum(parts)
}

/// f = U' phi.
#[inline(always)]
fn project(mut tiles: &[[Block; LANES]], phi: &[Block], f: &mut [Block]) {
    for (t, f) in f.iter_mut().enumerate() {
        let (column, right) = tiles.split_at(t + 1);
        tiles = right;
        let mut parts = [[0.0; LANES]; LANES];
        for (u, phi) in column.iter().zip(phi) {
            for j in 0..LANES {
                parts[j] = from_fn(|i| parts[j][i] + u[j][i] * phi[i]);
            }
        }
        *f = parts.map(sum);
    }
}

/// v = D f, mu_j = -f_j / beta_(j-1), and the new D, with beta_j = lambda + sum of f_i v_i, i <= j.
///
/// Returns whether D was cut, and 1 / beta of the last column. A division takes as long as ten additions: there is one
/// per column, and two columns are divided at once.
#[inline(always)]
fn divide(
    d: &mut [Block],
    d_limit: &[Block],
    f: &[Block],
    lambda: f64,
    v: &mut [Block],
    mu: &mut [Block],
) -> (bool, f64) {
    let per_lambda = 1.0 / lambda;
    let (mut bounded, mut beta, mut per_beta) = (false, lambda, per_lambda);
    let columns = pairs_mut(d).iter_mut().zip(pairs(d_limit)).zip(pairs(f));
    for (((d, limit), f), (v, mu)) in columns.zip(pairs_mut(v).iter_mut().zip(pairs_mut(mu))) {
        *v = [d[0] * f[0], d[1] * f[1]];
        let [first, second] = [f[0] * v[0], f[1] * v[1]];
        let next = [beta + first, beta + (first + second)];
        let per_next = next.map(|beta| 1.0 / beta);
        *mu = [-f[0] * per_beta, -f[1] * per_next[0]];
        let free = [d[0] * beta * (per_next[0] * per_lambda), d[1] * next[0] * (per_next[1] * per_lambda)];
        bounded |= (free[0] > limit[0]) | (free[1] > limit[1]);
        *d = from_fn(|j| if free[j] > limit[j] { limit[j] } else { free[j] });
        (beta, per_beta) = (next[1], per_next[1]);
    }
    (bounded, per_beta)
}

/// The new U, u_ij + gain_i mu_j; the gain, zero at first, grows by one entry per column.
#[inline(always)]
fn spread(mut tiles: &mut [[Block; LANES]], v: &[Block], mu: &[Block], gain: &mut [Block]) {
    for (t, (&v, &mu)) in v.iter().zip(mu).enumerate() {
        let (column, right) = tiles.split_at_mut(t + 1);
        tiles = right;
        for (u, gain) in column.iter_mut().zip(gain.iter_mut()) {
            let mut g = *gain;
            for j in 0..LANES {
                let old = u[j];
                u[j] = from_fn(|i| old[i] + g[i] * mu[j]);
                g = from_fn(|i| g[i] + old[i] * v[j]);
            }
            *gain = g;
        }
    }
}

/// The tile that holds u_ij.
fn tile(i: usize, j: usize) -> usize {
    let (s, t) = (i / LANES, j / LANES);
    t * (t + 1) / 2 + s
}

fn sum(parts: Block) -> f64 {
    (parts[0] + parts[2]) + (parts[1] + parts[3])
}

fn pairs(blocks: &[Block]) -> &[[f64; 2]] {
    blocks.as_flattened().as_chunks().0
}

fn pairs_mut(blocks: &mut [Block]) -> &mut [[f64; 2]] {
    blocks.as_flattened_mut().as_chunks_mut().0
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    fn noise(i: usize) -> f64 {
        // A fixed sequence without structure that matters here.
        let x = (i as f64 * 12.9898).sin() * 43758.5453;
        2.0 * (x - x.floor()) - 1.0
    }

    fn phi(k: usize, n: usize) -> Vec<f64> {
        (0..n).map(|j| noise(k * n + j)).collect()
    }

    fn truth(n: usize) -> Vec<f64> {
        (0..n).map(|j| 0.5 - 0.1 * j as f64).collect()
    }

    fn y(k: usize, n: usize) -> f64 {
        phi(k, n).iter().zip(truth(n)).map(|(p, t)| p * t).sum::<f64>() + 0.05 * noise(k * 7919 + 13)
    }

    fn started(n: usize, rows: usize) -> RecursiveLeastSquares {
        let mut data = Triangle::new(n);
        (0..rows).for_each(|k| data.add(&phi(k, n), y(k, n)));
        let mut estimator = RecursiveLeastSquares::new(n);
        estimator.start(&data, &vec![false; n]);
        estimator
    }

    #[test]
    fn without_forgetting_it_is_batch_least_squares() {
        let n = 6;
        let mut estimator = started(n, 30);
        (30..400).for_each(|k| {
            estimator.update(&phi(k, n), y(k, n), 1.0);
        });
        let rows = DMatrix::from_fn(400, n, |k, j| phi(k, n)[j]);
        let targets = DVector::from_fn(400, |k, _| y(k, n));
        let inverse = (rows.transpose() * &rows).try_inverse().unwrap();
        let batch = &inverse * rows.transpose() * targets;
        for i in 0..n {
            assert!((estimator.theta()[i] - batch[i]).abs() < 1e-12);
            for j in 0..n {
                assert!((estimator.covariance(i, j) - inverse[(i, j)]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn with_forgetting_it_is_the_printed_recursion() {
        let n = 5;
        let mut estimator = started(n, 40);
        let mut p = DMatrix::from_fn(n, n, |i, j| estimator.covariance(i, j));
        let mut theta = DVector::from_column_slice(estimator.theta());
        for k in 40..300 {
            let lambda = 0.97 + 0.03 * (k as f64 * 0.1).sin().abs();
            let f = DVector::from_vec(phi(k, n));
            let gain = &p * &f / (lambda + f.dot(&(&p * &f)));
            theta += &gain * (y(k, n) - f.dot(&theta));
            p = (&p - &gain * f.transpose() * &p) / lambda;
            p = (&p + p.transpose()) * 0.5;
            let update = estimator.update(f.as_slice(), y(k, n), lambda);
            assert!(!update.bounded);
        }
        for i in 0..n {
            assert!((estimator.theta()[i] - theta[i]).abs() < 1e-10);
        }
        assert!((estimator.covariance_trace() / p.trace() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_million_idle_samples_do_not_wind_the_covariance_up() {
        let n = 4;
        let mut estimator = started(n, 100);
        let bound: f64 = 2.0 * 100.0 * estimator.covariance_trace();
        let mut idle = vec![0.0; n];
        idle[0] = 0.5;
        for _ in 0..1_000_000 {
            estimator.update(&idle, 0.5 * truth(n)[0], 0.9);
        }
        assert!(estimator.is_finite());
        assert!(estimator.covariance_trace() < bound, "{} {bound}", estimator.covariance_trace());
        // Full excitation again: as good as an estimator that never rested.
        let mut fresh = started(n, 100);
        for k in 0..500 {
            estimator.update(&phi(k, n), y(k, n), 0.98);
            fresh.update(&phi(k, n), y(k, n), 0.98);
        }
        for (a, b) in estimator.theta().iter().zip(fresh.theta()) {
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
    }

    #[test]
    fn a_held_coefficient_stays_and_nonsense_teaches_nothing() {
        let n = 4;
        let held = [false, false, true, false];
        let mut data = Triangle::new(n);
        (0..60).for_each(|k| data.add(&phi(k, n), y(k, n)));
        let mut estimator = RecursiveLeastSquares::new(n);
        let mut restricted = Triangle::new(n);
        data.hold_into(&held, &mut restricted);
        estimator.start(&restricted, &held);
        (60..200).for_each(|k| {
            estimator.update(&phi(k, n), y(k, n), 0.95);
        });
        assert_eq!(estimator.theta()[2], 0.0);
        let before = estimator.theta().to_vec();
        for poison in [f64::NAN, f64::INFINITY] {
            assert!(!estimator.update(&phi(0, n), poison, 0.95).innovation.is_finite());
            let mut row = phi(0, n);
            row[1] = poison;
            estimator.update(&row, 1.0, 0.95);
        }
        assert_eq!(estimator.theta(), before);
        assert!(estimator.is_finite());
    }

    #[test]
    fn information_is_the_inverse_covariance() {
        let n = 5;
        let mut estimator = started(n, 40);
        (40..90).for_each(|k| {
            estimator.update(&phi(k, n), y(k, n), 0.97);
        });
        let mut information = Triangle::new(n);
        estimator.information(&mut information, &mut vec![0.0; n]);
        let r = DMatrix::from_fn(n, n, |i, j| if j >= i { information.entry(i, j) } else { 0.0 });
        let p = DMatrix::from_fn(n, n, |i, j| estimator.covariance(i, j));
        let identity = r.transpose() * r * p;
        assert!((identity - DMatrix::identity(n, n)).norm() < 1e-10);
        let mut theta = vec![0.0; n];
        information.solve(&mut theta);
        for (a, b) in theta.iter().zip(estimator.theta()) {
            assert!((a - b).abs() < 1e-12);
        }
    }
}
