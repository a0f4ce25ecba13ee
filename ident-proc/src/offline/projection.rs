//! The offline problem of one form of the regression, made from the rows of a larger form. A recursive estimator starts
//! from it.

use pipeline::hammerstein::Structure;

use crate::{
    least_squares::{RankGuard, Triangle},
    regression::Regression,
};

/// Projects the rows and holds what they do not determine. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Projection {
    projected: Triangle,
    restricted: Triangle,
    guard: RankGuard,
}

impl Projection {
    /// For `n` coefficients.
    pub fn new(n: usize) -> Self {
        Self { projected: Triangle::new(n), restricted: Triangle::new(n), guard: RankGuard::new(n) }
    }

    /// The problem of `regression` from `rows` of the structure `of`, and which coefficients are held at zero.
    pub fn project(&mut self, regression: &Regression, rows: &Triangle, of: &Structure) -> (&Triangle, &[bool]) {
        regression.project(rows, of, &mut self.projected);
        let held = self.guard.dependent(&self.projected);
        self.projected.hold_into(held, &mut self.restricted);
        (&self.restricted, held)
    }
}
