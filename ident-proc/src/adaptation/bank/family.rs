//! Members of the bank that learn from one regressor, with different forgetting factors.

use pipeline::hammerstein::{Coefficients, Nonlinearity, Structure};

use crate::{least_squares::Triangle, offline::Projection, recursive::RecursiveLeastSquares, regression::Regression};

/// Number of families.
const COUNT: usize = 5;

/// Memory of a member in horizons, and the shortest one in samples.
///
/// What changes on a machine takes seconds, whatever the period. The errors that count are those over the horizon, so
/// that is the unit. At long periods a memory also needs samples enough for its coefficients.
type Memory = (f64, f64);

/// One family of members.
#[derive(Debug, Clone)]
pub struct Family {
    kind: Kind,
    /// Forgetting factor of each member.
    factors: Vec<f64>,
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
    memories: &'static [Memory],
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
    let kind = |name, regression, memories| Kind { name, regression, memories, smoothed: false };
    [
        kind("linear", Regression::linear(structure, held), &[(4.0, 100.0)]),
        kind("increments", Regression::linear(increments, held), &[(4.0, 100.0), (8.0, 200.0)]),
        kind("directional", Regression::directional(increments, held), &[(8.0, 200.0)]),
        kind("full", Regression::full(structure), &[(8.0, 200.0), (20.0, 500.0), (200.0, 5000.0)]),
        Kind { smoothed: true, ..kind("smoothed", Regression::full(wide), &[(13.0, 333.0), (200.0, 5000.0)]) },
    ]
}

impl Family {
    /// All families of a bank for `structure`, whose rows have the structure `row`. They know nothing yet.
    /// `horizon` in samples.
    pub fn all(structure: Structure, row: &Structure, horizon: usize) -> Vec<Self> {
        let unknown = Coefficients::zero(structure).nonlinearity();
        kinds(structure, row, &unknown).into_iter().map(|kind| Self::new(kind, horizon)).collect()
    }

    fn new(kind: Kind, horizon: usize) -> Self {
        let n = kind.regression.len();
        let samples = |(horizons, least): &Memory| (horizons * horizon as f64).max(*least);
        let factors: Vec<f64> = kind.memories.iter().map(|memory| 1.0 - 1.0 / samples(memory)).collect();
        Self {
            members: vec![RecursiveLeastSquares::new(n); factors.len()],
            factors,
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
        for (member, factor) in self.members.iter_mut().zip(&self.factors) {
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
    pub fn factors(&self) -> &[f64] {
        &self.factors
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
