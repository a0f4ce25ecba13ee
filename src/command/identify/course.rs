//! Follows a record once more, with the models and predictions of every row. Only `--report` and `--csv` need it.
//!
//! The predictions are those of the models as they are published, with the outputs that the estimator has used: the
//! output of an outlier is replaced by the median of its predictions one step ahead and of the output before it. With
//! `--velocity` the models are those of the position, and so are the predictions.

use std::ops::Range;

use ident_proc::Identifier;
use pipeline::{
    hammerstein::Coefficients,
    machine::Identification,
    message::{AxisSnapshot, model_fault},
};

use super::record::Record;
use crate::model::prediction::{ahead, memory};

/// The predictions of one model at each row; NaN where there is none.
#[derive(Debug, Clone)]
pub struct Predicted {
    /// y(k | k-1).
    pub one_step: Vec<f64>,
    /// y(k | k-h).
    pub h_step: Vec<f64>,
}

/// All predictions.
#[derive(Debug, Clone)]
pub struct Course {
    /// Of the adaptive model.
    pub adaptive: Predicted,
    /// Of the classical model, which is held.
    pub held: Predicted,
    /// The outputs as they were used: those of outliers are replaced.
    pub used: Vec<f64>,
    horizon: usize,
}

/// What is known at one row, after it was taken in.
pub struct Moment<'a> {
    /// Index of the row.
    pub row: usize,
    /// The identifier.
    pub identifier: &'a Identifier,
    /// Its snapshot.
    pub snapshot: &'a AxisSnapshot,
    /// Predictions so far, also those of this row.
    pub course: &'a Course,
}

impl Moment<'_> {
    /// Whether there is a model.
    pub fn is_trained(&self) -> bool {
        self.snapshot.faults & model_fault::TRAINING == 0
    }
}

impl Course {
    /// Follows the record; `visit` sees every row.
    ///
    /// # Errors
    /// That of `visit`, which ends the course.
    pub fn follow<E>(
        settings: &Identification,
        record: &Record,
        mut visit: impl FnMut(&Moment<'_>) -> Result<(), E>,
    ) -> Result<Self, E> {
        let rows = record.outputs.len();
        let none = || Predicted { one_step: vec![f64::NAN; rows], h_step: vec![f64::NAN; rows] };
        let mut course =
            Self { adaptive: none(), held: none(), used: record.outputs.clone(), horizon: settings.horizon };
        let mut identifier = Identifier::new(settings);
        let mut x = Vec::new();
        for mut stretch in record.stretches() {
            for k in stretch.clone() {
                let applied = (!record.begins[k]).then(|| record.inputs[k - 1]);
                identifier.update(Some(record.outputs[k]), applied);
                let snapshot = identifier.snapshot();
                let is_outlier = snapshot.faults & model_fault::OUTLIER != 0;
                if is_outlier && course.adaptive.one_step[k].is_finite() {
                    course.used[k] = course.expected(k);
                }
                let is_step = snapshot.faults & model_fault::SAMPLE_SKIPPED != 0 && !is_outlier;
                if is_step && k >= stretch.start + memory(&snapshot.adaptive) {
                    // The estimator has believed a step of the output, and combines nothing over it.
                    stretch.start = k;
                    course.discard(k);
                }
                visit(&Moment { row: k, identifier: &identifier, snapshot: &snapshot, course: &course })?;
                if snapshot.faults & model_fault::TRAINING == 0 {
                    let Self { used, horizon, .. } = &course;
                    let from = |model: &Coefficients, x: &mut Vec<f64>| {
                        launch(model, &record.inputs, (used, k), (&stretch, *horizon), x)
                    };
                    let (adaptive, held) = (from(&snapshot.adaptive, &mut x), from(&snapshot.classical, &mut x));
                    course.adaptive.store(k, settings.horizon, adaptive);
                    course.held.store(k, settings.horizon, held);
                }
            }
        }
        Ok(course)
    }
}

impl Course {
    /// Discards the predictions on their way to rows from k on.
    fn discard(&mut self, k: usize) {
        let end = (k + self.horizon).min(self.used.len());
        for of in [&mut self.adaptive, &mut self.held] {
            of.one_step[k] = f64::NAN;
            of.h_step[k..end].fill(f64::NAN);
        }
    }

    /// What stands in the place of an outlier in row k.
    fn expected(&self, k: usize) -> f64 {
        let mut predictions = [self.adaptive.one_step[k], self.held.one_step[k], self.used[k - 1]];
        predictions.sort_by(f64::total_cmp);
        predictions[1]
    }

    /// The outputs minus what was predicted; NaN where there is no prediction, and for outliers.
    pub fn residuals(&self, outputs: &[f64], predicted: &[f64]) -> Vec<f64> {
        let residual = |((y, used), predicted): ((&f64, &f64), &f64)| if y == used { y - predicted } else { f64::NAN };
        outputs.iter().zip(&self.used).zip(predicted).map(residual).collect()
    }
}

impl Predicted {
    fn store(&mut self, k: usize, horizon: usize, [one_step, h_step]: [Option<f64>; 2]) {
        if let Some(one_step) = one_step {
            self.one_step[k + 1] = one_step;
        }
        if let Some(h_step) = h_step {
            self.h_step[k + horizon] = h_step;
        }
    }
}

/// The predictions of y(k+1) and y(k+h) from the outputs up to k, where their rows are in the stretch.
fn launch(
    model: &Coefficients,
    inputs: &[f64],
    (outputs, k): (&[f64], usize),
    (stretch, horizon): (&Range<usize>, usize),
    x: &mut Vec<f64>,
) -> [Option<f64>; 2] {
    if k + 1 < stretch.start + memory(model) || k + 1 >= stretch.end {
        return [None; 2];
    }
    let steps = if k + horizon < stretch.end { horizon } else { 1 };
    let (nk, nb) = (model.nk as usize, model.nb as usize);
    let nonlinearity = model.nonlinearity();
    x.clear();
    x.extend(inputs[k + 1 - nk - nb..=k + steps - nk].iter().map(|u| nonlinearity.evaluate(*u)));
    let outputs = &outputs[..=k];
    let one_step = ahead(model, outputs, &x[..=nb]);
    [Some(one_step), (k + horizon < stretch.end).then(|| ahead(model, outputs, x))]
}
