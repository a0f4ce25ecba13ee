//! The prediction errors of one model over the samples after training.
//!
//! ```text
//! one step:  y(k) - phi(k)' theta(k-1)
//! h steps:   y(k) - y(k | k-h), predicted with theta(k-h), measured outputs up to k-h, the inputs as applied
//! free run:  y(k) - phi_free(k)' theta(k-1), phi_free made of the model's own outputs since the end of training
//! ```
//!
//! y output in its unit, phi regressor row (14), theta coefficients, h horizon in samples. A predictive controller uses
//! h-step predictions, and fast adaptation cannot make their error look small. Trap: the one-step error of a position
//! says next to nothing, because y(k-1) is nearly as good a prediction.

use pipeline::message::ModelErrors;

use super::forecast::Forecasts;
use crate::{
    dot,
    sample::{RegressorRow, SlidingBuffer},
};

/// The errors of one model. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct ErrorTracker {
    horizon: usize,
    ahead: Forecasts,
    /// The lane of the forecast that was launched longest ago.
    lane: usize,
    /// Number of forecasts on their way, up to `horizon`.
    launched: usize,
    /// theta(k-1), written out for the row.
    theta: Vec<f64>,
    free_run: SlidingBuffer,
    errors: ModelErrors,
}

impl ErrorTracker {
    /// For models that are written out for `row`, and a horizon of `horizon` samples.
    pub fn new(row: &RegressorRow, horizon: usize) -> Self {
        let (na, n) = (row.structure().na, row.values().len());
        Self {
            horizon,
            ahead: Forecasts::new(na, n - na, horizon),
            lane: 0,
            launched: 0,
            theta: vec![0.0; n],
            free_run: SlidingBuffer::new(na, 1),
            errors: ModelErrors::default(),
        }
    }

    /// Statistics of the errors so far.
    pub fn errors(&self) -> &ModelErrors {
        &self.errors
    }

    /// Carries all predictions on to the sample of `row`, without its output. `outputs` = y(..k-1). Returns whether an
    /// h-step prediction of that sample exists.
    pub fn pass(&mut self, row: &RegressorRow, outputs: &SlidingBuffer) -> bool {
        let na = row.structure().na;
        self.ahead.advance(row.driven());
        if self.free_run.len() < na {
            outputs.latest(na).iter().for_each(|measured| self.free_run.push(*measured));
        }
        let own: f64 = dot(&self.theta[na..], row.driven())
            - self.theta[..na].iter().zip(self.free_run.latest(na).iter().rev()).map(|(a, y)| a * y).sum::<f64>();
        self.free_run.push(own);
        self.launched == self.horizon
    }

    /// The one-step prediction of y(k) from the row of sample k.
    pub fn predict(&self, row: &RegressorRow) -> f64 {
        dot(&self.theta, row.values())
    }

    /// Takes in y(k), given its prediction by [`Self::predict`], the row of sample k and `outputs` = y(..k-1). Returns
    /// whether there was an h-step error.
    pub fn observe(&mut self, y: f64, predicted: f64, row: &RegressorRow, outputs: &SlidingBuffer) -> bool {
        let ahead = self.pass(row, outputs);
        self.errors.one_step.push(y - predicted);
        self.errors.free_run.push(y - self.free_run.latest(1)[0]);
        if ahead {
            self.errors.h_step.push(y - self.ahead.predicted(self.lane));
        }
        ahead
    }

    /// Takes in the coefficients known after sample k, written out for the row, and launches the prediction of y(k+h).
    /// `outputs` = y(..k); with fewer than na of them no prediction is launched.
    pub fn store(&mut self, theta: &[f64], outputs: &SlidingBuffer) {
        self.theta.copy_from_slice(theta);
        let na = self.ahead.na();
        if outputs.len() >= na {
            self.ahead.launch(self.lane, theta, outputs.latest(na));
            self.lane = (self.lane + 1) % self.horizon;
            self.launched = (self.launched + 1).min(self.horizon);
        }
    }

    /// Discards the predictions on their way and the model's own outputs, after a gap in the samples.
    pub fn interrupt(&mut self) {
        self.free_run.clear();
        self.launched = 0;
    }
}
