//! What a user types.

use std::{path::PathBuf, str::FromStr, time::Duration};

use clap::{Args, Parser, Subcommand, ValueEnum};
use pipeline::{
    hammerstein::{MAX_DELAY, MAX_LINEAR, MAX_ORDER, Structure},
    machine::{Forgetting, Form, Split, samples_of},
};

/// Identifies and controls the electrohydraulic axes of a machine.
#[derive(Debug, Parser)]
#[command(name = "hydraxis", version, max_term_width = 110)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Identify a Hammerstein model on a recording, offline and adaptive side by side
    Identify(Identify),
}

/// A number of rows, or a part of all rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rows {
    /// So many.
    Count(usize),
    /// This part, between 0 and 1.
    Fraction(f64),
}

impl FromStr for Rows {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Ok(count) = text.parse() {
            return Ok(Self::Count(count));
        }
        match text.parse() {
            Ok(fraction) if fraction > 0.0 && fraction < 1.0 => Ok(Self::Fraction(fraction)),
            _ => Err("allowed: a whole number of rows, or a fraction between 0 and 1".to_owned()),
        }
    }
}

impl Rows {
    /// How many rows of `all`.
    pub fn of(self, all: usize) -> usize {
        match self {
            Self::Count(count) => count,
            Self::Fraction(fraction) => (fraction * all as f64).round() as usize,
        }
    }
}

/// A number of samples, given as such or as a duration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Samples {
    /// So many.
    Count(usize),
    /// So long.
    Duration(Duration),
}

impl FromStr for Samples {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Ok(count) = text.parse() {
            return Ok(Self::Count(count));
        }
        let allowed = |_| "allowed: a whole number of samples, or a duration with its unit such as 0.5s".to_owned();
        humantime::parse_duration(text).map(Self::Duration).map_err(allowed)
    }
}

impl Samples {
    /// How many samples of `period`.
    pub fn at(self, period: Duration) -> usize {
        match self {
            Self::Count(count) => count,
            Self::Duration(duration) => samples_of(duration, period),
        }
    }
}

/// A duration as a plain number of seconds or with its unit.
fn seconds(text: &str) -> Result<Duration, String> {
    let plain = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    let duration = plain.or_else(|| humantime::parse_duration(text).ok());
    duration
        .filter(|duration| !duration.is_zero())
        .ok_or_else(|| "allowed: seconds greater than 0, or a duration with its unit such as 20ms".to_owned())
}

fn forgetting(text: &str) -> Result<Forgetting, String> {
    text.parse()
}

fn in_range(low: usize, high: usize) -> impl Fn(&str) -> Result<usize, String> + Clone {
    move |text| match text.parse() {
        Ok(number) if (low..=high).contains(&number) => Ok(number),
        _ => Err(format!("allowed: a whole number from {low} to {high}")),
    }
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if number > 0.0 && f64::is_finite(number) => Ok(number),
        _ => Err("allowed: a number greater than 0".to_owned()),
    }
}

/// `identify`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis identify boom.csv --train 0.4                      offline on the first 40 % of the rows, adaptive on the rest
  hydraxis identify boom.csv --forgetting constant:0.995      a constant forgetting factor instead of the paper's fuzzy one
  hydraxis identify boom.csv --input duty --output position --period 10ms --nk 20 --json -

A row holds y(k) and the u(k) that was applied from t(k) on. The headline is the h-step error: what the model predicts
`--horizon` ahead with its coefficients held, as a predictive controller uses it.")]
pub struct Identify {
    /// The recording: CSV with a header, one row per sample
    pub data: PathBuf,
    /// Column of the input
    #[arg(long, default_value = "u")]
    pub input: String,
    /// Column of the output
    #[arg(long, default_value = "y")]
    pub output: String,
    /// Sample period; without it the column `t` (s) gives it
    #[arg(long, value_parser = seconds)]
    pub period: Option<Duration>,
    /// Rows for offline identification, or a fraction of all rows; the rest is the test part
    #[arg(long, default_value = "0.5")]
    pub train: Rows,
    /// Order of A
    #[arg(long, default_value_t = Structure::PAPER.na, value_parser = in_range(1, MAX_LINEAR))]
    pub na: usize,
    /// Order of B
    #[arg(long, default_value_t = Structure::PAPER.nb, value_parser = in_range(0, MAX_LINEAR - 1))]
    pub nb: usize,
    /// Delay from input to output, samples
    #[arg(long, default_value_t = Structure::PAPER.nk, value_parser = in_range(1, MAX_DELAY))]
    pub nk: usize,
    /// Order of the polynomials of the nonlinearity
    #[arg(long, default_value_t = Structure::PAPER.order, value_parser = in_range(1, MAX_ORDER))]
    pub order: usize,
    /// How far ahead the h-step error looks: samples, or a duration such as 0.5s
    #[arg(long, default_value = "0.5s")]
    pub horizon: Samples,
    /// Forgetting factor: paper (fuzzy, Table 1) or constant:L
    #[arg(long, default_value = "paper", value_parser = forgetting)]
    pub forgetting: Forgetting,
    /// Which coefficients are updated online
    #[arg(long, value_enum, default_value = "linear")]
    pub form: FormArgument,
    /// How the products of the over-parametrised form are separated
    #[arg(long, value_enum, default_value = "als")]
    pub split: SplitArgument,
    /// Fuzzy settings, a TOML file with the keys of [fuzzy] in a machine file
    #[arg(long, value_name = "FILE")]
    pub fuzzy: Option<PathBuf>,
    /// Prediction error that counts as PB, in the unit of the output [default: 40 times the offline residual]
    #[arg(long, value_name = "E", value_parser = positive)]
    pub error_universe: Option<f64>,
    /// Change of the error that counts as PB [default: half the error universe]
    #[arg(long, value_name = "DE", value_parser = positive)]
    pub variation_universe: Option<f64>,
    /// Write the figures as JSON, to a file or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
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
