//! The figures of one identification, for people and for programs.

use std::{path::Path, time::Duration};

use ident_proc::Identifier;
use pipeline::{
    hammerstein::Structure,
    machine::{Form, Identification, IdentifiedOutput, Split},
    message::{bit_names, model_fault},
    statistics::ErrorStatistics,
};
use sensor_proc::record::Record;
use serde::Serialize;

use super::{compare::Comparison, select::Selection, structure::description};
use crate::{
    figures::{CoefficientLists, ErrorFigures, Reduction},
    table::{number, percent, table},
};

/// What `--json` writes.
#[derive(Debug, Serialize)]
pub struct Report {
    rows: usize,
    train: usize,
    period_s: f64,
    horizon: usize,
    structure: Structure,
    output: IdentifiedOutput,
    form: Form,
    split: Split,
    forgetting: String,
    /// Only fuzzy forgetting has universes.
    error_universe: Option<f64>,
    variation_universe: Option<f64>,
    faults: Vec<&'static str>,
    skipped: u64,
    irregular_steps: usize,
    persistence: Persistence,
    classical: Classical,
    adaptive: Adaptive,
    reduction_percent: Reduction,
    /// What `--select` found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub selection: Option<Selection>,
    /// What `--compare` found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub comparison: Option<Comparison>,
}

#[derive(Debug, Serialize)]
struct Persistence {
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
    free_run_frozen: ErrorFigures,
    coefficients: CoefficientLists,
    forgetting_factor: FactorFigures,
    ns_per_update: f64,
}

#[derive(Debug, Serialize)]
struct FactorFigures {
    mean: f64,
    min: f64,
}

impl Report {
    /// After the last sample.
    pub fn new(settings: &Identification, record: &Record, identifier: &Identifier, ns_per_update: f64) -> Self {
        let (snapshot, universes) = (identifier.snapshot(), identifier.universes());
        let figures = |error: &ErrorStatistics| ErrorFigures::new(error, &snapshot.output);
        let (classical, adaptive) = (&snapshot.classical_errors, &snapshot.adaptive_errors);
        Self {
            rows: record.outputs.len(),
            train: settings.training,
            period_s: record.period,
            horizon: settings.horizon,
            structure: settings.structure,
            output: settings.output,
            form: settings.form,
            split: settings.split,
            forgetting: settings.forgetting.to_string(),
            error_universe: universes.map(|(error, _)| error),
            variation_universe: universes.map(|(_, variation)| variation),
            faults: bit_names(snapshot.faults & model_fault::LASTING, &model_fault::NAMES).collect(),
            skipped: snapshot.skipped,
            irregular_steps: record.irregular_steps,
            persistence: Persistence { h_step: figures(&snapshot.persistence) },
            classical: Classical {
                one_step: figures(&classical.one_step),
                h_step: figures(&classical.h_step),
                free_run: figures(&classical.free_run),
                coefficients: CoefficientLists::new(&snapshot.classical),
                split_residual: snapshot.split_residual,
            },
            adaptive: Adaptive {
                one_step: figures(&adaptive.one_step),
                h_step: figures(&adaptive.h_step),
                free_run: figures(&adaptive.free_run),
                // The adaptive model starts from the offline coefficients, so frozen there it is the classical one.
                free_run_frozen: figures(&classical.free_run),
                coefficients: CoefficientLists::new(&snapshot.adaptive),
                forgetting_factor: FactorFigures {
                    mean: 1.0 - snapshot.forgetting.mean,
                    min: 1.0 - snapshot.forgetting.max,
                },
                ns_per_update,
            },
            reduction_percent: Reduction::new(classical, adaptive),
            selection: None,
            comparison: None,
        }
    }

    /// What people read.
    pub fn tables(&self, file: &Path) -> String {
        let mut text = self.selection.as_ref().map(|selection| selection.table(self.output)).unwrap_or_default();
        text += &format!(
            "{}: {} rows of {} s, {} for training; {}; {} ahead is {} samples\n",
            file.display(),
            self.rows,
            number(self.period_s),
            self.train,
            description(&self.structure, self.output),
            humantime::format_duration(Duration::from_secs_f64(self.period_s * self.horizon as f64)),
            self.horizon
        );
        if self.irregular_steps > 0 {
            text += &format!(
                "warning: {} steps of time differ from the period by more than half of it\n",
                self.irregular_steps
            );
        }
        if !self.faults.is_empty() {
            text += &format!("warning: {}\n", self.faults.join(", "));
        }
        let row = |name: &str, classical: &ErrorFigures, adaptive: &ErrorFigures, reduction: f64| {
            vec![
                name.to_owned(),
                number(classical.sigma),
                number(adaptive.sigma),
                percent(reduction),
                number(classical.rmse),
                number(adaptive.rmse),
                percent(adaptive.fit_percent),
            ]
        };
        let (classical, adaptive, reduction) = (&self.classical, &self.adaptive, &self.reduction_percent);
        let rows = vec![
            row("one step", &classical.one_step, &adaptive.one_step, reduction.one_step),
            row("h steps", &classical.h_step, &adaptive.h_step, reduction.h_step),
            row("free run", &classical.free_run, &adaptive.free_run, reduction.free_run),
        ];
        let header =
            ["error", "sigma classical", "adaptive", "reduction", "rmse classical", "adaptive", "fit adaptive"];
        text += &format!("{}\n", table(&header, rows));
        text += &format!(
            "h steps by holding y: sigma {}. Forgetting {} (mean {}, least {}); {:.0} ns per update.\n",
            number(self.persistence.h_step.sigma),
            self.forgetting,
            number(adaptive.forgetting_factor.mean),
            number(adaptive.forgetting_factor.min),
            adaptive.ns_per_update
        );
        for (name, model) in [("classical", &classical.coefficients), ("adaptive", &adaptive.coefficients)] {
            let list = |values: &[f64]| values.iter().map(|v| number(*v)).collect::<Vec<_>>().join(" ");
            let drift = if self.structure.drift { format!("   c {}", number(model.drift)) } else { String::new() };
            text += &format!(
                "{name:9}  a {}   b {}   f {}   g {}{drift}\n",
                list(&model.a),
                list(&model.b),
                list(&model.f),
                list(&model.g)
            );
        }
        if let Some(comparison) = &self.comparison {
            text += &comparison.table();
        }
        text
    }
}
