//! What is known of the speeds before any sample: the commissioned ones, and how they may be expected to change.
//!
//! ```text
//! cov theta = (0.3)^2 theta theta' + d d' + diag (0.1 sum theta)^2          S_0 = (cov theta)^-1
//! ```
//!
//! theta speeds of one direction in m/s per unit of the features, d their change when the dead band moves by 0.03. So
//! all speeds of a direction change together, dead bands move, and the curve bends a little. The two directions are
//! independent.

use pipeline::{
    hammerstein::{Basis, MAX_ORDER, Structure},
    machine::Commissioned,
};

use super::matrix::{MOST, Matrix, Vector, inverse};

/// Standard deviation of the common change of a direction's speeds, in parts of them.
const SPEED_CHANGE: f64 = 0.3;
/// Standard deviation of a dead band, in parts of the command.
const DEAD_BAND_CHANGE: f64 = 0.03;
/// Standard deviation of each slope of the curve, in parts of the steepest.
const SLOPE_CHANGE: f64 = 0.1;
/// Least length of the curve's last piece, in parts of the command.
const SHORTEST_PIECE: f64 = 1e-3;

/// Expected value and information of theta before any sample.
#[derive(Debug, Clone)]
pub struct Prior {
    /// theta as commissioned.
    pub theta: Vector,
    /// S_0.
    pub information: Matrix,
}

impl Prior {
    /// From a commissioned axis, for the features of `structure`.
    pub fn new(structure: Structure, commissioned: &Commissioned) -> Self {
        let order = structure.order;
        let knots = match structure.input.basis {
            Basis::Hinges(knots) => knots,
            Basis::Powers => [0.0; MAX_ORDER],
        };
        let (low, high) = structure.input.dead_band;
        let last = commissioned.openings.last().copied().unwrap_or(1.0);
        let mut theta = [0.0; MOST];
        let mut covariance = [[0.0; MOST]; MOST];
        for (first, sign, edge) in [(0, 1.0, high), (order, -1.0, low)] {
            let speed = |opening: f64| sign * commissioned.speed(sign * (edge + opening));
            let here = slopes(&knots[..order], last, speed);
            let shifted = slopes(&knots[..order], last, |opening| speed(opening - DEAD_BAND_CHANGE));
            for i in 0..order {
                theta[first + i] = here[i];
                for j in 0..order {
                    covariance[first + i][first + j] = SPEED_CHANGE * SPEED_CHANGE * here[i] * here[j]
                        + (shifted[i] - here[i]) * (shifted[j] - here[j])
                        + if i == j { (SLOPE_CHANGE * here.iter().sum::<f64>()).powi(2) } else { 0.0 };
                }
            }
        }
        Self { theta, information: inverse(&covariance, 2 * order) }
    }
}

/// Coefficients of hinges at `knots` that meet `speed` at the knots after the first, and at `last`.
fn slopes(knots: &[f64], last: f64, speed: impl Fn(f64) -> f64) -> [f64; MAX_ORDER] {
    let mut coefficients = [0.0; MAX_ORDER];
    let (mut x, mut v, mut slope) = (knots[0], speed(knots[0]).max(0.0), 0.0);
    for i in 0..knots.len() {
        let next = knots.get(i + 1).copied().unwrap_or(last.max(knots[i] + SHORTEST_PIECE));
        let there = speed(next).max(0.0);
        let here = (there - v) / (next - x);
        coefficients[i] = here - slope;
        (x, v, slope) = (next, there, here);
    }
    coefficients
}
