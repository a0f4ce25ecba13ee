//! The arguments of `hydraxis bench`.

use std::{path::PathBuf, time::Duration};

use clap::{Args, Subcommand};

use super::contest::ControllerKind;
use crate::arguments::{BareMachine, values::duration};

/// `bench`.
#[derive(Debug, Subcommand)]
pub enum Bench {
    /// Drive one course with every controller, under every scenario, and compare the tracking errors
    Control(BenchControlArguments),
}

/// `bench control`.
#[derive(Debug, Args)]
#[command(after_help = "\
Every run simulates 45 s: 8 s in which the identifiers learn, then 37 s in which the tracking error counts. The gains of
the baselines are tuned for each axis by simulation of its commissioned model. That model comes from --model, or from
[axis.NAME.commissioned]; without either, the command first commissions the simulated axis.

Examples:
  hydraxis bench control                                          all controllers and scenarios, some minutes
  hydraxis bench control --scenario payload --scenario digging    two scenarios
  hydraxis bench control --controller pi-feedforward --controller mpc-adaptive --dead-time 150ms --json out.json")]
pub struct BenchControlArguments {
    /// The machine
    #[command(flatten)]
    pub machine: BareMachine,
    /// Dead times of all valves, separated by commas
    #[arg(long, value_name = "T,..", value_parser = duration, value_delimiter = ',', default_value = "10ms,150ms")]
    pub dead_time: Vec<Duration>,
    /// Number of seeds of the simulated noise; they count from 1
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=1000))]
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
}
