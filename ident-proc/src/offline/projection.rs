//! The offline problem of one form, from the rows of a larger one, ready to start a recursion from.

use pipeline::hammerstein::Structure;

use crate::{least_squares::RankGuard, least_squares::Triangle, regression::Regression};

/// Projects, and holds what the rows cannot tell apart; its memory is taken at construction.
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

    /// The problem of `regression` from that of rows of the structure `of`, and which coefficients are held at zero.
    pub fn project(&mut self, regression: &Regression, rows: &Triangle, of: &Structure) -> (&Triangle, &[bool]) {
        regression.project(rows, of, &mut self.projected);
        let held = self.guard.dependent(&self.projected);
        self.projected.hold_into(held, &mut self.restricted);
        (&self.restricted, held)
    }
}
