//! The runs on one record: `auto`, and every constant forgetting factor in both forms.

use ident_proc::Identifier;
use pipeline::{
    machine::{Estimator, Form},
    message::AxisSnapshot,
    statistics::ErrorStatistics,
};
use serde::Serialize;

use super::{class::Class, record::Record};

/// The constant forgetting factors. The best of them on a record is known in hindsight only.
const CONSTANTS: [f64; 9] = [0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9995, 1.0];

/// Part of a sum of squares below which a difference of two such sums may be rounding.
const ROUNDING: f64 = 1e-9;

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
    /// Errors in the second half of the samples after the training.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub second_half: Option<SecondHalf>,
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

/// What was known before the second half of the samples after the training, and what only after it.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct SecondHalf {
    /// Of the model that `auto` hands over.
    pub auto: f64,
    /// Of the constant factor that was the best in the first half.
    pub known: f64,
    /// Of the constant factor that is the best in the second half.
    pub best: f64,
}

impl Trial {
    /// Runs everything on a record; without `constants` only `auto`.
    pub fn run(record: &Record, constants: bool) -> Self {
        let (half, auto) = identify(record, &record.outputs, Estimator::Auto, Form::Linear);
        let without_wild = record.without_wild.as_ref().map(|outputs| {
            let (_, snapshot) = identify(record, outputs, Estimator::Auto, Form::Linear);
            snapshot.adaptive_errors.h_step.sigma()
        });
        let constants = constants.then(|| Constant::all(record));
        let second_half = |all: &Vec<Constant>| SecondHalf {
            auto: later(&half.adaptive_errors.h_step, &auto.adaptive_errors.h_step),
            known: Constant::least(all, |constant| constant.halves[0]).halves[1],
            best: Constant::least(all, |constant| constant.halves[1]).halves[1],
        };
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
            best: constants.as_ref().map(|all| Constant::least(all, |constant| constant.best.sigma).best),
            second_half: constants.as_ref().map(second_half),
            without_wild,
            outliers: auto.outliers,
        }
    }
}

/// A constant factor and its errors on a record.
struct Constant {
    best: Best,
    /// Standard deviations in the first and in the second half of the samples after the training.
    halves: [f64; 2],
}

impl Constant {
    fn all(record: &Record) -> Vec<Self> {
        let of = |form| {
            CONSTANTS.map(|factor| {
                let (half, end) = identify(record, &record.outputs, Estimator::Constant(factor), form);
                let (half, end) = (half.unseparated_h_step, end.unseparated_h_step);
                let halves = [half.sigma(), later(&half, &end)];
                Self { best: Best { factor, form, sigma: end.sigma() }, halves }
            })
        };
        [of(Form::Linear), of(Form::Full)].into_iter().flatten().collect()
    }

    /// The one with the least error. An error that is not a number counts as infinite.
    fn least(all: &[Self], error: impl Fn(&Self) -> f64) -> &Self {
        let error = |constant: &&Self| Some(error(constant)).filter(|error| !error.is_nan()).unwrap_or(f64::INFINITY);
        all.iter().min_by(|one, two| error(one).total_cmp(&error(two))).expect("there are constant factors")
    }
}

/// Standard deviation of the errors after those of `half`, which are the first ones of `all`. Not a number where the
/// first ones were so large that nothing can be said of the later ones.
fn later(half: &ErrorStatistics, all: &ErrorStatistics) -> f64 {
    let (n, m) = (all.count as f64, half.count as f64);
    let mean = (n * all.mean - m * half.mean) / (n - m);
    let between = mean - half.mean;
    let m2 = all.m2 - half.m2 - between * between * (n - m) * m / n;
    if m2 > ROUNDING * all.m2 { (m2 / (n - m)).sqrt() } else { f64::NAN }
}

/// What is known in the middle of the samples after the training, and at the end.
fn identify(record: &Record, outputs: &[f64], estimator: Estimator, form: Form) -> (AxisSnapshot, AxisSnapshot) {
    let settings = record.settings(estimator, form);
    let middle = settings.training + (outputs.len() - settings.training) / 2;
    let mut identifier = Identifier::new(&settings);
    let mut applied = None;
    let mut half = None;
    for (k, (y, u)) in outputs.iter().zip(&record.inputs).enumerate() {
        identifier.update(Some(*y), applied);
        applied = Some(*u);
        if k == middle {
            half = Some(identifier.snapshot());
        }
    }
    (half.expect("a record has a middle"), identifier.snapshot())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_errors_of_the_later_part_are_those_of_the_whole_less_the_first_part() {
        let errors = |values: &[f64]| {
            let mut errors = ErrorStatistics::default();
            values.iter().for_each(|value| errors.push(*value));
            errors
        };
        let values = [0.3, -1.0, 2.5, 0.1, -0.4, 3.0, 1.0];
        let later = later(&errors(&values[..3]), &errors(&values));
        assert!((later - errors(&values[3..]).sigma()).abs() < 1e-12);
        let diverged = [1e9, -1e9, 0.1, 0.2, 0.3];
        assert!(super::later(&errors(&diverged[..2]), &errors(&diverged)).is_nan());
    }
}
