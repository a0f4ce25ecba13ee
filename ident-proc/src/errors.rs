//! The errors of one model over the samples after training.
//!
//! ```text
//! one step:  y(k) - phi(k)' theta(k-1)
//! h steps:   y(k) - y(k | k-h), predicted with theta(k-h), measured outputs up to k-h, the inputs as applied
//! free run:  y(k) - phi_free(k)' theta(k-1), phi_free made of the model's own outputs since the end of training
//! ```
//!
//! The h-step error is what a predictive controller consumes, and fast adaptation cannot flatter it. Trap: the
//! one-step error of a position says next to nothing; y(k-1) is nearly as good.

use pipeline::{hammerstein::Structure, message::ModelErrors};

use crate::{history::History, regression::Regression};

/// Follows one model; its memory is taken at construction.
#[derive(Debug, Clone)]
pub struct ErrorTracker {
    horizon: usize,
    /// theta of the last `horizon` samples, a ring.
    past: Vec<f64>,
    at: usize,
    stored: usize,
    path: Vec<f64>,
    free_run: History,
    errors: ModelErrors,
}

impl ErrorTracker {
    /// For a model of `n` coefficients and a horizon of `horizon` samples.
    pub fn new(structure: Structure, n: usize, horizon: usize) -> Self {
        Self {
            horizon,
            past: vec![0.0; n * horizon],
            at: 0,
            stored: 0,
            path: vec![0.0; structure.past_outputs() + horizon],
            free_run: History::new(structure.past_outputs(), 1),
            errors: ModelErrors::default(),
        }
    }

    /// The errors so far.
    pub fn errors(&self) -> &ModelErrors {
        &self.errors
    }

    /// Takes in the coefficients known after a sample.
    pub fn store(&mut self, theta: &[f64]) {
        self.past[self.at * theta.len()..(self.at + 1) * theta.len()].copy_from_slice(theta);
        self.at = (self.at + 1) % self.horizon;
        self.stored = (self.stored + 1).min(self.horizon);
    }

    /// Takes in y(k) given `theta` = theta(k-1), `outputs` = y(..k-1) and `commands` = features of u(..k-1).
    ///
    /// Needs the histories to hold what a one-step prediction needs; the h-step error waits until they hold more.
    /// Returns whether there was an h-step error.
    pub fn observe(
        &mut self,
        y: f64,
        theta: &[f64],
        regression: &Regression,
        outputs: &History,
        commands: &History,
    ) -> bool {
        let Structure { nb, nk, .. } = regression.structure();
        let (h, past) = (self.horizon, regression.structure().past_outputs());
        self.errors.one_step.push(y - regression.predict_one(theta, outputs, commands));

        if self.free_run.len() < past {
            outputs.latest(past).iter().for_each(|measured| self.free_run.push(*measured));
        }
        let own = regression.predict_one(theta, &self.free_run, commands);
        self.free_run.push(own);
        self.errors.free_run.push(y - own);

        // With all slots filled, the next one to be overwritten holds theta(k-h).
        let ahead = self.stored == h && outputs.len() >= past + h - 1 && commands.len() >= nk + nb + h - 1;
        if ahead {
            let then = &self.past[self.at * theta.len()..(self.at + 1) * theta.len()];
            let predicted = regression.predict_ahead(then, h, outputs, commands, &mut self.path);
            self.errors.h_step.push(y - predicted);
        }
        ahead
    }

    /// After a gap in the samples the model's own outputs are worth nothing: the free run starts again.
    pub fn interrupt(&mut self) {
        self.free_run.clear();
    }
}
