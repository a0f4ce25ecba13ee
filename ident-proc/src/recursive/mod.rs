//! Recursive least squares with a forgetting factor, on a factorised covariance.
//!
//! ```text
//! theta(k) = theta(k-1) + K(k) [y(k) - phi(k)' theta(k-1)]                                         (18)
//! P(k)     = 1/lambda [I - K(k) phi(k)'] P(k-1)                                                    (19)
//! K(k)     = P(k-1) phi(k) / (lambda + phi(k)' P(k-1) phi(k))                                      (20)
//! ```
//!
//! theta coefficients, phi regressor, y target in its unit, lambda forgetting factor, K gain. P is the covariance of
//! theta divided by the variance of the noise.
//!
//! P is stored as U D U', U unit upper triangular and D diagonal (Bierman, Factorization Methods for Discrete
//! Sequential Estimation, 1977; with forgetting as in Ljung and Soderstrom, Theory and Practice of Recursive
//! Identification, 1983). In this form P cannot lose its symmetry or become indefinite. Computed as printed, (19)
//! becomes indefinite after a few thousand samples.
//!
//! Trap, covariance wind-up: (19) divides P by lambda at every sample in a direction that is not excited. The first
//! sample that does excite this direction then throws the coefficients away. Every d_j is therefore bounded by its
//! value after training times the number of rows of the training. At this bound P holds as much information as one
//! average row of the training. A cut of d_j keeps P positive definite.
//!
//! Trap: bounds on d_j do not bound P. Outliers between long rests turn U until P is hundreds of times beyond what the
//! d_j allow. A P_ii beyond four times its own bound is therefore brought back to that by scaling its row and its
//! column, which keeps P positive definite too. Every d_j also has a lower bound, far below what data give: a d_j that
//! one huge row had rounded to zero would never learn again.
//!
//! Every rank-one change of P that a rule of forgetting needs is one update with the numbers r, g and s:
//!
//! ```text
//! P <- g [P - P phi phi' P / (r + phi' P phi)]        theta <- theta + s P phi / (r + phi' P phi) [y - phi' theta]
//! ```
//!
//! With r = -1 the update takes a row out again; P stays positive definite as long as phi' P phi < |r|.
//!
//! All of this runs in the loop. Nothing here allocates after construction.

mod kernel;
#[cfg(test)]
mod tests;

use std::array::from_fn;

use crate::least_squares::Triangle;

/// Numbers in a block. All loops of an update run over blocks, which the compiler turns into vector instructions.
const LANES: usize = 4;

/// Entries of neighbouring columns or rows. Entries beyond the last one are zero and stay zero.
type Block = [f64; LANES];

/// Coefficients and covariance of one recursive estimator.
///
/// ```
/// use ident_proc::{least_squares::Triangle, recursive::RecursiveLeastSquares};
///
/// // Offline: y = 2 x. Later the plant changes to y = 3 x.
/// let mut rows = Triangle::new(1);
/// (1..=10).for_each(|x| rows.add(&[f64::from(x)], 2.0 * f64::from(x)));
/// let mut recursion = RecursiveLeastSquares::new(1);
/// recursion.start(&rows, &[false]);
/// assert!((recursion.theta()[0] - 2.0).abs() < 1e-12);
/// for _ in 0..500 {
///     let update = recursion.update(&[1.0], 3.0, 0.95);
///     assert!(update.innovation.is_finite());
/// }
/// assert!((recursion.theta()[0] - 3.0).abs() < 1e-3);
/// ```
#[derive(Debug, Clone)]
pub struct RecursiveLeastSquares {
    n: usize,
    theta: Vec<Block>,
    /// U in tiles of LANES columns, tile (s, t) at t (t + 1) / 2 + s, s <= t. The ones on the diagonal and the zeros
    /// below are stored too. An update maps them to themselves, so the tiles on the diagonal need no code of their own,
    /// and every loop has a fixed length.
    tiles: Vec<[Block; LANES]>,
    d: Vec<Block>,
    bounds: Bounds,
    /// Updates since every P_ii was last compared with its bound.
    unchecked: u32,
    work: Workspace,
}

/// The bounds of the covariance.
#[derive(Debug, Clone)]
struct Bounds {
    /// Largest d_j: its value after training times the number of rows.
    d_limit: Vec<Block>,
    /// Smallest d_j.
    d_floor: Vec<Block>,
    /// P_ii after training times the number of rows.
    variance: Vec<Block>,
}

/// Vectors of one update.
#[derive(Debug, Clone)]
struct Workspace {
    phi: Vec<Block>,
    /// U' phi.
    f: Vec<Block>,
    /// D f; between updates also the diagonal of P, or of the scaling matrix S.
    v: Vec<Block>,
    mu: Vec<Block>,
    gain: Vec<Block>,
}

/// Largest P_ii, in parts of its value after training times the number of rows.
const SLACK: f64 = 4.0;

/// Updates after which every P_ii is compared with its bound, even if no d_j was cut.
const CHECK_EVERY: u32 = 64;

/// Smallest d_j, as a part of its value after training. No record of samples leads so far down.
const FLOOR: f64 = 1e-24;

/// The numbers r, g and s of one update, as in the equation at the top of the module.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Change {
    /// r, not zero: the assumed variance of the row, in units of the noise's variance.
    pub variance: f64,
    /// g, greater than zero: the factor on the covariance after the row.
    pub growth: f64,
    /// s: 1, unless the coefficients assume another variance of the row than the covariance does.
    pub step: f64,
}

impl Change {
    /// Exponential forgetting, (18)-(20).
    #[inline(always)]
    pub fn forget(lambda: f64) -> Self {
        Self { variance: lambda, growth: 1.0 / lambda, step: 1.0 }
    }

    /// Takes out a row that was taken in before.
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
    /// Room for `n` coefficients. Nothing is known yet, and nothing is learned before [`Self::start`].
    pub fn new(n: usize) -> Self {
        let blocks = vec![[0.0; LANES]; n.div_ceil(LANES)];
        let mut estimator = Self {
            n,
            theta: blocks.clone(),
            tiles: vec![[[0.0; LANES]; LANES]; blocks.len() * (blocks.len() + 1) / 2],
            d: blocks.clone(),
            bounds: Bounds { d_limit: blocks.clone(), d_floor: blocks.clone(), variance: blocks.clone() },
            unchecked: 0,
            work: Workspace {
                phi: blocks.clone(),
                f: blocks.clone(),
                v: blocks.clone(),
                mu: blocks.clone(),
                gain: blocks,
            },
        };
        (0..n).for_each(|j| *estimator.u_mut(j, j) = 1.0);
        estimator
    }

    /// Starts from offline data: theta = R^-1 z, P = (R'R)^-1, upper bounds of d = d times the rows of the triangle.
    ///
    /// A coefficient that is `held` never changes: it has no covariance.
    pub fn start(&mut self, data: &Triangle, held: &[bool]) {
        self.start_bounded(data, held, data.count() as f64);
    }

    /// Starts from offline data, with d times `bound` as the upper bounds of d.
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
            self.bounds.d_limit.as_flattened_mut()[j] = if held[j] { 0.0 } else { d * bound };
            self.bounds.d_floor.as_flattened_mut()[j] = d * FLOOR;
        }
        // P_ii of a held coefficient is zero.
        self.variances();
        for (limit, variance) in self.bounds.variance.iter_mut().zip(&self.work.v) {
            *limit = variance.map(|variance| variance * bound);
        }
    }

    /// Replaces the coefficients. The covariance stays.
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

    /// One update with the forgetting factor `lambda` in (0, 1]. Allocates nothing.
    ///
    /// A regressor or output that is not finite changes nothing; the innovation is then not finite.
    pub fn update(&mut self, phi: &[f64], y: f64, lambda: f64) -> Update {
        self.update_by(phi, y, |_, _| Change::forget(lambda))
    }

    /// One update with the numbers that `choose` makes of the innovation and of phi' P phi. A row that is not finite,
    /// or whose phi' P phi overflows, changes nothing, and `choose` is not called.
    pub(crate) fn update_by(&mut self, phi: &[f64], y: f64, choose: impl FnOnce(f64, f64) -> Change) -> Update {
        // The compiler unrolls all loops where it knows the number of blocks. With the paper's orders the linear form
        // has two blocks, the full form four, and the full form with one more lag six.
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
        let Workspace { phi: copy, f, v, mu, gain } = &mut self.work;
        let (tiles, theta, copy) = (&mut self.tiles[..m * (m + 1) / 2], &mut self.theta[..m], &mut copy[..m]);
        let (f, v, mu, gain) = (&mut f[..m], &mut v[..m], &mut mu[..m], &mut gain[..m]);
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
        let bounds = (&self.bounds.d_floor[..m], &self.bounds.d_limit[..m]);
        let (bounded, per_beta) = kernel::divide(d, bounds, f, &change, v, mu);
        gain.fill([0.0; LANES]);
        kernel::spread(tiles, v, mu, gain);
        let step = innovation * per_beta * change.step;
        for (theta, gain) in theta.iter_mut().zip(gain) {
            *theta = from_fn(|i| theta[i] + gain[i] * step);
        }
        Update { innovation, bounded }
    }

    /// Takes out the row (phi, y), which was taken in without forgetting: the inverse of an update.
    ///
    /// Changes nothing and returns false when phi' P phi is greater than `most`, a number below 1. Then this row holds
    /// nearly all information in its direction, and without it only rounding errors would be left.
    #[must_use]
    pub(crate) fn remove(&mut self, phi: &[f64], y: f64, most: f64) -> bool {
        if self.leverage(phi) > most {
            return false;
        }
        self.update_by(phi, y, |_, _| Change::REMOVE);
        true
    }

    /// phi' P phi: the variance of the prediction for this row, in units of the noise's variance.
    pub fn leverage(&mut self, phi: &[f64]) -> f64 {
        kernel::predict(&self.theta, &phi[..self.n], &mut self.work.phi);
        kernel::project(&self.tiles, &self.work.phi, &mut self.work.f);
        kernel::leverage(&self.d, &self.work.f)
    }

    /// Forgets only excited coefficients: P <- S P S, S diagonal with lambda^-1/2, or 1 where `idle`. An
    /// [update](Self::update) with the factor 1 has to follow. With nothing idle the two together are (19)-(20).
    ///
    /// ```text
    /// u_ij <- u_ij s_i / s_j        d_j <- d_j s_j^2
    /// ```
    ///
    /// Returns whether a bound held something back. An idle coefficient keeps its d_j, so that u_ij alone would carry
    /// the growth of the other variances. A coefficient whose P_ii has reached its value after training times the
    /// number of rows therefore counts as idle.
    pub fn forget_selectively(&mut self, lambda: f64, idle: &[bool]) -> bool {
        let (scale, growth) = (lambda.sqrt().recip(), lambda.recip());
        self.variances();
        let (mut bounded, mut all) = (false, true);
        let scales = self.work.v.as_flattened_mut().iter_mut().zip(self.bounds.variance.as_flattened());
        for (j, (s, limit)) in scales.enumerate() {
            let (excited, room) = (j < self.n && !idle[j], *s * growth <= *limit);
            bounded |= excited && !room;
            *s = if excited && room { scale } else { 1.0 };
            all &= excited && room || j >= self.n;
        }
        for ((d, limit), s) in self.d.iter_mut().zip(&self.bounds.d_limit).zip(&self.work.v) {
            for j in 0..LANES {
                let grown = d[j] * s[j] * s[j];
                bounded |= grown > limit[j];
                d[j] = grown.min(limit[j]);
            }
        }
        // One scale for all coefficients leaves U as it is.
        if !all {
            self.scale_u();
        }
        bounded
    }

    /// Brings every P_ii beyond [`SLACK`] times its bound back to that limit, by P <- S P S.
    fn bound_variances(&mut self) {
        self.variances();
        let beyond = |(variance, limit): (&f64, &f64)| *variance > SLACK * limit;
        if !self.work.v.as_flattened().iter().zip(self.bounds.variance.as_flattened()).any(beyond) {
            return;
        }
        let scales = self.work.v.as_flattened_mut().iter_mut().zip(self.bounds.variance.as_flattened());
        scales.for_each(|(s, limit)| {
            let limit = SLACK * limit;
            *s = if *s > limit { (limit / *s).sqrt() } else { 1.0 };
        });
        self.scale_u();
        for (d, s) in self.d.iter_mut().zip(&self.work.v) {
            *d = from_fn(|j| d[j] * s[j] * s[j]);
        }
    }

    /// Makes v the diagonal of P. Every tile adds d_j u_ij^2 to each row i that it crosses.
    fn variances(&mut self) {
        self.work.v.fill([0.0; LANES]);
        let mut rest = &*self.tiles;
        for (t, d) in self.d.iter().enumerate() {
            let (column, right) = rest.split_at(t + 1);
            rest = right;
            for (u, variance) in column.iter().zip(self.work.v.iter_mut()) {
                for j in 0..LANES {
                    (0..LANES).for_each(|i| variance[i] += d[j] * u[j][i] * u[j][i]);
                }
            }
        }
    }

    /// u_ij <- u_ij s_i / s_j, S in v.
    fn scale_u(&mut self) {
        let mut rest = &mut *self.tiles;
        for (t, s_of_columns) in self.work.v.iter().enumerate() {
            let (column, right) = rest.split_at_mut(t + 1);
            rest = right;
            let per = s_of_columns.map(f64::recip);
            for (u, s) in column.iter_mut().zip(&self.work.v) {
                for j in 0..LANES {
                    u[j] = from_fn(|i| u[j][i] * (s[i] * per[j]));
                }
            }
        }
    }

    /// P_ij.
    pub fn covariance(&self, i: usize, j: usize) -> f64 {
        // One order of the products for (i, j) and (j, i): otherwise rounding would make them differ.
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
