//! The weighted sum of all members' coefficients: the model of the bank.

use pipeline::hammerstein::{Coefficients, Structure, poles_within};

use super::{family::Family, scores::Scores};
use crate::regression::write_out;

/// Members that learn nothing: the classical model, then holding still.
pub const FIXED: usize = 2;

/// Coefficients and weights of all members, the classical model first.
#[derive(Debug, Clone)]
pub struct Mixture {
    row: Structure,
    /// Coefficients of each member, written out for the row.
    members: Vec<Vec<f64>>,
    weights: Vec<f64>,
    /// The weighted sum.
    theta: Vec<f64>,
    /// Largest magnitude of a pole of a stable model: a prediction grows less than e-fold over the horizon.
    pole_limit: f64,
}

impl Mixture {
    /// For `count` models written out for the row of the structure `row`, and a horizon in samples.
    pub fn new(row: Structure, count: usize, horizon: usize) -> Self {
        let n = row.full_len();
        let mut members = vec![vec![0.0; n]; count];
        // Holding still: y(k) = y(k-1).
        members[1][0] = -1.0;
        Self { row, members, weights: vec![0.0; count], theta: vec![0.0; n], pole_limit: 1.0 + 1.0 / horizon as f64 }
    }

    /// Makes `classical` the first member, and the sum until the next [`Self::mix`].
    pub fn start(&mut self, classical: &Coefficients) {
        write_out(classical, &self.row, &mut self.members[0]);
        self.theta.copy_from_slice(&self.members[0]);
    }

    /// Writes the coefficients of all members out, or only of those that have a weight.
    pub fn write_out(&mut self, families: &[Family], all: bool) {
        let mut members = self.members[FIXED..].iter_mut().zip(&self.weights[FIXED..]);
        for family in families {
            for (member, (theta, weight)) in (0..family.len()).zip(&mut members) {
                if all || *weight > 0.0 {
                    family.expand(member, &self.row, theta);
                }
            }
        }
    }

    /// Sets the weights by the scores. An unstable member gets none.
    pub fn weigh(&mut self, scores: &Scores) {
        let (members, na, limit) = (&self.members, self.row.na, self.pole_limit);
        scores.weigh(|member| poles_within(&members[member][..na], limit), &mut self.weights);
    }

    /// Sums the members up by their weights.
    pub fn mix(&mut self) {
        self.theta.fill(0.0);
        for (theta, weight) in self.members.iter().zip(&self.weights).filter(|(_, weight)| **weight > 0.0) {
            self.theta.iter_mut().zip(theta).for_each(|(sum, coefficient)| *sum += weight * coefficient);
        }
    }

    /// Whether the sum is a stable model.
    pub fn is_stable(&self) -> bool {
        poles_within(&self.theta[..self.row.na], self.pole_limit)
    }

    /// Coefficients of all members, as they were last written out.
    pub fn members(&self) -> &[Vec<f64>] {
        &self.members
    }

    /// The weights of all members.
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// The member with the largest weight, the first of equals.
    pub fn heaviest(&self) -> usize {
        (1..self.weights.len()).fold(0, |most, i| if self.weights[i] > self.weights[most] { i } else { most })
    }

    /// The sum.
    pub fn theta(&self) -> &[f64] {
        &self.theta
    }
}
