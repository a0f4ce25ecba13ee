//! The prediction errors of one model over the samples after training.
//!
//! ```text
//! one step:  y(k) - phi(k)' theta(k-1)
//! h steps:   y(k) - y(k | k-h), predicted with theta(k-h), measured outputs up to k-h, the inputs as applied
//! free run:  y(k) - phi_free(k)' theta(k-1), phi_free made of the model's own outputs since the end of training
//! ```
//!
//! y output in its unit, phi regressor row (14), theta coefficients, h horizon in samples. A predictive controller uses
//! h-step predictions, and fast adaptation cannot make their error look small. A model of second order may know the
//! last increment better than by the difference of two noisy outputs; then y(k-1) less that increment takes the place
//! of y(k-2). Trap: the one-step error of a position says next to nothing, because y(k-1) is nearly as good a
//! prediction.
//!
//! At most fifty predictions over the horizon are on their way. With more samples in the horizon, an h-step error
//! counts for two, three .. samples, up to the next one.

use pipeline::{hammerstein::MAX_A, message::ModelErrors};

use super::forecast::Forecasts;
use crate::{
    dot,
    sample::{RegressorRow, SlidingBuffer},
};

/// Most forecasts on their way at any time. Errors of forecasts any closer together are nearly equal, and a horizon of
/// 500 samples would make them most of the work of an update.
const FORECASTS: usize = 50;

/// The errors of one model. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct ErrorTracker {
    horizon: usize,
    ahead: Forecasts,
    lanes: usize,
    /// Samples between two launches.
    stride: usize,
    /// Samples since the first launch; `None` before it.
    since: Option<usize>,
    /// The newest h-step error since the first launch.
    newest: Option<f64>,
    /// theta(k-1), written out for the row.
    theta: Vec<f64>,
    /// y(k-1) - y(k-2), where the model knows it better than by their difference.
    increment: Option<f64>,
    free_run: SlidingBuffer,
    errors: ModelErrors,
}

impl ErrorTracker {
    /// For models that are written out for `row`, and a horizon of `horizon` samples.
    pub fn new(row: &RegressorRow, horizon: usize) -> Self {
        let (na, n) = (row.structure().na, row.values().len());
        let stride = horizon.div_ceil(FORECASTS);
        let lanes = horizon.div_ceil(stride);
        Self {
            horizon,
            ahead: Forecasts::new(na, n - na, lanes),
            lanes,
            stride,
            since: None,
            newest: None,
            theta: vec![0.0; n],
            increment: None,
            free_run: SlidingBuffer::new(na, 1),
            errors: ModelErrors::default(),
        }
    }

    /// Statistics of the errors so far.
    pub fn errors(&self) -> &ModelErrors {
        &self.errors
    }

    /// Carries all predictions on to the sample of `row`, without its output. `outputs` = y(..k-1). Returns the h-step
    /// prediction of that sample, if one was launched h samples ago.
    pub fn pass(&mut self, row: &RegressorRow, outputs: &SlidingBuffer) -> Option<f64> {
        let na = row.structure().na;
        self.ahead.advance(row.driven());
        if self.free_run.len() < na {
            start(outputs, na, self.increment)[..na].iter().for_each(|y| self.free_run.push(*y));
        }
        let own: f64 = dot(&self.theta[na..], row.driven())
            - self.theta[..na].iter().zip(self.free_run.latest(na).iter().rev()).map(|(a, y)| a * y).sum::<f64>();
        self.free_run.push(own);
        let since = self.since.as_mut()?;
        *since += 1;
        let launched = since.checked_sub(self.horizon)?;
        let lane = launched / self.stride % self.lanes;
        launched.is_multiple_of(self.stride).then(|| self.ahead.predicted(lane))
    }

    /// The one-step prediction of y(k) from the row of sample k.
    pub fn predict(&self, row: &RegressorRow) -> f64 {
        let values = row.values();
        let smoothed = self.increment.map_or(0.0, |increment| self.theta[1] * (values[0] + increment - values[1]));
        dot(&self.theta, values) + smoothed
    }

    /// Takes in y(k), given its prediction by [`Self::predict`], the row of sample k and `outputs` = y(..k-1). Returns
    /// whether there was an h-step error.
    pub fn observe(&mut self, y: f64, predicted: f64, row: &RegressorRow, outputs: &SlidingBuffer) -> bool {
        let ahead = self.pass(row, outputs);
        self.errors.one_step.push(y - predicted);
        self.errors.free_run.push(y - self.free_run.latest(1)[0]);
        self.newest = ahead.map(|predicted| y - predicted).or(self.newest);
        if let Some(error) = self.newest {
            self.errors.h_step.push(error);
        }
        self.newest.is_some()
    }

    /// Takes in the coefficients known after sample k, written out for the row, and launches the prediction of y(k+h)
    /// where one is due. `outputs` = y(..k); with fewer than na of them no prediction is launched.
    pub fn store(&mut self, theta: &[f64], increment: Option<f64>, outputs: &SlidingBuffer) {
        self.theta.copy_from_slice(theta);
        self.increment = increment;
        let na = self.ahead.na();
        if outputs.len() < na {
            return;
        }
        let since = *self.since.get_or_insert(0);
        if since.is_multiple_of(self.stride) {
            let lane = since / self.stride % self.lanes;
            self.ahead.launch(lane, theta, &start(outputs, na, increment)[..na]);
        }
    }

    /// Discards the predictions on their way and the model's own outputs, after a gap in the samples.
    pub fn interrupt(&mut self) {
        self.free_run.clear();
        (self.since, self.newest, self.increment) = (None, None, None);
    }
}

/// The newest `na` outputs, oldest first, for a prediction to start from; the last but one is by this increment before
/// the last one.
fn start(outputs: &SlidingBuffer, na: usize, increment: Option<f64>) -> [f64; MAX_A] {
    let mut start = [0.0; MAX_A];
    start[..na].copy_from_slice(outputs.latest(na));
    if let Some(increment) = increment {
        start[na - 2] = start[na - 1] - increment;
    }
    start
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::hammerstein::Structure;

    /// y(k) = 0.5 y(k-1) + u(k-1).
    const STRUCTURE: Structure = Structure { na: 1, nb: 0, nk: 1, order: 1, ..Structure::PAPER };

    #[test]
    fn with_a_long_horizon_every_error_counts_for_the_samples_up_to_the_next_one() {
        const HORIZON: usize = 2 * FORECASTS + 20;
        let mut row = RegressorRow::new(STRUCTURE);
        let mut tracker = ErrorTracker::new(&row, HORIZON);
        let (mut outputs, mut commands) = (SlidingBuffer::new(1, 1), SlidingBuffer::new(1, 2));
        let mut y = 1.0;
        outputs.push(y);
        // b is half as large again as it is.
        tracker.store(&[-0.5, 1.5, 1.5], None, &outputs);
        for k in 1..=400 {
            commands.push_with(|slot| STRUCTURE.input.features(0.2, slot));
            row.fill(&outputs, &commands);
            y = 0.5 * y + 0.2;
            let predicted = tracker.predict(&row);
            assert_eq!(tracker.observe(y, predicted, &row, &outputs), k >= HORIZON, "{k}");
            outputs.push(y);
            tracker.store(&[-0.5, 1.5, 1.5], None, &outputs);
        }
        let errors = tracker.errors();
        assert_eq!((errors.one_step.count, errors.h_step.count), (400, 401 - HORIZON as u64));
        // -0.1 (1 + 0.5 + 0.25 + ..).
        assert!((errors.h_step.mean + 0.2).abs() < 1e-12 && errors.h_step.sigma() < 1e-12);
    }

    /// y(k) = 1.9 y(k-1) - 0.9 y(k-2): the increment shrinks by a tenth.
    #[test]
    fn a_prediction_starts_from_the_increment_that_the_model_knows() {
        const THETA: [f64; 4] = [-1.9, 0.9, 0.0, 0.0];
        let structure = Structure { na: 2, ..STRUCTURE };
        let error = |increment: Option<f64>| {
            let mut row = RegressorRow::new(structure);
            let mut tracker = ErrorTracker::new(&row, 3);
            let (mut outputs, mut commands) = (SlidingBuffer::new(2, 1), SlidingBuffer::new(1, 2));
            // A count of 0.01 is missing before the last output.
            [-1.01, 0.0].into_iter().for_each(|y| outputs.push(y));
            tracker.store(&THETA, increment, &outputs);
            let mut y = 0.0;
            for k in 1..=3 {
                commands.push_with(|slot| structure.input.features(0.0, slot));
                row.fill(&outputs, &commands);
                y += 0.9f64.powi(k);
                let predicted = tracker.predict(&row);
                tracker.observe(y, predicted, &row, &outputs);
                outputs.push(y);
                tracker.store(&THETA, increment.map(|_| 0.9f64.powi(k)), &outputs);
            }
            let errors = tracker.errors();
            [errors.one_step.max, errors.h_step.max, errors.free_run.max]
        };
        assert!(error(Some(1.0)).iter().all(|error| *error < 1e-12));
        let expected = [0.009, 0.009 * 2.71, 0.009 * 2.71];
        assert!(error(None).iter().zip(expected).all(|(error, expected)| (error - expected).abs() < 1e-12));
    }
}
