//! The predictions of a model over a whole record.
//!
//! ```text
//! one step:  y(k | k-1)      measured outputs up to k-1
//! h steps:   y(k | k-h)      measured outputs up to k-h, the model's own after, the commands as applied
//! free run:  measured outputs up to the first row that has enough of them before it, the model's own after
//! ```
//!
//! y output in its unit, h horizon in samples. All of them are eq. (12), with [`Coefficients::predict_one`]. A
//! prediction never uses samples from both sides of a gap.

use std::ops::Range;

use pipeline::{
    hammerstein::{Coefficients, MAX_A},
    message::ModelErrors,
    statistics::ErrorStatistics,
};

/// A record, row by row.
#[derive(Debug, Clone, Copy)]
pub struct Samples<'a> {
    /// Commands u(k).
    pub inputs: &'a [f64],
    /// Outputs y(k).
    pub outputs: &'a [f64],
    /// Whether a gap is before row k; true for the first row.
    pub begins: &'a [bool],
}

impl Samples<'_> {
    /// The rows of each stretch without a gap, as ranges.
    pub fn stretches(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        stretches(self.begins)
    }
}

/// The rows of each stretch without a gap, as ranges.
pub fn stretches(begins: &[bool]) -> impl Iterator<Item = Range<usize>> + '_ {
    begins.chunk_by(|_, next| !next).scan(0, |end, stretch| {
        let start = *end;
        *end += stretch.len();
        Some(start..*end)
    })
}

/// Number of samples that a prediction needs: na outputs, nk + nb commands.
pub fn memory(model: &Coefficients) -> usize {
    (model.na as usize).max((model.nk + model.nb) as usize)
}

/// The last of the outputs that (12) gives from `outputs` = y(..k), oldest first and at least na of them, and the
/// values `x` of N from x(k+1-nk-nb) on, in the order of time. There are as many steps as `x` has values more than nb.
pub fn ahead(model: &Coefficients, outputs: &[f64], x: &[f64]) -> f64 {
    let (na, lags) = (model.a().len(), model.b().len());
    let mut past = [0.0; MAX_A];
    past.iter_mut().zip(outputs.iter().rev().take(na)).for_each(|(past, y)| *past = *y);
    let mut newest_first = [0.0; pipeline::hammerstein::MAX_LINEAR];
    for x in x.windows(lags) {
        newest_first.iter_mut().zip(x.iter().rev()).for_each(|(to, x)| *to = *x);
        let y = model.predict_one(&past, &newest_first);
        past.copy_within(0..MAX_A - 1, 1);
        past[0] = y;
    }
    past[0]
}

/// The predictions of one model at each row; NaN where there is none.
#[derive(Debug, Clone)]
pub struct Predictions {
    /// y(k | k-1).
    pub one_step: Vec<f64>,
    /// y(k | k-h).
    pub h_step: Vec<f64>,
    /// The free run.
    pub free_run: Vec<f64>,
}

impl Predictions {
    /// The predictions of a model that is held. `horizon` in samples, at least 1.
    pub fn new(model: &Coefficients, samples: Samples<'_>, horizon: usize) -> Self {
        let rows = samples.outputs.len();
        let none = vec![f64::NAN; rows];
        let mut all = Self { one_step: none.clone(), h_step: none.clone(), free_run: none };
        let nonlinearity = model.nonlinearity();
        let x: Vec<f64> = samples.inputs.iter().map(|u| nonlinearity.evaluate(*u)).collect();
        let reach = (model.nk + model.nb) as usize;
        let delay = model.nk as usize;
        for stretch in samples.stretches() {
            let first = stretch.start + memory(model);
            for k in first..stretch.end {
                // The prediction of row k + steps - 1 from the outputs before row k.
                let from = |steps: usize| ahead(model, &samples.outputs[..k], &x[k - reach..k + steps - delay]);
                all.one_step[k] = from(1);
                if k + horizon <= stretch.end {
                    all.h_step[k + horizon - 1] = from(horizon);
                }
            }
            if first < stretch.end {
                let mut own = samples.outputs[stretch.start..first].to_vec();
                for k in first..stretch.end {
                    own.push(ahead(model, &own, &x[k - reach..=k - delay]));
                }
                all.free_run[first..stretch.end].copy_from_slice(&own[first - stretch.start..]);
            }
        }
        all
    }

    /// The errors of all predictions that exist.
    pub fn errors(&self, outputs: &[f64]) -> ModelErrors {
        let of = |predicted: &[f64]| statistics(outputs.iter().zip(predicted).map(|(y, predicted)| y - predicted));
        ModelErrors { one_step: of(&self.one_step), h_step: of(&self.h_step), free_run: of(&self.free_run) }
    }
}

/// The errors of holding still for `horizon` samples, at the rows of `predicted` that have a prediction.
pub fn still(predicted: &[f64], outputs: &[f64], horizon: usize) -> ErrorStatistics {
    let rows = predicted.iter().enumerate().skip(horizon).filter(|(_, predicted)| !predicted.is_nan());
    statistics(rows.map(|(k, _)| outputs[k] - outputs[k - horizon]))
}

/// The statistics of the values that are numbers. An infinite one counts.
pub fn statistics(values: impl Iterator<Item = f64>) -> ErrorStatistics {
    let mut all = ErrorStatistics::default();
    values.filter(|value| !value.is_nan()).for_each(|value| all.push(value));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(rows: usize) -> (Vec<f64>, Vec<f64>, Vec<bool>) {
        let inputs: Vec<f64> = (0..rows).map(|k| (0.3 * k as f64).sin()).collect();
        let outputs = (0..rows).map(|k| (0.11 * k as f64).cos()).collect();
        (inputs, outputs, (0..rows).map(|k| k == 0 || k == 40).collect())
    }

    #[test]
    fn predictions_are_those_of_the_difference_equation() {
        let model = Coefficients { nk: 2, drift: 0.01, ..Coefficients::TABLE_2 };
        let (inputs, outputs, begins) = record(90);
        let samples = Samples { inputs: &inputs, outputs: &outputs, begins: &begins };
        let predictions = Predictions::new(&model, samples, 5);
        // The prediction of row k + 4 from the outputs up to k - 1.
        let k = 60;
        let newest_first: Vec<f64> = outputs[..k].iter().rev().copied().collect();
        let mut predicted = [0.0; 5];
        model.predict(&newest_first, &inputs[k - 3..], &mut predicted);
        assert_eq!(predictions.one_step[k], predicted[0]);
        assert_eq!(predictions.h_step[k + 4], predicted[4]);
        // A free run starts after the gap from the first rows that are enough.
        assert_eq!(predictions.free_run[43], predictions.one_step[43]);
        assert_ne!(predictions.free_run[44], predictions.one_step[44]);
    }

    #[test]
    fn nothing_is_predicted_over_a_gap() {
        let (inputs, outputs, begins) = record(90);
        let samples = Samples { inputs: &inputs, outputs: &outputs, begins: &begins };
        let predictions = Predictions::new(&Coefficients::TABLE_2, samples, 5);
        let known = |values: &[f64]| (0..90).filter(|k| !values[*k].is_nan()).collect::<Vec<_>>();
        assert_eq!(known(&predictions.one_step), (3..40).chain(43..90).collect::<Vec<_>>());
        assert_eq!(known(&predictions.h_step), (7..40).chain(47..90).collect::<Vec<_>>());
        assert_eq!(known(&predictions.free_run), known(&predictions.one_step));
        let still = still(&predictions.h_step, &outputs, 5);
        assert_eq!(still.count, 76);
        let short = Samples { inputs: &inputs[..2], outputs: &outputs[..2], begins: &begins[..2] };
        assert!(Predictions::new(&Coefficients::TABLE_2, short, 5).one_step.iter().all(|y| y.is_nan()));
    }
}
