//! The rows of the training, as least-squares problems: measured, smoothed, and integrated over the horizon.
//!
//! | rows | are for |
//! |---|---|
//! | measured | the members that learn from rows as they are |
//! | smoothed | the members of the family `smoothed` |
//! | integrated | the metric in which the mixture is separated |

use super::smoothing::{INTEGRATED, Smoother};
use crate::least_squares::Triangle;

/// The rows of the training. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Collected {
    /// Rows as they were measured.
    pub measured: Triangle,
    /// Smoothed rows.
    pub smoothed: Triangle,
    /// Integrated rows.
    pub integrated: Triangle,
    integrator: Smoother,
}

impl Collected {
    /// For rows of `n` entries and a horizon in samples.
    pub fn new(n: usize, horizon: usize) -> Self {
        Self {
            measured: Triangle::new(n),
            smoothed: Triangle::new(n),
            integrated: Triangle::new(n),
            integrator: Smoother::new(n, INTEGRATED, horizon),
        }
    }

    /// Takes in y(k) and the row of a sample, and both smoothed.
    pub fn add(&mut self, y: f64, row: &[f64], smoothed: (&[f64], f64)) {
        self.measured.add(row, y);
        self.smoothed.add(smoothed.0, smoothed.1);
        self.integrator.update(y, row);
        let (row, target) = self.integrator.values();
        self.integrated.add(row, target);
    }

    /// Integrates the row of a sample after the training, which is not collected.
    pub fn integrate(&mut self, y: f64, row: &[f64]) -> &[f64] {
        self.integrator.update(y, row);
        self.integrator.values().0
    }

    /// Forgets the rows so far.
    pub fn restart(&mut self) {
        [&mut self.measured, &mut self.smoothed, &mut self.integrated].into_iter().for_each(Triangle::clear);
    }

    /// Begins anew after a gap in the samples. The rows so far stay.
    pub fn interrupt(&mut self) {
        self.integrator.interrupt();
    }
}
