//! The arguments of `hydraxis bench`.

use std::{path::PathBuf, time::Duration};

use clap::{Args, Subcommand};

use super::{contest::ControllerKind, drawn::Half, tip::BenchTipArguments};
use crate::arguments::{
    BareMachine,
    values::{duration, in_range, whole},
};

/// `bench`.
#[derive(Debug, Subcommand)]
pub enum Bench {
    /// Drive one course with every controller, under every scenario, and compare the tracking errors
    Control(BenchControlArguments),
    /// Identify generated records with `auto` and with every constant forgetting factor, and compare the h-step errors
    Identify(BenchIdentifyArguments),
    /// Drive the bucket's teeth along lines, slopes and a circle, and compare their distances from the way
    Tip(BenchTipArguments),
}

/// Options of the comparison on one machine, which drawn machines have not. What requires `--machines` conflicts with
/// them, too: beside them clap does not ask for `--machines`.
const ONE_MACHINE: [&str; 7] = ["machine", "settings", "model", "dead_time", "seeds", "scenarios", "controllers"];

/// `bench control`.
#[derive(Debug, Args)]
#[command(after_help = "\
Every run simulates 45 s: 8 s in which the identifiers learn, then 37 s in which the tracking error counts. The gains of
the baselines are tuned for each axis by simulation of its commissioned model. That model comes from --model, or from
[axis.NAME.commissioned]; without either, the command first commissions the simulated axis.

Examples:
  hydraxis bench control                                          all controllers and scenarios, some minutes
  hydraxis bench control --scenario payload --scenario digging    two scenarios
  hydraxis bench control --controller pi-feedforward --controller mpc-adaptive --dead-time 150ms --json out.json
  hydraxis bench control --machines 20 --seed 1                   20 drawn machines: model against fallback
  hydraxis bench control --machines 300 --half judge --json -     half of 300 drawn machines
  hydraxis bench control --machines 60 --wrong-models             drawn machines, each with a wrong model
  hydraxis bench control --machines 300 --only 17 --write rigs    the files of machine 17, without a run")]
pub struct BenchControlArguments {
    /// The machine
    #[command(flatten)]
    pub machine: BareMachine,
    /// Dead times of all valves, separated by commas
    #[arg(
        long,
        value_name = "T,..",
        value_parser = duration,
        allow_hyphen_values = true,
        value_delimiter = ',',
        default_value = "10ms,150ms"
    )]
    pub dead_time: Vec<Duration>,
    /// Number of seeds of the simulated noise; they count from 1
    #[arg(
        long,
        value_name = "N",
        default_value_t = 5,
        value_parser = in_range(1_u64, 1000),
        allow_hyphen_values = true,
    )]
    pub seeds: u64,
    /// Only this scenario; may be given several times [default: every built-in scenario with a controller]
    #[arg(long = "scenario", value_name = "NAME")]
    pub scenarios: Vec<String>,
    /// Only this controller; may be given several times [default: all]
    #[arg(long = "controller", value_name = "NAME", value_enum)]
    pub controllers: Vec<ControllerKind>,
    /// Write the figures as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Drawn machines instead of a machine file: this many test rigs of one axis, each commissioned and then driven by
    /// its fallback and by its model
    #[arg(long, value_name = "N", value_parser = in_range(1_u64, 100_000), allow_hyphen_values = true,
          conflicts_with_all = ONE_MACHINE)]
    pub machines: Option<u64>,
    /// Seed of the drawn machines
    #[arg(
        long,
        value_name = "S",
        default_value_t = 1,
        value_parser = whole,
        allow_hyphen_values = true,
        requires = "machines",
        conflicts_with_all = ONE_MACHINE,
    )]
    pub seed: u64,
    /// Only one half of the drawn machines
    #[arg(long, value_enum, requires = "machines", conflicts_with_all = ONE_MACHINE)]
    pub half: Option<Half>,
    /// Only the drawn machine with this number, from 0; may be given several times
    #[arg(long, value_name = "NUMBER", value_parser = whole, allow_hyphen_values = true, requires = "machines",
          conflicts_with_all = ONE_MACHINE)]
    pub only: Vec<u64>,
    /// Give every drawn machine a wrong model in place of the commissioned one, and compare its Smith predictor with
    /// its fallback; machines that commissioning leaves to their fallback are left out
    #[arg(long, requires = "machines", conflicts_with_all = ONE_MACHINE, conflicts_with = "write")]
    pub wrong_models: bool,
    /// Write the machine files of the drawn machines into this folder, and run nothing
    #[arg(long, value_name = "FOLDER", requires = "machines", conflicts_with_all = ONE_MACHINE,
          conflicts_with = "json")]
    pub write: Option<PathBuf>,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "N", value_parser = in_range(1_u16, u16::MAX), allow_hyphen_values = true)]
    pub threads: Option<u16>,
}

/// `bench identify`.
#[derive(Debug, Args)]
#[command(after_help = "\
A record is 40 s to 50 min of a simulated axis at a period of 1 ms to 1 s; 40 % of it is for training. There are 17
classes of records: constant, fast, slow, warm-up, payload, delay, play, quantised, dropouts, spikes, rest, one-sided,
feedback, saturation, drift, units, offsets. A ratio below 1 means that auto is better.

Examples:
  hydraxis bench identify                                  68 records, some minutes
  hydraxis bench identify --records 408 --half judge       204 records that no constant was chosen on
  hydraxis bench identify --seed 7 --json out.json         another set, with the figures of every record
  hydraxis bench identify --quick                          auto, the held model and holding still only
  hydraxis bench identify --only 17                        one record")]
pub struct BenchIdentifyArguments {
    /// Number of records
    #[arg(long, value_name = "N", default_value_t = 68, value_parser = in_range(1_u64, 100_000),
          allow_hyphen_values = true)]
    pub records: u64,
    /// Seed of the records
    #[arg(long, value_name = "S", default_value_t = 1, value_parser = whole, allow_hyphen_values = true)]
    pub seed: u64,
    /// Only one half of the records
    #[arg(long, value_enum)]
    pub half: Option<Half>,
    /// Only the record with this number, from 0; may be given several times
    #[arg(long, value_name = "NUMBER", value_parser = whole, allow_hyphen_values = true)]
    pub only: Vec<u64>,
    /// Number of plants that are recorded at 1, 2, 5, 10, 20, 50 and 100 ms
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = in_range(0_u64, 1000),
          allow_hyphen_values = true)]
    pub plants: u64,
    /// Leave the constant forgetting factors out
    #[arg(long)]
    pub quick: bool,
    /// Write the figures as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "N", value_parser = in_range(1_u16, u16::MAX), allow_hyphen_values = true)]
    pub threads: Option<u16>,
}
