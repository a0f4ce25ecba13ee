//! `--compare`: every estimator on one record. They run one after the other, because their updates are timed.

use pipeline::{
    machine::{Estimator, Form, Identification, Split},
    message::{AxisSnapshot, bit_names, model_fault},
};
use serde::Serialize;

use super::{record::Record, residuals::Residuals, run::identify};
use crate::report::table::{number, progress, table};

/// The forms in which an estimator runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Forms {
    /// The form of `--form`.
    Chosen,
    /// The linear form, whatever `--form` is.
    Linear,
    /// Both forms.
    Both,
}

/// The compared estimators, as `--estimator` names them. The first one has the form and the separation of the options.
const ESTIMATORS: &[(&str, Forms)] = &[
    ("rules", Forms::Chosen),
    ("paper", Forms::Linear),
    ("fuzzy:0.95", Forms::Chosen),
    ("constant:0.95", Forms::Both),
    ("constant:0.98", Forms::Both),
    ("constant:0.99", Forms::Both),
    ("constant:0.995", Forms::Both),
    ("constant:0.998", Forms::Both),
    ("constant:0.999", Forms::Both),
    ("constant:0.9995", Forms::Both),
    ("constant:1", Forms::Both),
    ("fortescue:1000", Forms::Chosen),
    ("directional:0.99", Forms::Chosen),
    ("window:500", Forms::Chosen),
    ("auto", Forms::Chosen),
];

/// Runs of each estimator. The shortest time counts, because a run of a few milliseconds is easily interrupted.
const TIMED_RUNS: usize = 3;

/// Ratios from this one on are shown with an exponent.
const LARGEST_RATIO: f64 = 1e4;

/// All estimators; before them the classical model, and persistence, which predicts the last output.
#[derive(Debug, Serialize)]
#[serde(transparent)]
pub struct Comparison(Vec<ComparisonRow>);

/// One estimator over the rows after training; sigma and rmse in the unit of what is identified.
#[derive(Debug, Serialize)]
struct ComparisonRow {
    estimator: String,
    /// None for persistence, which has no model, and for auto, which has models of both forms.
    form: Option<Form>,
    one_step_sigma: Option<f64>,
    h_step_sigma: f64,
    /// h-step sigma divided by that of the classical model.
    to_classical: f64,
    /// h-step sigma divided by that of the best constant forgetting factor, which is known in hindsight only.
    to_best_constant: f64,
    free_run_rmse: Option<f64>,
    /// Shortest time of some runs, with the errors of both models; none for a model that is not updated.
    ns_per_update: Option<f64>,
    faults: Vec<&'static str>,
    best_constant: bool,
}

/// Runs all estimators.
pub fn compare(settings: &Identification, record: &Record) -> Comparison {
    let runs = runs(settings);
    let progress = progress(runs.len() as u64, "estimators");
    let mut rows: Vec<ComparisonRow> = Vec::new();
    let mut residuals = Residuals::default();
    for (name, run) in &runs {
        let (identifier, mut ns_per_update) = identify(run, record, |_| {}, &mut residuals);
        for _ in 1..TIMED_RUNS {
            ns_per_update = identify(run, record, |_| {}, &mut residuals).1.min(ns_per_update);
        }
        let snapshot = identifier.snapshot();
        // The classical model is that of the chosen form and separation. The first run has both.
        if rows.is_empty() {
            rows.extend(fixed(run.form, &snapshot));
        }
        let form = (run.estimator != Estimator::Auto).then_some(run.form);
        rows.push(ComparisonRow::new(name, form, &snapshot, ns_per_update));
        progress.inc(1);
    }
    progress.finish_and_clear();
    let classical = rows[0].h_step_sigma;
    let constant = |row: &&ComparisonRow| matches!(row.estimator.parse(), Ok(Estimator::Constant(_)));
    let sigma = |row: &ComparisonRow| if row.h_step_sigma.is_nan() { f64::INFINITY } else { row.h_step_sigma };
    let constants = rows.iter().enumerate().filter(|(_, row)| constant(row));
    let best = constants.min_by(|(_, a), (_, b)| sigma(a).total_cmp(&sigma(b))).map(|(place, _)| place);
    let best_sigma = best.map_or(f64::NAN, |best| rows[best].h_step_sigma);
    for (place, row) in rows.iter_mut().enumerate() {
        row.to_classical = row.h_step_sigma / classical;
        row.to_best_constant = row.h_step_sigma / best_sigma;
        row.best_constant = best == Some(place);
    }
    Comparison(rows)
}

/// Name and settings of each run; the runs in the chosen form come first.
fn runs(settings: &Identification) -> Vec<(&'static str, Identification)> {
    let other = match settings.form {
        Form::Linear => Form::Full,
        Form::Full => Form::Linear,
    };
    let runs = [settings.form, other].map(|form| {
        let estimators = ESTIMATORS.iter().filter(move |(_, forms)| match forms {
            Forms::Chosen => form == settings.form,
            Forms::Linear => form == Form::Linear,
            Forms::Both => true,
        });
        estimators.filter_map(move |(name, _)| {
            let estimator = name.parse().ok()?;
            let split = if estimator == Estimator::Paper { Split::Paper } else { settings.split };
            Some((*name, Identification { form, split, estimator, ..settings.clone() }))
        })
    });
    runs.into_iter().flatten().collect()
}

/// The rows of predictors that do not learn after training: the classical model, and persistence.
fn fixed(form: Form, snapshot: &AxisSnapshot) -> [ComparisonRow; 2] {
    let errors = &snapshot.classical_errors;
    let row = |estimator: &str, h_step_sigma| ComparisonRow {
        estimator: estimator.to_owned(),
        form: None,
        one_step_sigma: None,
        h_step_sigma,
        to_classical: f64::NAN,
        to_best_constant: f64::NAN,
        free_run_rmse: None,
        ns_per_update: None,
        faults: Vec::new(),
        best_constant: false,
    };
    let classical = ComparisonRow {
        form: Some(form),
        one_step_sigma: Some(errors.one_step.sigma()),
        free_run_rmse: Some(errors.free_run.rmse()),
        faults: faults(snapshot.faults & model_fault::RANK_DEFICIENT),
        ..row("classical", errors.h_step.sigma())
    };
    [classical, row("persistence", snapshot.persistence.sigma())]
}

fn faults(bits: u32) -> Vec<&'static str> {
    bit_names(bits & model_fault::LASTING, &model_fault::NAMES).collect()
}

impl ComparisonRow {
    fn new(name: &str, form: Option<Form>, snapshot: &AxisSnapshot, ns_per_update: f64) -> Self {
        let errors = &snapshot.adaptive_errors;
        Self {
            estimator: name.to_owned(),
            form,
            one_step_sigma: Some(errors.one_step.sigma()),
            h_step_sigma: errors.h_step.sigma(),
            to_classical: f64::NAN,
            to_best_constant: f64::NAN,
            free_run_rmse: Some(errors.free_run.rmse()),
            ns_per_update: Some(ns_per_update),
            faults: faults(snapshot.faults),
            best_constant: false,
        }
    }

    fn name(&self) -> String {
        match self.form {
            Some(Form::Linear) => format!("{}, linear", self.estimator),
            Some(Form::Full) => format!("{}, full", self.estimator),
            None => self.estimator.clone(),
        }
    }
}

impl Comparison {
    /// The comparison as a table.
    pub fn table(&self) -> String {
        let figure = |value: Option<f64>| value.map_or_else(String::new, number);
        let ratio = |value: f64| if value.abs() < LARGEST_RATIO { format!("{value:.3}") } else { number(value) };
        let rows = self.0.iter().map(|row| {
            vec![
                row.name(),
                figure(row.one_step_sigma),
                number(row.h_step_sigma),
                ratio(row.to_classical),
                ratio(row.to_best_constant),
                figure(row.free_run_rmse),
                row.ns_per_update.map_or_else(String::new, |ns| format!("{ns:.0}")),
                row.faults.join(", "),
            ]
        });
        let header = [
            "estimator",
            "sigma one step",
            "h steps",
            "/ classical",
            "/ best constant",
            "rmse free run",
            "ns per update",
            "faults",
        ];
        let mut text = format!("{}\n", table(&header, rows.collect()));
        if let Some(best) = self.0.iter().find(|row| row.best_constant) {
            text += &format!("best constant factor in hindsight: {}\n", best.name());
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_of_the_table_is_that_of_an_estimator() {
        for (name, _) in ESTIMATORS {
            let estimator: Estimator = name.parse().unwrap();
            assert_eq!(estimator.to_string(), *name);
        }
    }
}
