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
//! first sample that does excite it throws the coefficients away. Every d_j is therefore bounded by its value after
//! training times the number of rows that the triangle has taken in: then the covariance says no less than one of
//! these rows would on average. (The rows of the full form are the training samples. The linear form is projected from
//! the triangle of the full one, which has as many rows as coefficients: its bound is tighter.) Cutting d_j keeps P
//! positive definite.
//!
//! Trap: it does not bound P. Outliers between long rests turn U until P is hundreds of times beyond what the d_j
//! allow. A P_ii beyond four times its own bound is therefore brought back by scaling its row and its column, which
//! keeps P positive definite too. From below every d_j is bounded far under what data say: a d_j that one huge row had
//! rounded to zero would never learn again.
//!
//! Every rank-one change of P that a rule for forgetting asks for is the same update with other numbers:
//!
//! ```text
//! P <- g [P - P phi phi' P / (r + phi' P phi)]        theta <- theta + s P phi / (r + phi' P phi) [y - phi' theta]
//! ```
//!
//! With r = -1 it takes a row out again; P stays positive definite as long as phi' P phi < |r|.

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
    d_floor: Vec<Block>,
    /// P_ii after training times the number of rows.
    variance_limit: Vec<Block>,
    /// Updates since every P_ii was last looked at.
    unchecked: u32,
    phi: Vec<Block>,
    f: Vec<Block>,
    v: Vec<Block>,
    mu: Vec<Block>,
    gain: Vec<Block>,
}

/// How far a P_ii may lie beyond its value after training times the number of rows.
const SLACK: f64 = 4.0;

/// Updates after which every P_ii is looked at, also where no d_j was cut.
const CHECK_EVERY: u32 = 64;

/// The smallest d_j, as a part of its value after training: further down than any record of samples leads.
const FLOOR: f64 = 1e-24;

/// The numbers of one update, r, g and s in the equation at the top of the module.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Change {
    /// r, not zero: the variance that the row is taken to have, in units of the noise.
    pub variance: f64,
    /// g, greater than zero: what the covariance is multiplied by afterwards.
    pub growth: f64,
    /// s: 1, unless the coefficients follow another variance than the covariance does.
    pub step: f64,
}

impl Change {
    /// Exponential forgetting, (18)-(20).
    #[inline(always)]
    pub fn forget(lambda: f64) -> Self {
        Self { variance: lambda, growth: 1.0 / lambda, step: 1.0 }
    }

    /// Takes a row out that was taken in before.
    const REMOVE: Self = Self { variance: -1.0, growth: 1.0, step: 1.0 };
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
            d_floor: blocks.clone(),
            variance_limit: blocks.clone(),
            unchecked: 0,
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
        self.start_bounded(data, held, data.count() as f64);
    }

    /// The same with d_limit = d times `bound`.
    pub(crate) fn start_bounded(&mut self, data: &Triangle, held: &[bool], bound: f64) {
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
            self.d_limit.as_flattened_mut()[j] = if held[j] { 0.0 } else { d * bound };
            self.d_floor.as_flattened_mut()[j] = d * FLOOR;
        }
        // P_ii of a held coefficient is zero.
        self.variances();
        for (limit, variance) in self.variance_limit.iter_mut().zip(&self.v) {
            *limit = variance.map(|variance| variance * bound);
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
        self.update_by(phi, y, |_, _| Change::forget(lambda))
    }

    /// One update by what `choose` makes of the innovation and of phi' P phi; it is not asked about a row that is not
    /// finite, nor about one whose phi' P phi overflows: those teach nothing.
    pub(crate) fn update_by(&mut self, phi: &[f64], y: f64, choose: impl FnOnce(f64, f64) -> Change) -> Update {
        // The same code three times: where the compiler knows the number of blocks, it unrolls all loops. Two blocks
        // are the linear form of the built-in machine, four the full form.
        let update = match self.d.len() {
            2 => self.update_blocks(2, phi, y, choose),
            4 => self.update_blocks(4, phi, y, choose),
            m => self.update_blocks(m, phi, y, choose),
        };
        self.unchecked += 1;
        if update.bounded || self.unchecked == CHECK_EVERY {
            self.unchecked = 0;
            self.bound_variances();
        }
        update
    }

    #[inline(always)]
    fn update_blocks(&mut self, m: usize, phi: &[f64], y: f64, choose: impl FnOnce(f64, f64) -> Change) -> Update {
        // f in both senses: first U' phi, then scratch.
        let tiles = &mut self.tiles[..m * (m + 1) / 2];
        let (theta, d, d_limit) = (&mut self.theta[..m], &mut self.d[..m], &self.d_limit[..m]);
        let d_floor = &self.d_floor[..m];
        let (copy, f, v) = (&mut self.phi[..m], &mut self.f[..m], &mut self.v[..m]);
        let (mu, gain) = (&mut self.mu[..m], &mut self.gain[..m]);

        let (whole, rest) = phi.as_chunks::<LANES>();
        let mut parts = [0.0; LANES];
        for ((copy, phi), theta) in copy.iter_mut().zip(whole).zip(theta.iter()) {
            *copy = *phi;
            parts = from_fn(|i| parts[i] + phi[i] * theta[i]);
        }
        if let (Some(copy), Some(theta)) = (copy.get_mut(whole.len()), theta.get(whole.len())) {
            for (i, phi) in rest.iter().enumerate() {
                copy[i] = *phi;
                parts[i] += phi * theta[i];
            }
        }
        let innovation = y - sum(parts);
        if !innovation.is_finite() {
            return Update { innovation, bounded: false };
        }
        // f = U' phi.
        let mut rest = &*tiles;
        let mut total = [0.0; LANES];
        for (t, (f, d)) in f.iter_mut().zip(d.iter()).enumerate() {
            let (column, right) = rest.split_at(t + 1);
            rest = right;
            let mut parts = [[0.0; LANES]; LANES];
            for (u, phi) in column.iter().zip(copy.iter()) {
                for j in 0..LANES {
                    (0..LANES).for_each(|i| parts[j][i] += u[j][i] * phi[i]);
                }
            }
            *f = parts.map(sum);
            total = from_fn(|i| total[i] + d[i] * f[i] * f[i]);
        }
        let leverage = sum(total);
        if !leverage.is_finite() {
            return Update { innovation, bounded: false };
        }
        let Change { variance, growth, step } = choose(innovation, leverage);
        // beta_j = variance + sum of d_i f_i^2, i <= j.
        let mut bounded = false;
        let (mut last, mut last_inverse) = (variance, 1.0 / variance);
        let limits = pairs(d_limit).iter().zip(pairs(d_floor));
        let columns = pairs_mut(d).iter_mut().zip(limits).zip(pairs(f));
        for (((d, (d_limit, d_floor)), f), (v, mu)) in columns.zip(pairs_mut(v).iter_mut().zip(pairs_mut(mu))) {
            *v = [d[0] * f[0], d[1] * f[1]];
            let (first, second) = (f[0] * v[0], f[1] * v[1]);
            let beta = [last + first, last + (first + second)];
            let inverse = beta.map(|beta| 1.0 / beta);
            *mu = [-f[0] * last_inverse, -f[1] * inverse[0]];
            let grown = [d[0] * last * (inverse[0] * growth), d[1] * beta[0] * (inverse[1] * growth)];
            bounded |= (grown[0] > d_limit[0]) | (grown[1] > d_limit[1]);
            *d = from_fn(|j| if grown[j] > d_limit[j] { d_limit[j] } else { grown[j] });
            *d = from_fn(|j| if d[j] < d_floor[j] { d_floor[j] } else { d[j] });
            (last, last_inverse) = (beta[1], inverse[1]);
        }
        // The gain grows by one entry per column.
        gain.fill([0.0; LANES]);
        let mut rest = tiles;
        for (t, (&v, &mu)) in v.iter().zip(mu.iter()).enumerate() {
            let (column, right) = rest.split_at_mut(t + 1);
            rest = right;
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
        let step = innovation * last_inverse * step;
        for s in 0..m {
            theta[s] = from_fn(|i| theta[s][i] + gain[s][i] * step);
        }
        Update { innovation, bounded }
    }

    /// Takes the row (phi, y) out again that was taken in without forgetting: the inverse of an update.
    ///
    /// False, and nothing has changed, when the row is nearly all that is known in its direction, so that the rest
    /// would be rounding: phi' P phi greater than `most`, a number below 1.
    #[must_use]
    pub(crate) fn remove(&mut self, phi: &[f64], y: f64, most: f64) -> bool {
        if self.leverage(phi) > most {
            return false;
        }
        self.update_by(phi, y, |_, _| Change::REMOVE);
        true
    }

    /// phi' P phi: how uncertain the prediction for this row is, in units of the noise's variance.
    pub fn leverage(&self, phi: &[f64]) -> f64 {
        let (whole, rest) = phi.as_chunks::<LANES>();
        let mut last = [0.0; LANES];
        last[..rest.len()].copy_from_slice(rest);
        let blocks = || whole.iter().chain(if rest.is_empty() { None } else { Some(&last) });
        let mut tiles = &*self.tiles;
        let mut total = [0.0; LANES];
        for (t, d) in self.d.iter().enumerate() {
            let (column, right) = tiles.split_at(t + 1);
            tiles = right;
            let mut parts = [[0.0; LANES]; LANES];
            for (u, phi) in column.iter().zip(blocks()) {
                for j in 0..LANES {
                    (0..LANES).for_each(|i| parts[j][i] += u[j][i] * phi[i]);
                }
            }
            let f = parts.map(sum);
            total = from_fn(|i| total[i] + d[i] * f[i] * f[i]);
        }
        sum(total)
    }

    /// Forgets only what is excited: P <- S P S, S diagonal with lambda^-1/2, or 1 where `idle`. To be followed by an
    /// [update](Self::update) with the factor 1; with nothing idle the two are (19)-(20).
    ///
    /// ```text
    /// u_ij <- u_ij s_i / s_j        d_j <- d_j s_j^2
    /// ```
    ///
    /// True when something was held back by a bound. An idle coefficient keeps its d_j, so that u_ij alone would carry
    /// the growth of the others' variances; a coefficient whose P_ii has reached its value after training times the
    /// number of rows therefore counts as idle.
    pub fn forget_selectively(&mut self, lambda: f64, idle: &[bool]) -> bool {
        let (scale, growth) = (lambda.sqrt().recip(), lambda.recip());
        self.variances();
        let (mut bounded, mut all) = (false, true);
        let scales = self.v.as_flattened_mut().iter_mut().zip(self.variance_limit.as_flattened());
        for (j, (s, limit)) in scales.enumerate() {
            let (excited, room) = (j < self.n && !idle[j], *s * growth <= *limit);
            bounded |= excited && !room;
            *s = if excited && room { scale } else { 1.0 };
            all &= excited && room || j >= self.n;
        }
        for ((d, limit), s) in self.d.iter_mut().zip(&self.d_limit).zip(&self.v) {
            for j in 0..LANES {
                let grown = d[j] * s[j] * s[j];
                bounded |= grown > limit[j];
                d[j] = grown.min(limit[j]);
            }
        }
        // One scale for all leaves U as it is.
        if !all {
            self.scale_u();
        }
        bounded
    }

    /// Brings every P_ii that is beyond [`SLACK`] times its bound back to that, by P <- S P S.
    fn bound_variances(&mut self) {
        self.variances();
        let beyond = |(variance, limit): (&f64, &f64)| *variance > SLACK * limit;
        if !self.v.as_flattened().iter().zip(self.variance_limit.as_flattened()).any(beyond) {
            return;
        }
        let scales = self.v.as_flattened_mut().iter_mut().zip(self.variance_limit.as_flattened());
        scales.for_each(|(s, limit)| {
            let limit = SLACK * limit;
            *s = if *s > limit { (limit / *s).sqrt() } else { 1.0 };
        });
        self.scale_u();
        for (d, s) in self.d.iter_mut().zip(&self.v) {
            *d = from_fn(|j| d[j] * s[j] * s[j]);
        }
    }

    /// Makes v the diagonal of P. Column j of U has its d_j, so every tile adds to the
    /// rows that it crosses.
    fn variances(&mut self) {
        self.v.fill([0.0; LANES]);
        let mut rest = &*self.tiles;
        for (t, d) in self.d.iter().enumerate() {
            let (column, right) = rest.split_at(t + 1);
            rest = right;
            for (u, variance) in column.iter().zip(self.v.iter_mut()) {
                for j in 0..LANES {
                    (0..LANES).for_each(|i| variance[i] += d[j] * u[j][i] * u[j][i]);
                }
            }
        }
    }

    /// u_ij <- u_ij s_i / s_j, S in v.
    fn scale_u(&mut self) {
        let mut rest = &mut *self.tiles;
        for (t, s_of_columns) in self.v.iter().enumerate() {
            let (column, right) = rest.split_at_mut(t + 1);
            rest = right;
            let per = s_of_columns.map(f64::recip);
            for (u, s) in column.iter_mut().zip(&self.v) {
                for j in 0..LANES {
                    u[j] = from_fn(|i| u[j][i] * (s[i] * per[j]));
                }
            }
        }
    }

    /// P_ij.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        // In one order for (i, j) and (j, i), or rounding would make them differ.
        let (i, j) = (i.min(j), i.max(j));
        (j..self.n).map(|m| self.u_at(i, m) * self.d()[m] * self.u_at(j, m)).sum()
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

/// The tile that holds u_ij.
fn tile(i: usize, j: usize) -> usize {
    let (s, t) = (i / LANES, j / LANES);
    t * (t + 1) / 2 + s
}

fn pairs(blocks: &[Block]) -> &[[f64; 2]] {
    blocks.as_flattened().as_chunks().0
}

fn pairs_mut(blocks: &mut [Block]) -> &mut [[f64; 2]] {
    blocks.as_flattened_mut().as_chunks_mut().0
}

fn sum(parts: Block) -> f64 {
    (parts[0] + parts[2]) + (parts[1] + parts[3])
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

    #[test]
    fn forgetting_selectively_with_nothing_idle_is_the_printed_recursion() {
        for n in [3, 5, 15] {
            let (mut printed, mut selective) = (started(n, 60), started(n, 60));
            for k in 60..300 {
                printed.update(&phi(k, n), y(k, n), 0.97);
                assert!(!selective.forget_selectively(0.97, &vec![false; n]));
                selective.update(&phi(k, n), y(k, n), 1.0);
            }
            for i in 0..n {
                assert!((printed.theta()[i] - selective.theta()[i]).abs() < 1e-11);
                for j in 0..n {
                    assert!((printed.covariance(i, j) - selective.covariance(i, j)).abs() < 1e-11);
                }
            }
        }
    }

    #[test]
    fn forgetting_selectively_scales_the_excited_rows_and_columns_alone() {
        let n = 5;
        let idle = [false, true, false, true, true];
        let before = started(n, 60);
        let mut after = before.clone();
        after.forget_selectively(0.81, &idle);
        let s = idle.map(|idle| if idle { 1.0 } else { 1.0 / 0.9 });
        for i in 0..n {
            for j in 0..n {
                let expected = s[i] * before.covariance(i, j) * s[j];
                assert!((after.covariance(i, j) - expected).abs() < 1e-14);
            }
        }
        // Marked as excited and never excited: each variance stays below its bound.
        assert!((0..100_000).any(|_| after.forget_selectively(0.9, &idle)));
        (0..100_000).for_each(|_| {
            after.forget_selectively(0.9, &idle);
        });
        assert!(after.is_finite());
        for (i, idle) in idle.iter().enumerate() {
            let ratio = after.covariance(i, i) / before.covariance(i, i);
            assert!(ratio <= 60.0 * (1.0 + 1e-9), "{ratio}");
            assert!(*idle || ratio > 50.0, "{ratio}");
            assert!(!idle || (ratio - 1.0).abs() < 1e-6, "{ratio}");
        }
    }

    #[test]
    fn a_row_taken_out_again_was_never_there() {
        for n in [4, 5, 16] {
            let before = started(n, 80);
            let mut after = before.clone();
            let rows: Vec<_> = (80..100).map(|k| (phi(k, n), y(k, n))).collect();
            for (phi, y) in &rows {
                after.update(phi, *y, 1.0);
            }
            for (phi, y) in &rows {
                assert!(after.leverage(phi) < before.leverage(phi));
                assert!(after.remove(phi, *y, 0.999));
            }
            for i in 0..n {
                assert!((before.theta()[i] - after.theta()[i]).abs() < 1e-12);
                assert!((before.covariance(i, i) / after.covariance(i, i) - 1.0).abs() < 1e-12);
            }
            let huge: Vec<f64> = phi(7, n).iter().map(|p| 1e4 * p).collect();
            after.update(&huge, 0.0, 1.0);
            assert!(!after.remove(&huge, 0.0, 0.999));
        }
    }

    #[test]
    fn the_largest_rows_leave_an_estimator_that_still_learns() {
        let n = 5;
        let mut estimator = started(n, 100);
        for size in [1e100, 1e150, 1e200, 1e300, f64::MAX] {
            let row: Vec<f64> = phi(3, n).iter().map(|p| size * p).collect();
            estimator.update(&row, 1.0, 0.99);
            assert!(estimator.is_finite() && estimator.d().iter().all(|d| *d > 0.0), "{size}");
        }
        (0..20_000).for_each(|k| {
            estimator.update(&phi(k, n), y(k, n), 0.98);
        });
        for (a, b) in estimator.theta().iter().zip(truth(n)) {
            assert!((a - b).abs() < 0.02, "{a} {b}");
        }
    }
}
