//! Members of the bank that learn from the same regressor, with different forgetting factors.

use pipeline::hammerstein::Structure;

use crate::{least_squares::Triangle, offline::Projection, recursive::RecursiveLeastSquares, regression::Regression};

/// What one family learns from.
#[derive(Debug, Clone)]
pub struct Family {
    name: &'static str,
    smoothed: bool,
    regression: Regression,
    factors: &'static [f64],
    members: Vec<RecursiveLeastSquares>,
    phi: Vec<f64>,
    idle: Vec<bool>,
    projection: Projection,
}

impl Family {
    /// One member for each of the forgetting `factors`; nothing is known yet.
    pub fn new(name: &'static str, regression: Regression, factors: &'static [f64]) -> Self {
        let n = regression.len();
        Self {
            name,
            smoothed: name == super::SMOOTHED,
            regression,
            factors,
            members: vec![RecursiveLeastSquares::new(n); factors.len()],
            phi: vec![0.0; n],
            idle: vec![false; n],
            projection: Projection::new(n),
        }
    }

    /// Starts all members from offline data, given as the least-squares problem of rows of the structure `of`.
    pub fn start(&mut self, regression: Regression, rows: &Triangle, of: &Structure) {
        self.regression = regression;
        let (data, held) = self.projection.project(&self.regression, rows, of);
        self.members.iter_mut().for_each(|member| member.start(data, held));
    }

    /// One update of every member with y(k) and the row of sample k, or with both smoothed. What only commands of an
    /// `idle` sign contribute to is not forgotten. Returns whether a covariance was cut at its bound.
    pub fn learn(&mut self, y: f64, row: &[f64], of: &Structure, idle: [bool; 2]) -> bool {
        self.regression.regressor(row, of, &mut self.phi);
        let target = self.regression.target(y, row);
        self.regression.mark_idle(idle, &mut self.idle);
        let selective = self.idle.contains(&true);
        let mut bounded = false;
        for (member, factor) in self.members.iter_mut().zip(self.factors) {
            let factor = if selective {
                bounded |= member.forget_selectively(*factor, &self.idle);
                1.0
            } else {
                *factor
            };
            bounded |= member.update(&self.phi, target, factor).bounded;
        }
        bounded
    }

    /// What it is called.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Whether regressor and target are smoothed.
    pub fn is_smoothed(&self) -> bool {
        self.smoothed
    }

    /// Number of members.
    pub fn len(&self) -> usize {
        self.members.len()
    }

    /// The forgetting factors of the members.
    pub fn factors(&self) -> &'static [f64] {
        self.factors
    }

    /// The estimator of a member.
    pub fn member(&self, member: usize) -> &RecursiveLeastSquares {
        &self.members[member]
    }

    /// Writes the coefficients of a member out for the row of the structure `of`.
    pub fn expand(&self, member: usize, of: &Structure, theta: &mut [f64]) {
        self.regression.expand(self.members[member].theta(), of, theta);
    }
}
