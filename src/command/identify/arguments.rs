//! The arguments of `hydraxis identify`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use pipeline::{
    hammerstein::{MAX_DELAY, MAX_LINEAR, MAX_ORDER},
    machine::{Estimator, Form, Split},
};

use super::model_out::ModelOut;
use crate::arguments::{
    ColumnArguments,
    values::{DeadBand, Knots, Rows, Samples, estimator, forgetting, in_range, positive},
};

/// Most files at a time.
const MOST_JOBS: usize = 1024;

/// `identify`.
#[derive(Debug, Args)]
#[command(allow_negative_numbers = true)]
#[command(after_help = "\
Examples:
  hydraxis identify boom.csv --train 0.4                      offline on 40 % of the rows, adaptive on the rest
  hydraxis identify boom.csv --estimator constant:0.995       a constant forgetting factor, not the paper's fuzzy one
  hydraxis identify boom.csv --input duty --output position --period 10ms --nk 20 --json -
  hydraxis identify boom.csv --na 2 --integrator --drift --dead-band 0.07,0.1 --knots 0,0.2,0.5
  hydraxis identify step1.csv step2.csv --test step3.csv      several recordings, tested on another one
  hydraxis identify log.txt --input \"Valve command\" --output 4 --unit 4=mm
  hydraxis identify run.mcap --axis boom                      an axis of a recording of `hydraxis record`
  hydraxis identify boom.csv --report boom.html --model-out boom.toml --csv boom_models.csv
  hydraxis identify boom.csv --select --na 2 --compare        search the structure with na = 2, compare estimators
  hydraxis identify recordings/ --jsonl models.jsonl          each file on its own, a line of JSON for each

Identifies a Hammerstein model offline on the first rows. Then it compares, on the other rows, the held classical model
with the adaptive model that is updated at each row. A row has y(k), and the u(k) that was applied from t(k) on. The
most important figure is the h-step error: the error of a prediction --horizon ahead with the coefficients held, which
is how a predictive controller uses the model.")]
pub struct IdentifyArguments {
    /// Recordings: tables with one row per sample, with commas, semicolons, tabs or blanks between the fields, or MCAP
    /// as `hydraxis record` writes it. Nothing is combined over the gap between two of them. With --jsonl also folders
    #[arg(required = true)]
    pub data: Vec<PathBuf>,
    /// Recording for the test; may be given several times. All other recordings are for training then
    #[arg(long, value_name = "FILE")]
    pub test: Vec<PathBuf>,
    /// The columns
    #[command(flatten)]
    pub columns: ColumnArguments,
    /// Rows for offline identification, as a number or as a fraction of all rows; the other rows are the test part
    #[arg(long, default_value = "0.5", conflicts_with = "test")]
    pub train: Rows,
    /// Order of A [default: 3]
    #[arg(long, value_parser = in_range(1, MAX_LINEAR))]
    pub na: Option<usize>,
    /// Order of B [default: 1]
    #[arg(long, value_parser = in_range(0, MAX_LINEAR - 1))]
    pub nb: Option<usize>,
    /// Delay from input to output, samples [default: 1]
    #[arg(long, value_parser = in_range(1, MAX_DELAY))]
    pub nk: Option<usize>,
    /// Order of the polynomials of the nonlinearity [default: 3, or the number of knots]
    #[arg(long, value_parser = in_range(1, MAX_ORDER))]
    pub order: Option<usize>,
    /// Put an integrator into A, and estimate the other coefficients on the increments of the output
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub integrator: Option<bool>,
    /// Estimate a constant of the difference equation as well (gravity, leakage)
    #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true")]
    pub drift: Option<bool>,
    /// Dead band of the valve, as magnitudes of the command: one for both directions, or below and above zero [default:
    /// 0]
    #[arg(long, value_name = "LOW[,HIGH]")]
    pub dead_band: Option<DeadBand>,
    /// Hinges instead of powers: the magnitudes of the input, beyond the dead band, at which they begin
    #[arg(long, value_name = "K1,K2,..")]
    pub knots: Option<Knots>,
    /// Identify the velocity, which is the backward difference of the output divided by the period
    #[arg(long)]
    pub velocity: bool,
    /// First search the structure on the training part: fit on its first 70 %, judge on the rest. Options of the
    /// structure are kept, `--integrator=false` as well
    #[arg(long)]
    pub select: bool,
    /// Run every estimator on the record with these settings, and compare them in a table
    #[arg(long)]
    pub compare: bool,
    /// Prediction horizon of the h-step error: samples, or a duration such as 0.5s [default: 0.5s, at least one sample]
    #[arg(long)]
    pub horizon: Option<Samples>,
    /// Algorithm that adapts the coefficients online: auto (several estimators, weighted by how well they predict),
    /// paper (the paper's method as printed: Table 1, (17), (21), universes of 4 mm and 2 mm, y in m), rules (Table 1
    /// with the universes of the options below), constant:L (forgetting factor L), fuzzy:LOW (Table 1 on normalised
    /// errors, factor LOW at the least), fortescue:N0 (memory of N0 samples while errors stay small), directional:L
    /// (forgets along the regressor only), or window:N (the last N samples)
    #[arg(long, default_value = "auto", value_parser = estimator)]
    pub estimator: Estimator,
    /// Old name of `--estimator`, refused with the new one
    #[arg(long, hide = true, num_args = 0..=1, default_missing_value = "", value_parser = forgetting)]
    pub forgetting: Option<String>,
    /// Coefficients that are updated online; auto runs estimators of both forms
    #[arg(long, value_enum, default_value = "linear")]
    pub form: FormArgument,
    /// How the products of the over-parametrised form are separated [default: als; paper with --estimator paper]
    #[arg(long, value_enum)]
    pub split: Option<SplitArgument>,
    /// Settings of the fuzzy forgetting factor of the estimators rules and fuzzy:LOW: a TOML file with the keys of the
    /// table `fuzzy` of a machine file
    #[arg(long, value_name = "FILE")]
    pub fuzzy: Option<PathBuf>,
    /// Prediction error of the fuzzy value PB of the estimator rules, in the unit of the output [default: 40 times the
    /// offline residual]
    #[arg(long, value_name = "E", value_parser = positive)]
    pub error_universe: Option<f64>,
    /// Change of the error of the fuzzy value PB of the estimator rules [default: half of --error-universe]
    #[arg(long, value_name = "DE", value_parser = positive)]
    pub variation_universe: Option<f64>,
    /// Write the figures as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write a report with pictures, one HTML file that needs no other: predictions, residuals, N(u), the coefficients
    /// over time, poles
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Write the adaptive model as it is in the end: for `hydraxis predict` (.toml), as a C header (.h), as a Python
    /// module (.py), or as a MATLAB function (.m)
    #[arg(long, value_name = "FILE", value_parser = ModelOut::parse)]
    pub model_out: Option<ModelOut>,
    /// Write predictions, residuals and coefficients row by row as CSV to a file, or to standard output with -
    #[arg(long, value_name = "FILE.csv")]
    pub csv: Option<PathBuf>,
    /// Identify a model on each recording on its own, and write a line of JSON for each: the file, its SHA-256, the
    /// options, and the figures of --json or the error with its kind and place. Exit code 1 if a file failed
    #[arg(long, value_name = "OUT", conflicts_with_all = ["test", "json", "report", "model_out", "csv"])]
    pub jsonl: Option<PathBuf>,
    /// Go on where another run has ended: files with a line of the same options in OUT are left out, unless their
    /// content has changed. A last line that a kill has torn is removed
    #[arg(long, requires = "jsonl")]
    pub resume: bool,
    /// Files at a time [default: one for each core]
    #[arg(long, value_name = "N", requires = "jsonl", value_parser = in_range(1, MOST_JOBS))]
    pub jobs: Option<usize>,
}

/// `--form`.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum FormArgument {
    /// a and b, with the offline nonlinearity held (the paper's steps 3 and 6)
    Linear,
    /// all coefficients of the over-parametrised form
    Full,
}

impl From<FormArgument> for Form {
    fn from(argument: FormArgument) -> Self {
        match argument {
            FormArgument::Linear => Self::Linear,
            FormArgument::Full => Self::Full,
        }
    }
}

/// `--split`.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum SplitArgument {
    /// alternating least squares on the normal equations
    Als,
    /// the paper's formula (17)
    Paper,
}

impl From<SplitArgument> for Split {
    fn from(argument: SplitArgument) -> Self {
        match argument {
            SplitArgument::Als => Self::Als,
            SplitArgument::Paper => Self::Paper,
        }
    }
}
