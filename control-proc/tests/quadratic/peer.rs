//! The same programme for Clarabel: `A x + s = b`, s in the cones, one inequality for every limit that is finite.

use clarabel::{
    algebra::CscMatrix,
    solver::{DefaultSettings, DefaultSolver, SupportedConeT},
};
use control_proc::predictive::quadratic::Problem;

pub struct Form {
    pub p: CscMatrix<f64>,
    pub q: Vec<f64>,
    pub a: CscMatrix<f64>,
    pub b: Vec<f64>,
    cones: Vec<SupportedConeT<f64>>,
}

impl Form {
    pub fn new<const N: usize, const M: usize>(problem: &Problem<N, M>) -> Self {
        let (mut equal, mut unequal) = (Vec::new(), Vec::new());
        let mut limit = |row: &[f64; N], lower: f64, upper: f64| {
            if lower == upper {
                equal.push((*row, upper));
            } else {
                if upper.is_finite() {
                    unequal.push((*row, upper));
                }
                if lower.is_finite() {
                    unequal.push((row.map(|c| -c), -lower));
                }
            }
        };
        for i in 0..N {
            let mut row = [0.0; N];
            row[i] = 1.0;
            limit(&row, problem.lower[i], problem.upper[i]);
        }
        for (k, row) in problem.rows.iter().enumerate() {
            limit(row, problem.row_lower[k], problem.row_upper[k]);
        }
        let cones = vec![SupportedConeT::ZeroConeT(equal.len()), SupportedConeT::NonnegativeConeT(unequal.len())];
        equal.append(&mut unequal);
        let (mut p, mut a) = (Sparse::default(), Sparse::default());
        for i in 0..N {
            (0..=i).for_each(|k| p.push(k, problem.hessian[k][i]));
            p.end_column();
            equal.iter().enumerate().filter(|(_, (row, _))| row[i] != 0.0).for_each(|(k, (row, _))| a.push(k, row[i]));
            a.end_column();
        }
        Self {
            p: p.matrix(N),
            q: problem.gradient.to_vec(),
            a: a.matrix(equal.len()),
            b: equal.iter().map(|(_, b)| *b).collect(),
            cones,
        }
    }

    pub fn solver(&self, settings: DefaultSettings<f64>) -> DefaultSolver<f64> {
        DefaultSolver::new(&self.p, &self.q, &self.a, &self.b, &self.cones, settings).expect("a programme")
    }
}

#[derive(Default)]
struct Sparse {
    ends: Vec<usize>,
    places: Vec<usize>,
    values: Vec<f64>,
}

impl Sparse {
    fn push(&mut self, place: usize, value: f64) {
        self.places.push(place);
        self.values.push(value);
    }

    fn end_column(&mut self) {
        self.ends.push(self.places.len());
    }

    fn matrix(mut self, rows: usize) -> CscMatrix<f64> {
        let columns = self.ends.len();
        self.ends.insert(0, 0);
        CscMatrix::new(rows, columns, self.ends, self.places, self.values)
    }
}

/// Settings with every tolerance at `tolerance`, and without what would forbid new data.
pub fn settings(tolerance: f64) -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        presolve_enable: false,
        tol_gap_abs: tolerance,
        tol_gap_rel: tolerance,
        tol_feas: tolerance,
        ..DefaultSettings::default()
    }
}
