//! The runs on one record: `auto`, and every constant forgetting factor in both forms.

use ident_proc::Identifier;
use pipeline::{
    machine::{Estimator, Form},
    message::AxisSnapshot,
};
use serde::Serialize;

use super::{class::Class, record::Record};

/// The constant forgetting factors. The best of them on a record is known in hindsight only.
const CONSTANTS: [f64; 9] = [0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9995, 1.0];

/// What the runs on a record have shown. Standard deviations of h-step errors in the unit of the record.
#[derive(Debug, Clone, Serialize)]
pub struct Trial {
    /// Number of the record.
    pub number: u64,
    /// Its class.
    pub class: Class,
    /// s.
    pub period_s: f64,
    /// Samples.
    pub horizon: usize,
    /// Delay of the model, samples.
    pub delay: usize,
    /// Of the model that `auto` hands over.
    pub auto: f64,
    /// Of the mixture of `auto` before it is separated.
    pub mixture: f64,
    /// Of the held model.
    pub held: f64,
    /// Of holding still.
    pub still: f64,
    /// Of the best constant factor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub best: Option<Best>,
    /// Of `auto` where the wild samples of the record are left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub without_wild: Option<f64>,
    /// Samples that `auto` took for outliers.
    pub outliers: u64,
}

/// The best constant factor on a record.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Best {
    /// The factor.
    pub factor: f64,
    /// The form.
    pub form: Form,
    /// Standard deviation of its h-step error, before separation.
    pub sigma: f64,
}

impl Trial {
    /// Runs everything on a record; without `constants` only `auto`.
    pub fn run(record: &Record, constants: bool) -> Self {
        let auto = identify(record, &record.outputs, Estimator::Auto, Form::Linear);
        let without_wild = record.without_wild.as_ref().map(|outputs| {
            let snapshot = identify(record, outputs, Estimator::Auto, Form::Linear);
            snapshot.adaptive_errors.h_step.sigma()
        });
        Self {
            number: record.number,
            class: record.class,
            period_s: record.period,
            horizon: record.horizon,
            delay: record.delay,
            auto: auto.adaptive_errors.h_step.sigma(),
            mixture: auto.unseparated_h_step.sigma(),
            held: auto.classical_errors.h_step.sigma(),
            still: auto.persistence.sigma(),
            best: constants.then(|| best_constant(record)),
            without_wild,
            outliers: auto.outliers,
        }
    }
}

fn best_constant(record: &Record) -> Best {
    let of = |form| {
        CONSTANTS.map(|factor| {
            let snapshot = identify(record, &record.outputs, Estimator::Constant(factor), form);
            let sigma = snapshot.unseparated_h_step.sigma();
            Best { factor, form, sigma: if sigma.is_nan() { f64::INFINITY } else { sigma } }
        })
    };
    let all = [of(Form::Linear), of(Form::Full)].into_iter().flatten();
    all.min_by(|one, two| one.sigma.total_cmp(&two.sigma)).expect("there are constant factors")
}

fn identify(record: &Record, outputs: &[f64], estimator: Estimator, form: Form) -> AxisSnapshot {
    let mut identifier = Identifier::new(&record.settings(estimator, form));
    let mut applied = None;
    for (y, u) in outputs.iter().zip(&record.inputs) {
        identifier.update(Some(*y), applied);
        applied = Some(*u);
    }
    identifier.snapshot()
}
