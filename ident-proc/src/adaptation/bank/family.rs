//! Members of the bank that learn from one regressor, with different forgetting factors.

use pipeline::hammerstein::{Coefficients, Nonlinearity, Structure};

use crate::{least_squares::Triangle, offline::Projection, recursive::RecursiveLeastSquares, regression::Regression};

/// Number of families.
const COUNT: usize = 5;

/// One family of members.
#[derive(Debug, Clone)]
pub struct Family {
    kind: Kind,
    members: Vec<RecursiveLeastSquares>,
    phi: Vec<f64>,
    idle: Vec<bool>,
    projection: Projection,
}

/// What a family learns, and from what.
#[derive(Debug, Clone)]
struct Kind {
    name: &'static str,
    regression: Regression,
    factors: &'static [f64],
    /// Whether regressor and target are smoothed.
    smoothed: bool,
}

/// The families of a bank for `structure`, whose rows have the structure `row`. The forms with fewer coefficients use
/// the nonlinearity `held`.
fn kinds(structure: Structure, row: &Structure, held: &Nonlinearity) -> [Kind; COUNT] {
    let increments = Structure {
        na: if structure.integrator { structure.na } else { (structure.na - 1).max(1) },
        nb: row.nb,
        integrator: true,
        ..structure
    };
    let wide = Structure { nb: row.nb, ..structure };
    let kind = |name, regression, factors| Kind { name, regression, factors, smoothed: false };
    [
        kind("linear", Regression::linear(structure, held), &[0.99]),
        kind("increments", Regression::linear(increments, held), &[0.99, 0.995]),
        kind("directional", Regression::directional(increments, held), &[0.995]),
        kind("full", Regression::full(structure), &[0.995, 0.998, 0.9998]),
        Kind { smoothed: true, ..kind("smoothed", Regression::full(wide), &[0.997, 0.9998]) },
    ]
}

impl Family {
    /// All families of a bank for `structure`, whose rows have the structure `row`. They know nothing yet.
    pub fn all(structure: Structure, row: &Structure) -> Vec<Self> {
        let unknown = Coefficients::zero(structure).nonlinearity();
        kinds(structure, row, &unknown).into_iter().map(Self::new).collect()
    }

    fn new(kind: Kind) -> Self {
        let n = kind.regression.len();
        Self {
            members: vec![RecursiveLeastSquares::new(n); kind.factors.len()],
            phi: vec![0.0; n],
            idle: vec![false; n],
            projection: Projection::new(n),
            kind,
        }
    }

    /// Gives the families of a bank for `structure` the nonlinearity that the linear forms do not learn.
    pub fn hold_nonlinearity(families: &mut [Self], structure: Structure, row: &Structure, held: &Nonlinearity) {
        for (family, kind) in families.iter_mut().zip(kinds(structure, row, held)) {
            family.kind.regression = kind.regression;
        }
    }

    /// Starts all members from offline data, given as the least-squares problem of rows of the structure `of`.
    pub fn start(&mut self, rows: &Triangle, of: &Structure) {
        let (data, held) = self.projection.project(&self.kind.regression, rows, of);
        self.members.iter_mut().for_each(|member| member.start(data, held));
    }

    /// One update of every member with y(k) and the row of sample k, or with both smoothed. A coefficient that only
    /// commands of an `idle` sign contribute to is not forgotten. Returns whether a covariance was cut at its bound.
    pub fn learn(&mut self, y: f64, row: &[f64], of: &Structure, idle: [bool; 2]) -> bool {
        let regression = &self.kind.regression;
        regression.regressor(row, of, &mut self.phi);
        let target = regression.target(y, row);
        regression.mark_idle(idle, &mut self.idle);
        let selective = self.idle.contains(&true);
        let mut bounded = false;
        for (member, factor) in self.members.iter_mut().zip(self.kind.factors) {
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

    /// Name of the family in reports.
    pub fn name(&self) -> &'static str {
        self.kind.name
    }

    /// Whether the family learns from smoothed rows.
    pub fn is_smoothed(&self) -> bool {
        self.kind.smoothed
    }

    /// Number of members.
    pub fn len(&self) -> usize {
        self.members.len()
    }

    /// The forgetting factors of the members.
    pub fn factors(&self) -> &'static [f64] {
        self.kind.factors
    }

    /// The recursion of a member.
    pub fn member(&self, member: usize) -> &RecursiveLeastSquares {
        &self.members[member]
    }

    /// Writes the coefficients of a member out for the row of the structure `of`.
    pub fn expand(&self, member: usize, of: &Structure, theta: &mut [f64]) {
        self.kind.regression.expand(self.members[member].theta(), of, theta);
    }
}
