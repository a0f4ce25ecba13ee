//! Judges a structure on the training part of a record: it is fitted on the first rows and judged on the held-out rest.
//!
//! ```text
//! h steps:   y(k) - y(k | k-h), at every (h / 4)-th held-out row
//! free run:  y(k) from measured outputs before its start only, up to the last held-out row; one starts at each quarter
//! AIC = N ln(S / N) + 2 (p + 1),    BIC = N ln(S / N) + (p + 1) ln N
//! ```
//!
//! N: rows of the fit; S: sum of squared one-step errors over them; p: parameters.
//!
//! Trap: AIC and BIC are shown, but the choice does not use them. The one-step error of a position is almost without
//! information, and more coefficients always lower it.

use ident_proc::{
    offline::Batch,
    sample::{RegressorRow, SlidingBuffer},
    validation::criteria,
};
use pipeline::{
    hammerstein::{Coefficients, MAX_A, MAX_LINEAR, Structure},
    machine::{Identification, Split},
    statistics::ErrorStatistics,
};
use serde::Serialize;

use super::record::Record;

/// Part of the training rows on which structures are fitted.
pub const FIT_PART: f64 = 0.7;
/// Starts of an h-step prediction per horizon.
const STARTS_PER_HORIZON: usize = 4;
/// Number of free runs. They start at equally distant rows, because a single one may fit the record by chance.
const FREE_RUNS: usize = 4;
/// Fewest horizons in the held-out rows.
const FEWEST_HORIZONS: usize = 2;
/// Fewest rows of the fit for each coefficient of a structure.
const ROWS_PER_COEFFICIENT: usize = 2;
/// The longest delay is at most the rows of the fit divided by this number.
const DELAY_PART: usize = 8;
/// Longest delay that is searched, samples: the time of a search grows with it.
const LONGEST_SEARCHED: usize = 64;
/// Errors below this part of the standard deviation of the output are rounding errors and count as equal.
const NEGLIGIBLE: f64 = 1e-6;

/// The training part, divided into rows of the fit and held-out rows.
#[derive(Debug)]
pub struct HeldOut<'a> {
    inputs: &'a [f64],
    /// The identified signal: the output, or its velocity, whose first value is not known.
    outputs: Vec<f64>,
    /// Rows between the gap before a row and the row.
    ages: Vec<usize>,
    /// Smallest age of a row that is predicted.
    first: usize,
    fit: usize,
    horizon: usize,
    split: Split,
    negligible: f64,
}

/// A structure with its errors and criteria.
#[derive(Debug, Clone, Serialize)]
pub struct Candidate {
    /// Orders and options.
    pub structure: Structure,
    /// Number of parameters that the data determine: coefficients of the separated model, without f_1 = 1, and edges of
    /// the dead band.
    pub parameters: usize,
    /// Root mean square of the h-step error over the held-out rows.
    pub h_step_rmse: f64,
    /// Root mean square of the error of the free run over the held-out rows.
    pub free_run_rmse: f64,
    /// Geometric mean of both errors, each divided by that of the first structure.
    pub score: f64,
    /// Akaike's criterion over the rows of the fit.
    pub aic: f64,
    /// Bayesian criterion over the rows of the fit.
    pub bic: f64,
    /// Whether the rows of the fit do not determine every coefficient. Those that are not determined are zero.
    pub rank_deficient: bool,
    /// Whether a free run grows by more than a factor e over the held-out rows, or is not finite.
    pub unstable: bool,
}

impl<'a> HeldOut<'a> {
    /// Divides the training part of a record.
    pub fn new(settings: &Identification, record: &'a Record) -> Self {
        let inputs = &record.inputs[..settings.training];
        let ages: Vec<usize> = record.stretches().flat_map(|rows| 0..rows.len()).take(settings.training).collect();
        let mut outputs = record.identified(settings.output);
        outputs.truncate(settings.training);
        let fit = fit_rows(settings.training);
        let mut spread = ErrorStatistics::default();
        outputs[fit..].iter().filter(|y| y.is_finite()).for_each(|y| spread.push(*y));
        Self {
            inputs,
            outputs,
            ages,
            first: first_row(fit, settings.structure.nk),
            fit,
            horizon: settings.horizon,
            split: settings.split,
            negligible: NEGLIGIBLE * spread.sigma(),
        }
    }

    /// Fewest training rows that can be divided for these settings.
    pub fn fewest_rows(settings: &Identification) -> usize {
        let enough = |training: usize| {
            let fit = fit_rows(training);
            training - fit >= FEWEST_HORIZONS.saturating_mul(settings.horizon)
                && fit >= first_row(fit, settings.structure.nk) + ROWS_PER_COEFFICIENT * settings.structure.full_len()
        };
        // Above some number of rows both conditions hold always, so bisection finds it.
        let (mut low, mut high) = (0, usize::MAX >> 12);
        while low < high {
            let middle = low.midpoint(high);
            if enough(middle) {
                high = middle;
            } else {
                low = middle + 1;
            }
        }
        low
    }

    /// The commands of the fit.
    pub fn commands(&self) -> &[f64] {
        &self.inputs[..self.fit]
    }

    /// Rows of the fit: those on which every structure can be fitted.
    pub fn fit_rows(&self) -> usize {
        (0..self.fit).filter(|k| self.ages[*k] >= self.first).count()
    }

    /// Whether the gaps leave rows to fit on and a whole horizon to judge on.
    pub fn can_judge(&self) -> bool {
        self.fit_rows() > 0 && self.h_step_starts().next().is_some()
    }

    /// Number of held-out rows.
    pub fn held_out_rows(&self) -> usize {
        self.outputs.len() - self.fit
    }

    /// Longest delay of the search.
    pub fn longest_delay(&self) -> usize {
        longest_delay(self.fit)
    }

    /// Fits and judges a structure. None when the fit has too few rows for it. The caller sets the score.
    pub fn judge(&self, structure: Structure) -> Option<Candidate> {
        let (low, high) = structure.input.dead_band;
        let edges = usize::from(low > 0.0) + usize::from(high > 0.0);
        let parameters = structure.linear_len() + 2 * structure.order - 1 + edges;
        let memory = structure.past_outputs().max(structure.nk + structure.nb);
        if self.fit_rows() < ROWS_PER_COEFFICIENT * structure.full_len() || memory > self.first {
            return None;
        }
        let mut batch = self.collect(structure);
        let offline = batch.solve();
        let (own, model) = (offline.coefficients, offline.published);
        let growth = 1.0 + 1.0 / self.held_out_rows() as f64;
        let (h_step_rmse, free_run_rmse) = (self.h_step_rmse(&model), self.free_run_rmse(&model));
        let finite = h_step_rmse.is_finite() && free_run_rmse.is_finite();
        let (rows, squares) = (self.fit_rows() as u64, self.squares(&model).max(f64::MIN_POSITIVE));
        Some(Candidate {
            structure,
            parameters,
            h_step_rmse,
            free_run_rmse,
            score: f64::NAN,
            aic: criteria::aic(squares, rows, parameters),
            bic: criteria::bic(squares, rows, parameters),
            rank_deficient: offline.rank_deficient,
            unstable: !finite || !own.poles_within(growth),
        })
    }

    /// The error by which candidates are ranked: the geometric mean of the two errors, in the unit of the output.
    pub fn error(&self, candidate: &Candidate) -> f64 {
        let floor = |rmse: f64| rmse.max(self.negligible);
        (floor(candidate.h_step_rmse) * floor(candidate.free_run_rmse)).sqrt()
    }

    fn collect(&self, structure: Structure) -> Batch {
        let Structure { nb, nk, order, input, .. } = structure;
        let mut batch = Batch::new(structure, self.split);
        let mut row = RegressorRow::new(structure);
        let mut outputs = SlidingBuffer::new(structure.past_outputs(), 1);
        let mut commands = SlidingBuffer::new(nk + nb, 2 * order);
        for k in 1..self.fit {
            outputs.push(self.outputs[k - 1]);
            commands.push_with(|slot| input.features(self.inputs[k - 1], slot));
            if self.ages[k] >= self.first {
                row.fill(&outputs, &commands);
                batch.add(self.outputs[k], &row);
            }
        }
        batch
    }

    /// Predicts y(k), y(k+1), .. from the measured outputs before row k.
    fn predict(&self, model: &Coefficients, k: usize, predicted: &mut [f64]) {
        let (nb, nk) = (model.b().len() - 1, model.nk as usize);
        let mut past = [0.0; MAX_A];
        for (past, y) in past.iter_mut().zip(self.outputs[..k].iter().rev()) {
            *past = *y;
        }
        let from = k - nk - nb;
        model.predict(&past, &self.inputs[from..from + nb + predicted.len()], predicted);
    }

    fn squares(&self, model: &Coefficients) -> f64 {
        let mut predicted = [0.0];
        let errors = (0..self.fit).filter(|k| self.ages[*k] >= self.first).map(|k| {
            self.predict(model, k, &mut predicted);
            self.outputs[k] - predicted[0]
        });
        errors.map(|error| error * error).sum()
    }

    /// Rows from which the output is predicted a horizon ahead: a prediction and its past are without a gap.
    fn h_step_starts(&self) -> impl Iterator<Item = usize> + '_ {
        let h = self.horizon;
        let starts = (self.fit..=self.outputs.len() - h).step_by((h / STARTS_PER_HORIZON).max(1));
        starts.filter(move |k| self.ages[k + h - 1] + 1 >= self.first + h)
    }

    fn h_step_rmse(&self, model: &Coefficients) -> f64 {
        let h = self.horizon;
        let mut predicted = vec![0.0; h];
        let mut errors = ErrorStatistics::default();
        for k in self.h_step_starts() {
            self.predict(model, k, &mut predicted);
            errors.push(self.outputs[k + h - 1] - predicted[h - 1]);
        }
        errors.rmse()
    }

    fn free_run_rmse(&self, model: &Coefficients) -> f64 {
        let held_out = self.held_out_rows();
        let mut predicted = vec![0.0; held_out];
        let mut errors = ErrorStatistics::default();
        for run in 0..FREE_RUNS {
            // After a gap the run begins anew, as soon as there is enough past.
            let mut from = self.fit + run * held_out / FREE_RUNS;
            while from < self.outputs.len() {
                let gap = (from + 1..self.outputs.len()).find(|k| self.ages[*k] == 0).unwrap_or(self.outputs.len());
                from += self.first.saturating_sub(self.ages[from]);
                if from < gap {
                    let predicted = &mut predicted[..gap - from];
                    self.predict(model, from, predicted);
                    self.outputs[from..gap].iter().zip(predicted).for_each(|(y, own)| errors.push(y - *own));
                }
                from = gap;
            }
        }
        errors.rmse()
    }
}

fn fit_rows(training: usize) -> usize {
    (FIT_PART * training as f64) as usize
}

fn longest_delay(fit: usize) -> usize {
    (fit / DELAY_PART).clamp(1, LONGEST_SEARCHED)
}

/// The first row with enough past for every structure, up to the longest delay or the typed one. So all structures are
/// fitted on the same rows.
fn first_row(fit: usize, typed_delay: usize) -> usize {
    let delay = longest_delay(fit).max(typed_delay);
    // One row more, because the first velocity is not known.
    (delay + MAX_LINEAR - 1).max(MAX_A)
}
