//! `hydraxis predict`: applies a model that `hydraxis identify` has saved to another recording.
//!
//! The model is held. Its errors are compared with those of holding still over the same rows. Every row counts: without
//! the estimator nothing says which one is an outlier.

use std::{
    io::{self, Write},
    path::PathBuf,
    time::Duration,
};

use clap::Args;
use pipeline::{machine::IdentifiedOutput, message::ModelErrors, statistics::ErrorStatistics};
use serde::Serialize;

use super::identify::{LARGEST_STANDING, ReadRecording, Reason, Record, Verdict, description, recordings_text};
use crate::{
    arguments::{ColumnArguments, values::Samples},
    failure::Failure,
    model::{
        IdentifiedModel,
        prediction::{Predictions, memory, statistics, still},
    },
    report::{
        figures::ErrorFigures,
        output::{Output, OutputError, create, expect_one_stdout, is_stdout},
        rows::{CsvRows, field},
        table::{number, percent, table},
    },
};

/// Largest part by which the period of a recording may differ from that of the model.
const PERIOD_TOLERANCE: f64 = 0.01;
/// Largest part of the rows that may have an irregular time.
const LARGEST_PART: f64 = 0.01;

/// `predict`.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(after_help = "\
Examples:
  hydraxis identify boom.csv --model-out boom.toml
  hydraxis predict boom.toml boom_warm.csv                    errors of the model on another recording
  hydraxis predict boom.toml a.csv b.csv --csv predicted.csv  the predictions of all rows
  hydraxis predict boom.toml boom_warm.csv --horizon 1s --json -

The model is held: it learns nothing from these recordings.")]
pub struct PredictArguments {
    /// The model, a file that `hydraxis identify --model-out FILE.toml` has written
    #[arg(value_name = "MODEL.toml")]
    pub model: PathBuf,
    /// Recordings. Nothing is combined over the gap between two of them
    #[arg(required = true)]
    pub data: Vec<PathBuf>,
    /// The columns
    #[command(flatten)]
    pub columns: ColumnArguments,
    /// Prediction horizon of the h-step error: samples, or a duration such as 0.5s [default: that of the model]
    #[arg(long)]
    pub horizon: Option<Samples>,
    /// Write the figures as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write the predictions row by row as CSV to a file, or to standard output with -
    #[arg(long, value_name = "FILE.csv")]
    pub csv: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &PredictArguments) -> Result<(), Failure> {
    let model = IdentifiedModel::read(&arguments.model).map_err(Failure::usage)?;
    let record = Record::read(&arguments.data, &[], &arguments.columns)?;
    let name = arguments.model.display().to_string();
    expect_that_they_fit(&model, &name, &record)?;
    let period = Duration::from_secs_f64(record.period);
    let horizon = arguments.horizon.map_or(model.horizon, |horizon| horizon.at(period));
    expect_enough_rows(&model, &record, horizon)?;
    expect_one_stdout(&[("--json", &arguments.json), ("--csv", &arguments.csv)])?;
    let mut output = Output::open(arguments.json.as_deref())?;
    let csv = arguments.csv.as_deref().map(|path| create("--csv", path)).transpose()?;
    if arguments.csv.as_deref().is_some_and(is_stdout) {
        output = output.without_tables();
    }
    let predictions = Predictions::new(&model.coefficients, record.samples(), horizon);
    let report = PredictReport::new(name, &model, &record, horizon, &predictions);
    if let Some(file) = csv {
        let refused = |source| {
            let path = arguments.csv.clone().unwrap_or_default();
            Failure::from(OutputError::Write { option: "--csv", path, source })
        };
        write_rows(file, &record, &predictions).map_err(refused)?;
    }
    Ok(output.write(|| report.tables(), &report)?)
}

/// Refuses a recording of another period or unit than those of the model.
fn expect_that_they_fit(model: &IdentifiedModel, name: &str, record: &Record) -> Result<(), Failure> {
    if (record.period / model.period - 1.0).abs() > PERIOD_TOLERANCE {
        return Err(Failure::usage(format!(
            "{}: found a period of {} s; allowed: {} s, that of the model {name}",
            record.name(),
            number(record.period),
            number(model.period)
        )));
    }
    let unit = record.unit(IdentifiedOutput::Position);
    match (&unit, &model.unit) {
        (Some(found), Some(known)) if found != known => Err(Failure::usage(format!(
            "{}: found the unit {found} for the output; allowed: {known}, that of the model {name} (or state it: \
             --unit COLUMN=UNIT)",
            record.name()
        ))),
        _ => Ok(()),
    }
}

/// Refuses recordings without a row to compare an h-step prediction with.
fn expect_enough_rows(model: &IdentifiedModel, record: &Record, horizon: usize) -> Result<(), Failure> {
    if horizon == 0 {
        return Err(Failure::usage("--horizon: found 0 samples; allowed: at least one sample"));
    }
    let needed = memory(&model.coefficients) + horizon;
    let longest = record.stretches().map(|stretch| stretch.len()).max().unwrap_or_default();
    if longest < needed {
        return Err(Failure::usage(format!(
            "{}: found at most {longest} rows without a gap; allowed: at least {needed}, to predict {horizon} samples \
             ahead (fewer with a shorter --horizon)",
            record.name()
        )));
    }
    Ok(())
}

/// Writes the rows: time, input, output, predictions, residual.
fn write_rows(file: Box<dyn Write>, record: &Record, predictions: &Predictions) -> io::Result<()> {
    let first_rows: Vec<usize> = record.first_rows().collect();
    let mut csv = CsvRows::new(file);
    csv.write(["recording", "t", "input", "output", "one_step", "h_steps", "free_run", "residual"])?;
    for (k, y) in record.outputs.iter().enumerate() {
        let recording = first_rows.partition_point(|first| *first <= k).to_string();
        let one_step = predictions.one_step[k];
        let predicted = [one_step, predictions.h_step[k], predictions.free_run[k], y - one_step];
        let values = [record.times[k], record.inputs[k], *y].into_iter().chain(predicted).map(field);
        csv.write(std::iter::once(recording).chain(values))?;
    }
    csv.finish()
}

/// The figures, as JSON has them.
#[derive(Debug, Serialize)]
struct PredictReport<'a> {
    verdict: Verdict,
    model: Source<'a>,
    rows: usize,
    period_s: f64,
    horizon: usize,
    irregular_steps: usize,
    /// Rows whose command is outside of those that N was identified from.
    extrapolated: usize,
    unit: Option<String>,
    recordings: &'a [ReadRecording],
    persistence: Steps,
    prediction: Steps,
    free_run: ErrorFigures,
}

/// Where the model comes from.
#[derive(Debug, Serialize)]
struct Source<'a> {
    file: String,
    recordings: &'a str,
    estimator: &'a str,
    verdict: &'a str,
    /// The structure in words.
    structure: String,
    /// Lowest and highest command of the identification.
    commands: [f64; 2],
}

#[derive(Debug, Serialize)]
struct Steps {
    one_step: ErrorFigures,
    h_step: ErrorFigures,
}

impl<'a> PredictReport<'a> {
    fn new(
        file: String,
        model: &'a IdentifiedModel,
        record: &'a Record,
        horizon: usize,
        predictions: &Predictions,
    ) -> Self {
        let outputs = &record.outputs;
        let spread: ErrorStatistics = statistics(outputs.iter().copied());
        let figures = |errors: &ErrorStatistics| ErrorFigures::new(errors, &spread);
        let ModelErrors { one_step, h_step, free_run } = predictions.errors(outputs);
        let [still_one, still_h] = [(&predictions.one_step, 1), (&predictions.h_step, horizon)]
            .map(|(predicted, steps)| still(predicted, outputs, steps));
        let coefficients = &model.coefficients;
        let stands = outputs.iter().all(|y| *y == outputs[0]);
        let irregular_steps = record.irregular_steps();
        // False where the prediction is not finite.
        let is_better = h_step.rmse() < still_h.rmse();
        let found = [
            (Reason::Unstable, !coefficients.poles_within((1.0 / horizon as f64).exp())),
            (Reason::WorseThanHoldingStill, !stands && !is_better),
            (Reason::NotExcited, stands),
            (Reason::StandingOutput, record.standing(horizon) > LARGEST_STANDING),
            (Reason::IrregularTime, record.is_irregular(LARGEST_PART)),
        ];
        let [low, high] = model.commands;
        let structure = coefficients.structure().map(|structure| description(&structure, IdentifiedOutput::Position));
        let (recordings, estimator) = (model.origin.recordings.as_str(), model.origin.estimator.as_str());
        let (verdict, commands) = (model.origin.verdict.as_str(), model.commands);
        let structure = structure.unwrap_or_default();
        Self {
            verdict: Verdict::of(found, h_step.rmse() / still_h.rmse()),
            model: Source { file, recordings, estimator, verdict, structure, commands },
            rows: outputs.len(),
            period_s: record.period,
            horizon,
            irregular_steps,
            extrapolated: record.inputs.iter().filter(|u| **u < low || **u > high).count(),
            unit: record.unit(IdentifiedOutput::Position).or_else(|| model.unit.clone()),
            recordings: &record.recordings,
            persistence: Steps { one_step: figures(&still_one), h_step: figures(&still_h) },
            prediction: Steps { one_step: figures(&one_step), h_step: figures(&h_step) },
            free_run: figures(&free_run),
        }
    }

    /// All figures as tables.
    fn tables(&self) -> String {
        let ahead =
            humantime::format_duration(Duration::from_secs_f64(self.period_s * self.horizon as f64)).to_string();
        let Source { file, recordings, estimator, structure, commands: [low, high], .. } = &self.model;
        let mut text = self.verdict.line(&ahead) + &recordings_text(self.recordings);
        text += &format!(
            "{file}: {structure}; by {estimator} on {recordings}\n{} rows of {} s; {ahead} ahead is {} samples\n",
            self.rows,
            number(self.period_s),
            self.horizon
        );
        if self.extrapolated > 0 {
            let part = percent(100.0 * self.extrapolated as f64 / self.rows as f64);
            let (low, high) = (number(*low), number(*high));
            text += &format!("warning: {part} of the commands are outside of {low} to {high}, which N is known for\n");
        }
        if self.irregular_steps > 0 {
            let steps = self.irregular_steps;
            text += &format!("warning: {steps} steps of time are shorter than half of the period, or do not rise\n");
        }
        text + &self.error_table()
    }

    fn error_table(&self) -> String {
        let row = |name: &str, still: f64, error: &ErrorFigures| {
            let figures = [still, error.rmse, error.sigma, error.max].map(number);
            let ratio = percent(100.0 * error.rmse / still);
            let [still, rmse, sigma, max] = figures;
            vec![name.to_owned(), still, rmse, ratio, sigma, max, percent(error.fit_percent)]
        };
        let (still, predicted) = (&self.persistence, &self.prediction);
        let rows = vec![
            row("one step", still.one_step.rmse, &predicted.one_step),
            row("h steps", still.h_step.rmse, &predicted.h_step),
            row("free run", f64::NAN, &self.free_run),
        ];
        let error = self.unit.as_ref().map_or_else(|| "error".to_owned(), |unit| format!("error, {unit}"));
        let header = [error.as_str(), "rmse still", "model", "of it", "sigma", "largest", "fit"];
        format!("{}\n", table(&header, rows))
    }
}
