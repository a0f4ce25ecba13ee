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
//! training times the number of rows of the training: then the covariance says no less than one of these rows would on
//! average. Cutting d_j keeps P positive definite.
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

mod kernel;
#[cfg(test)]
mod tests;

use std::array::from_fn;

use crate::least_squares::Triangle;

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
        // The same code four times: where the compiler knows the number of blocks, it unrolls all loops. With the
        // paper's orders the linear form has two blocks, the full form four, and six with one more lag.
        let phi = &phi[..self.n];
        let update = match self.theta.len() {
            2 => self.update_blocks(2, phi, y, choose),
            4 => self.update_blocks(4, phi, y, choose),
            6 => self.update_blocks(6, phi, y, choose),
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
        let (tiles, theta, copy) = (&mut self.tiles[..m * (m + 1) / 2], &mut self.theta[..m], &mut self.phi[..m]);
        let (f, v, mu, gain) = (&mut self.f[..m], &mut self.v[..m], &mut self.mu[..m], &mut self.gain[..m]);
        let d = &mut self.d[..m];

        let innovation = y - kernel::predict(theta, phi, copy);
        if !innovation.is_finite() {
            return Update { innovation, bounded: false };
        }
        kernel::project(tiles, copy, f);
        let leverage = kernel::leverage(d, f);
        if !leverage.is_finite() {
            return Update { innovation, bounded: false };
        }
        let change = choose(innovation, leverage);
        let bounds = (&self.d_floor[..m], &self.d_limit[..m]);
        let (bounded, per_beta) = kernel::divide(d, bounds, f, &change, v, mu);
        gain.fill([0.0; LANES]);
        kernel::spread(tiles, v, mu, gain);
        let step = innovation * per_beta * change.step;
        for (theta, gain) in theta.iter_mut().zip(gain) {
            *theta = from_fn(|i| theta[i] + gain[i] * step);
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
    pub fn leverage(&mut self, phi: &[f64]) -> f64 {
        kernel::predict(&self.theta, &phi[..self.n], &mut self.phi);
        kernel::project(&self.tiles, &self.phi, &mut self.f);
        kernel::leverage(&self.d, &self.f)
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
}

/// The tile that holds u_ij.
fn tile(i: usize, j: usize) -> usize {
    let (s, t) = (i / LANES, j / LANES);
    t * (t + 1) / 2 + s
}
