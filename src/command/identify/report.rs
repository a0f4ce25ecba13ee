//! The report of one identification, as JSON for programs and as tables for people.

use std::time::Duration;

use ident_proc::Identifier;
use pipeline::{
    hammerstein::Structure,
    machine::{Form, Identification, IdentifiedOutput, Split},
    message::{bit_names, model_fault},
    statistics::ErrorStatistics,
};
use serde::Serialize;

use super::{
    compare::Comparison,
    record::{self, ReadRecording, Record},
    residuals::{Deviations, Residuals, Validation},
    select::Selection,
    structure::description,
    verdict::Verdict,
};
use crate::report::{
    figures::{CoefficientLists, ErrorFigures, Reduction},
    table::{number, percent, table},
};

/// The report, as JSON has it.
#[derive(Debug, Serialize)]
pub struct IdentifyReport<'a> {
    #[serde(skip)]
    name: String,
    verdict: Verdict,
    rows: usize,
    train: usize,
    period_s: f64,
    horizon: usize,
    structure: Structure,
    output: IdentifiedOutput,
    form: Form,
    split: Split,
    estimator: String,
    /// Universes of the fuzzy forgetting factor; none for other estimators.
    error_universe: Option<f64>,
    variation_universe: Option<f64>,
    faults: Vec<&'static str>,
    skipped: u64,
    outliers: u64,
    irregular_steps: usize,
    /// Unit of the identified output; none where no file and no option states it.
    unit: Option<String>,
    recordings: &'a [ReadRecording],
    persistence: Persistence,
    classical: Classical,
    adaptive: Adaptive,
    reduction_percent: Reduction,
    validation: Validation,
    /// The result of `--select`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub selection: Option<Selection>,
    /// The result of `--compare`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub comparison: Option<Comparison>,
}

#[derive(Debug, Serialize)]
struct Persistence {
    one_step: ErrorFigures,
    h_step: ErrorFigures,
}

#[derive(Debug, Serialize)]
struct Classical {
    one_step: ErrorFigures,
    h_step: ErrorFigures,
    free_run: ErrorFigures,
    coefficients: CoefficientLists,
    split_residual: f64,
}

#[derive(Debug, Serialize)]
struct Adaptive {
    one_step: ErrorFigures,
    h_step: ErrorFigures,
    free_run: ErrorFigures,
    coefficients: CoefficientLists,
    /// h-step errors before the separation into b, f and g: what that costs.
    unseparated_h_step: ErrorFigures,
    split_residual: f64,
    forgetting_factor: FactorFigures,
    /// The estimators of auto and their weights after the last sample.
    members: Vec<BankMember>,
    ns_per_update: f64,
}

/// A member of the bank in the end.
#[derive(Debug, Serialize)]
pub struct BankMember {
    family: &'static str,
    forgetting_factor: f64,
    weight: f64,
}

#[derive(Debug, Serialize)]
struct FactorFigures {
    mean: f64,
    min: f64,
}

impl<'a> IdentifyReport<'a> {
    /// The report after the last sample.
    pub fn new(
        settings: &Identification,
        record: &'a Record,
        identifier: &Identifier,
        residuals: &Residuals,
        ns_per_update: f64,
    ) -> Self {
        let (snapshot, universes) = (identifier.snapshot(), identifier.universes());
        let figures = |error: &ErrorStatistics| ErrorFigures::new(error, &snapshot.output);
        let (classical, adaptive) = (&snapshot.classical_errors, &snapshot.adaptive_errors);
        let still = identifier.persistence_one_step();
        Self {
            name: record.name(),
            verdict: Verdict::new(settings, record, identifier),
            rows: record.outputs.len(),
            train: settings.training,
            period_s: record.period,
            horizon: settings.horizon,
            structure: settings.structure,
            output: settings.output,
            form: settings.form,
            split: settings.split,
            estimator: settings.estimator.to_string(),
            error_universe: universes.map(|(error, _)| error),
            variation_universe: universes.map(|(_, variation)| variation),
            faults: bit_names(snapshot.faults & model_fault::LASTING, &model_fault::NAMES).collect(),
            skipped: snapshot.skipped,
            outliers: snapshot.outliers,
            irregular_steps: record.irregular_steps(),
            unit: record.unit(settings.output),
            recordings: &record.recordings,
            persistence: Persistence { one_step: figures(still), h_step: figures(&snapshot.persistence) },
            classical: Classical {
                one_step: figures(&classical.one_step),
                h_step: figures(&classical.h_step),
                free_run: figures(&classical.free_run),
                coefficients: CoefficientLists::new(&snapshot.classical),
                split_residual: identifier.offline().map_or(f64::NAN, |offline| offline.split_residual),
            },
            adaptive: Adaptive {
                one_step: figures(&adaptive.one_step),
                h_step: figures(&adaptive.h_step),
                free_run: figures(&adaptive.free_run),
                coefficients: CoefficientLists::new(&snapshot.adaptive),
                forgetting_factor: FactorFigures {
                    mean: 1.0 - snapshot.forgetting.mean,
                    min: 1.0 - snapshot.forgetting.max,
                },
                unseparated_h_step: figures(&snapshot.unseparated_h_step),
                split_residual: snapshot.split_residual,
                members: identifier.bank().map_or_else(Vec::new, |bank| bank.members().map(BankMember::from).collect()),
                ns_per_update,
            },
            reduction_percent: Reduction::new(classical, adaptive)
                .where_better(classical, [still.rmse(), snapshot.persistence.rmse(), snapshot.output.sigma()]),
            validation: Validation::new(identifier, residuals),
            selection: None,
            comparison: None,
        }
    }

    /// Whether the model is usable.
    pub fn is_usable(&self) -> bool {
        self.verdict.is_usable()
    }

    /// The verdict, and what it rests on.
    pub fn verdict(&self) -> (&'static str, String) {
        self.verdict.words(&self.ahead())
    }

    /// All figures as tables.
    pub fn tables(&self) -> String {
        let parts = [
            self.verdict.line(&self.ahead()),
            self.selection.as_ref().map(|selection| selection.table(self.output)).unwrap_or_default(),
            record::text(self.recordings),
            self.record(),
            self.error_table(),
            self.estimation(),
            self.coefficients(),
            self.validation.table(),
            self.comparison.as_ref().map(Comparison::table).unwrap_or_default(),
        ];
        parts.concat()
    }

    /// The record and the structure, with warnings.
    fn record(&self) -> String {
        let mut text = format!(
            "{}: {} rows of {} s, {} for training, {} outliers; {}; {} ahead is {} samples\n",
            self.name,
            self.rows,
            number(self.period_s),
            self.train,
            self.outliers,
            description(&self.structure, self.output),
            self.ahead(),
            self.horizon
        );
        if self.irregular_steps > 0 {
            text += &format!(
                "warning: {} steps of time are shorter than half of the period, or do not rise\n",
                self.irregular_steps
            );
        }
        if !self.faults.is_empty() {
            text += &format!("warning: {}\n", self.faults.join(", "));
        }
        text
    }

    /// The horizon as a duration.
    pub fn ahead(&self) -> String {
        humantime::format_duration(Duration::from_secs_f64(self.period_s * self.horizon as f64)).to_string()
    }

    /// The errors: names of the columns, and rows.
    pub fn error_rows(&self) -> (Vec<String>, Vec<Vec<String>>) {
        let row = |name: &str, still: f64, classical: &ErrorFigures, adaptive: &ErrorFigures, reduction: f64| {
            vec![
                name.to_owned(),
                number(still),
                number(classical.sigma),
                number(adaptive.sigma),
                percent(reduction),
                number(classical.rmse),
                number(adaptive.rmse),
                percent(adaptive.fit_percent),
            ]
        };
        let (classical, adaptive, reduction) = (&self.classical, &self.adaptive, &self.reduction_percent);
        let Persistence { one_step, h_step } = &self.persistence;
        let rows = vec![
            row("one step", one_step.sigma, &classical.one_step, &adaptive.one_step, reduction.one_step),
            row("h steps", h_step.sigma, &classical.h_step, &adaptive.h_step, reduction.h_step),
            row("free run", f64::NAN, &classical.free_run, &adaptive.free_run, reduction.free_run),
        ];
        let error = self.unit.as_ref().map_or_else(|| "error".to_owned(), |unit| format!("error, {unit}"));
        let header = [
            error.as_str(),
            "sigma still",
            "classical",
            "adaptive",
            "reduction",
            "rmse classical",
            "adaptive",
            "fit adaptive",
        ];
        (header.map(str::to_owned).to_vec(), rows)
    }

    fn error_table(&self) -> String {
        let (header, rows) = self.error_rows();
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        format!("{}\n", table(&header, rows))
    }

    /// What was identified on which data, as names and values.
    pub fn facts(&self) -> Vec<(&'static str, String)> {
        let mut facts: Vec<(&'static str, String)> =
            record::text(self.recordings).lines().map(|line| ("recording", line.to_owned())).collect();
        let outliers = percent(100.0 * self.outliers as f64 / self.rows as f64);
        facts.extend([
            ("rows", format!("{} of {} s, {} for training", self.rows, number(self.period_s), self.train)),
            ("outliers", format!("{} ({outliers}), left out", self.outliers)),
            ("structure", description(&self.structure, self.output)),
            ("horizon", format!("{} ahead, {} samples", self.ahead(), self.horizon)),
            ("estimator", self.estimator.clone()),
        ]);
        if !self.faults.is_empty() {
            facts.push(("warning", self.faults.join(", ")));
        }
        facts
    }

    /// The coefficients, one in each row: of the held model, their standard deviations, and of the adaptive model.
    pub fn coefficient_rows(&self) -> (Vec<String>, Vec<Vec<String>>) {
        let header = ["coefficient", "held", "+- sigma", "adaptive, in the end"].map(str::to_owned).to_vec();
        let (held, adaptive) = (&self.classical.coefficients, &self.adaptive.coefficients);
        let spread = self.validation.deviations.as_ref();
        let mut rows = Vec::new();
        for (name, first, held, adaptive, sigma) in [
            ("a", 1, &held.a, &adaptive.a, spread.map(|of| &of.a)),
            ("b", 0, &held.b, &adaptive.b, spread.map(|of| &of.b)),
            ("f", 1, &held.f, &adaptive.f, spread.map(|of| &of.f)),
            ("g", 1, &held.g, &adaptive.g, spread.map(|of| &of.g)),
        ] {
            for i in 0..held.len().max(adaptive.len()) {
                let value = |list: &[f64]| list.get(i).map_or_else(String::new, |value| number(*value));
                let sigma = sigma.and_then(|list| list.get(i));
                let sigma = sigma.map_or_else(String::new, |sigma| sigma.map_or_else(|| "?".to_owned(), number));
                rows.push(vec![format!("{name}_{}", first + i), value(held), sigma, value(adaptive)]);
            }
        }
        if self.structure.drift {
            let sigma = spread.and_then(|of| of.drift).map_or_else(|| "?".to_owned(), number);
            rows.push(vec!["c".to_owned(), number(held.drift), sigma, number(adaptive.drift)]);
        }
        (header, rows)
    }

    /// The estimator, and the members of auto.
    fn estimation(&self) -> String {
        let adaptive = &self.adaptive;
        let mut text = format!(
            "Estimator {} (forgetting factor mean {}, least {}); {:.0} ns per update.\n",
            self.estimator,
            number(adaptive.forgetting_factor.mean),
            number(adaptive.forgetting_factor.min),
            adaptive.ns_per_update
        );
        let mut members: Vec<&BankMember> = adaptive.members.iter().filter(|member| member.weight >= 0.01).collect();
        members.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        if !members.is_empty() {
            text += &format!(
                "auto in the end: {}\n",
                members
                    .iter()
                    .map(|m| format!("{} ({:.0} %)", m.name(), 100.0 * m.weight))
                    .collect::<Vec<_>>()
                    .join(", ")
            );
        }
        text
    }

    /// The coefficients of both models, and the standard deviations of those of the classical one.
    fn coefficients(&self) -> String {
        let drift = |value: String| if self.structure.drift { format!("   c {value}") } else { String::new() };
        let list = |values: &[f64]| values.iter().map(|v| number(*v)).collect::<Vec<_>>().join(" ");
        let line = |(name, model): (&str, &CoefficientLists)| {
            let CoefficientLists { a, b, f, g, .. } = model;
            let (a, b, f, g) = (list(a), list(b), list(f), list(g));
            format!("{name:9}  a {a}   b {b}   f {f}   g {g}{}\n", drift(number(model.drift)))
        };
        let models = [("classical", &self.classical.coefficients), ("adaptive", &self.adaptive.coefficients)];
        let mut text: String = models.into_iter().map(line).collect();
        if let Some(Deviations { a, b, f, g, drift: c, .. }) = &self.validation.deviations {
            let list = |values: &[Option<f64>]| {
                values.iter().map(|v| v.map_or_else(|| "?".to_owned(), number)).collect::<Vec<_>>().join(" ")
            };
            let (a, b, f, g) = (list(a), list(b), list(f), list(g));
            text += &format!("  +- sigma  a {a}   b {b}   f {f}   g {g}{}\n", drift(list(&[*c])));
        }
        text
    }
}

impl From<(&'static str, f64, f64)> for BankMember {
    fn from((family, forgetting_factor, weight): (&'static str, f64, f64)) -> Self {
        Self { family, forgetting_factor, weight }
    }
}

impl BankMember {
    /// Its form, and its forgetting factor unless it forgets nothing because it learns nothing.
    pub fn name(&self) -> String {
        let Self { family, forgetting_factor, .. } = self;
        if *forgetting_factor == 1.0 {
            return (*family).to_owned();
        }
        // A memory of 333 samples is a factor of 0.996996996..
        format!("{family} {forgetting_factor:.6}").trim_end_matches('0').to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn members_that_learn_are_named_with_their_factor_and_the_others_without() {
        let name = |family, factor| BankMember::from((family, factor, 0.5)).name();
        assert_eq!(name("smoothed", 1.0 - 1.0 / 333.0), "smoothed 0.996997");
        assert_eq!(name("linear", 1.0 - 1.0 / 100.0), "linear 0.99");
        assert_eq!((name("held", 1.0), name("still", 1.0)), ("held".to_owned(), "still".to_owned()));
    }
}
