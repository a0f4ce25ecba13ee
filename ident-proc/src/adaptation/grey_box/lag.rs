//! One of the eight lags of the grey box: what is known of the speeds if this is the true lag.

use std::ops::Range;

use super::{
    matrix::{MOST, Matrix, Vector, cholesky, solve},
    prior::Prior,
};
use crate::dot;

/// Memory of J, in parts of M.
const JUDGED: f64 = 1.0 / 3.0;

/// One lag, with the symbols of the [grey box](super).
#[derive(Debug, Clone)]
pub struct Lag {
    alpha: f64,
    /// p.
    lagged: Vector,
    /// P.
    window: Vector,
    /// S, of which the lower half is used.
    information: Matrix,
    /// sum of w P (Y - theta' P) since theta was last solved for.
    gathered: Vector,
    theta: Vector,
    /// J times `weight`.
    squares: f64,
    /// Sum of the weights in J, at most 1: part of a full measure of motion.
    weight: f64,
}

/// What one sample says of the motion of the axis, the same for every lag.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    /// Y.
    pub travel: f64,
    /// w.
    pub weight: f64,
    /// w Y^2 of a full measure of motion, the most that it can be.
    pub full: f64,
    /// exp(-T/M).
    pub forgetting: f64,
    /// Features of each direction.
    pub order: usize,
}

impl Lag {
    /// Before any sample: what is known of the speeds, and the `theta` to begin with.
    pub fn new(alpha: f64, prior: &Prior, theta: Vector) -> Self {
        Self {
            alpha,
            lagged: [0.0; MOST],
            window: [0.0; MOST],
            information: prior.information,
            gathered: [0.0; MOST],
            theta,
            squares: 0.0,
            weight: 0.0,
        }
    }

    /// Takes in the value of feature `i`: p and P.
    pub fn filter(&mut self, i: usize, feature: f64, rho: f64, period: f64) {
        self.lagged[i] += (feature - self.lagged[i]) * (1.0 - self.alpha);
        self.window[i] = rho * self.window[i] + period * self.lagged[i];
    }

    /// Begins a new window, after a gap.
    pub fn clear_window(&mut self) {
        self.window = [0.0; MOST];
    }

    /// Takes the travel of a sample in: S, the sum for theta, and J. Returns what was kept of the information on either
    /// direction.
    pub fn gather(&mut self, motion: &Motion, prior: &Prior) -> [f64; 2] {
        let &Motion { travel, weight, full, forgetting, order } = motion;
        let n = 2 * order;
        let measure = |part: Range<usize>| {
            // By the commissioned speeds: else an axis that is blocked would say nothing when it comes free.
            let motion = dot(&prior.theta[part.clone()], &self.window[part]);
            (weight * motion * motion / full).min(1.0)
        };
        let keep = [measure(0..order), measure(order..n)].map(|measure| 1.0 - (1.0 - forgetting) * measure);
        let of = |i: usize| keep[usize::from(i >= order)].sqrt();
        let error = travel - dot(&self.theta[..n], &self.window[..n]);
        for i in 0..n {
            for j in 0..=i {
                let floor = prior.information[i][j];
                self.information[i][j] =
                    floor + of(i) * of(j) * (self.information[i][j] - floor) + weight * self.window[i] * self.window[j];
            }
            self.gathered[i] = of(i) * self.gathered[i] + weight * self.window[i] * error;
        }
        let kept = (keep[0] * keep[1]).powf(1.0 / JUDGED);
        self.squares = kept * self.squares + (1.0 - kept) * weight * error * error;
        self.weight = kept * self.weight + (1.0 - kept);
        keep
    }

    /// Changes theta by what was gathered since it was last solved for.
    pub fn solve(&mut self, n: usize) {
        if let Some(factor) = cholesky(&self.information, n) {
            let change = solve(&factor, &self.gathered, n);
            self.theta.iter_mut().zip(&change[..n]).for_each(|(theta, change)| *theta += change);
            self.gathered = [0.0; MOST];
        }
    }

    /// J.
    pub fn mean_square(&self) -> f64 {
        self.squares / self.weight.max(f64::MIN_POSITIVE)
    }

    /// Part of a full measure of motion that J is made of.
    pub fn judged(&self) -> f64 {
        self.weight
    }

    /// alpha.
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// theta.
    pub fn theta(&self) -> &Vector {
        &self.theta
    }

    /// S, of which the lower half is used.
    pub fn information(&self) -> &Matrix {
        &self.information
    }
}
