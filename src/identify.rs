//! `hydraxis identify`: a recording through the same core that runs in ident-proc.

use std::{
    path::Path,
    time::{Duration, Instant},
};

use ident_proc::Identifier;
use pipeline::{
    hammerstein::{Basis, InputMap, Structure},
    machine::{Fuzzy, Identification, IdentifiedOutput, shortest_training},
    message::{bit_names, model_fault},
    statistics::ErrorStatistics,
};
use sensor_proc::record::{Record, RecordError};
use serde::Serialize;

use crate::{
    cli,
    failure::Failure,
    figures::{CoefficientLists, ErrorFigures, Reduction},
    output::Output,
    table::{number, percent, progress, table},
};

#[derive(Debug, Serialize)]
struct Report {
    rows: usize,
    train: usize,
    period_s: f64,
    horizon: usize,
    structure: Structure,
    output: IdentifiedOutput,
    form: pipeline::machine::Form,
    split: pipeline::machine::Split,
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

/// Runs the command.
pub fn run(arguments: &cli::Identify) -> Result<(), Failure> {
    let period = arguments.period.map(|period| period.as_secs_f64());
    let record = Record::read(&arguments.data, &arguments.input, &arguments.output, period).map_err(Failure::usage)?;
    let settings = settings(arguments, &record)?;
    let output = Output::open(arguments.json.as_deref())?;
    let (mut identifier, ns_per_update) = identify(&settings, &record);
    let report = Report::new(&settings, &record, &mut identifier, ns_per_update);
    output.write(|| report.tables(&arguments.data), &report)
}

/// What to identify, from what was typed and what the record is.
fn settings(arguments: &cli::Identify, record: &Record) -> Result<Identification, Failure> {
    let rows = record.outputs.len();
    let structure = structure(arguments)?;
    let output = if arguments.velocity { IdentifiedOutput::Velocity } else { IdentifiedOutput::Position };
    let training = arguments.train.of(rows);
    let horizon = arguments.horizon.at(Duration::from_secs_f64(record.period));
    if horizon == 0 {
        return Err(Failure::usage("--horizon: found 0 samples; allowed: at least one sample"));
    }
    let coefficients = structure.full_len();
    let shortest = shortest_training(structure, output);
    if training < shortest {
        return Err(Failure::Usage(format!(
            "{}: --train: found {training} of the {rows} rows; allowed: at least {shortest}, to determine {coefficients} \
             coefficients (fewer with lower --na, --nb, --order)",
            arguments.data.display()
        )));
    }
    if rows.saturating_sub(training) <= horizon {
        return Err(Failure::usage(RecordError::TooFewRows {
            file: arguments.data.clone(),
            rows,
            needed: training.saturating_add(horizon).saturating_add(1),
            why: format!("to test {horizon} samples ahead after {training} for training"),
        }));
    }
    let mut fuzzy = match &arguments.fuzzy {
        Some(file) => Fuzzy::load(file).map_err(Failure::usage)?,
        None => Fuzzy::PAPER,
    };
    fuzzy.error_universe = arguments.error_universe.or(fuzzy.error_universe);
    fuzzy.variation_universe = arguments.variation_universe.or(fuzzy.variation_universe);
    let settings = Identification {
        structure,
        output,
        period: record.period,
        training,
        horizon,
        form: arguments.form.into(),
        split: arguments.split.into(),
        forgetting: arguments.forgetting,
        fuzzy,
    };
    settings
        .check_window()
        .map_err(|(found, allowed)| Failure::Usage(format!("--forgetting: found {found}; allowed: {allowed}")))?;
    Ok(settings)
}

/// Orders and options of the model, from what was typed.
fn structure(arguments: &cli::Identify) -> Result<Structure, Failure> {
    let typed = arguments.order;
    let (order, basis) = match arguments.knots {
        None => (typed.unwrap_or(Structure::PAPER.order), Basis::Powers),
        Some(knots) if typed.is_none_or(|order| order == knots.count) => (knots.count, knots.basis),
        Some(knots) => {
            return Err(Failure::Usage(format!(
                "--order: found {} with {} --knots; allowed: {1}, the number of knots, or no --order",
                typed.unwrap_or_default(),
                knots.count
            )));
        }
    };
    let dead_band = arguments.dead_band.map_or(InputMap::PAPER.dead_band, |band| (band.0, band.1));
    Ok(Structure {
        na: arguments.na,
        nb: arguments.nb,
        nk: arguments.nk,
        order,
        integrator: arguments.integrator,
        drift: arguments.drift,
        input: InputMap { dead_band, basis },
    })
}

/// What is not as in the paper, each with a comma before it.
fn options(structure: &Structure, output: IdentifiedOutput) -> String {
    let mut text = String::new();
    let (low, high) = structure.input.dead_band;
    if structure.integrator {
        text += ", integrator";
    }
    if structure.drift {
        text += ", drift";
    }
    if (low, high) != InputMap::PAPER.dead_band {
        text += &format!(", dead band -{low} to {high}");
    }
    if let Basis::Hinges(knots) = structure.input.basis {
        let knots: Vec<String> = knots[..structure.order].iter().map(f64::to_string).collect();
        text += &format!(", knots {}", knots.join(" "));
    }
    if output == IdentifiedOutput::Velocity {
        text += ", velocity";
    }
    text
}

/// The record through the core; nanoseconds per update after training beside it.
fn identify(settings: &Identification, record: &Record) -> (Identifier, f64) {
    let mut identifier = Identifier::new(settings);
    let progress = progress(record.outputs.len() as u64, "samples");
    let mut test_started = Instant::now();
    for (k, y) in record.outputs.iter().enumerate() {
        if k == settings.training {
            test_started = Instant::now();
        }
        let applied = k.checked_sub(1).map(|before| record.inputs[before]);
        identifier.update(Some(*y), applied);
        if k % 65_536 == 0 {
            progress.set_position(k as u64);
        }
    }
    let elapsed = test_started.elapsed().as_secs_f64();
    progress.finish_and_clear();
    let tested = record.outputs.len() - settings.training;
    (identifier, 1e9 * elapsed / tested as f64)
}

impl Report {
    fn new(settings: &Identification, record: &Record, identifier: &mut Identifier, ns_per_update: f64) -> Self {
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
        }
    }

    fn tables(&self, file: &Path) -> String {
        let Structure { na, nb, nk, order, .. } = self.structure;
        let options = options(&self.structure, self.output);
        let mut text = format!(
            "{}: {} rows of {} s, {} for training; na {na}, nb {nb}, nk {nk}, order {order}{options}; {} ahead is {} \
             samples\n",
            file.display(),
            self.rows,
            number(self.period_s),
            self.train,
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
        text += &format!(
            "{}
",
            table(&header, rows)
        );
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
        text
    }
}
