//! The arguments of `hydraxis bench tip`.

use std::path::PathBuf;

use clap::Args;

use super::{controller::Without, task::TipTaskKind};
use crate::arguments::{
    BareMachine,
    values::{in_range, payload, teeth_speed, whole},
};

/// Options of the six tasks, which drawn tasks have not. What requires `--drawn` conflicts with them, too: beside them
/// clap does not ask for `--drawn`.
const NAMED: [&str; 5] = ["tasks", "speeds", "payloads", "seeds", "picture"];

/// `bench tip`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis bench tip                                               six tasks, all scenarios, some minutes
  hydraxis bench tip --task level --scenario nominal --payload 0
  hydraxis bench tip --speed 0.2m/s --speed 0.5m/s --json tip.json
  hydraxis bench tip --scenario nominal --payload 0 --without all  and by the fallback less each measure
  hydraxis bench tip --drawn 100 --seed 7                          tasks drawn at random, in reach and out of it")]
pub struct BenchTipArguments {
    /// The machine
    #[command(flatten)]
    pub machine: BareMachine,
    /// Only this task; may be given several times [default: all]
    #[arg(long = "task", value_name = "NAME", value_enum)]
    pub tasks: Vec<TipTaskKind>,
    /// Speed of the teeth; may be given several times [default: 0.2, 0.35 and 0.5 m/s]
    #[arg(long = "speed", value_name = "V", value_parser = teeth_speed, allow_hyphen_values = true)]
    pub speeds: Vec<f64>,
    /// Mass in the bucket, in kg or with its unit, such as 1.5t; may be given several times [default: 0, 1000 and 1500]
    #[arg(long = "payload", value_name = "KG", value_parser = payload, allow_hyphen_values = true)]
    pub payloads: Vec<f64>,
    /// Only this scenario; may be given several times [default: every built-in scenario with a controller]
    #[arg(long = "scenario", value_name = "NAME")]
    pub scenarios: Vec<String>,
    /// Also drive with the fallback less this measure; may be given several times
    #[arg(long, value_name = "MEASURE", value_enum)]
    pub without: Vec<Without>,
    /// Number of seeds of the simulated noise; they count from 1
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        value_parser = in_range(1_u64, 1000),
        allow_hyphen_values = true,
    )]
    pub seeds: u64,
    /// Write the figures as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Draw the machine, the way and the error of the teeth: an SVG of one task, speed, payload,
    /// scenario and seed by at most four controllers
    #[arg(long, value_name = "FILE.svg")]
    pub picture: Option<PathBuf>,
    /// Drive so many tasks that are drawn at random, each with a load and under one of the scenarios
    #[arg(long, value_name = "N", value_parser = in_range(1_u64, 100_000), allow_hyphen_values = true,
          conflicts_with_all = NAMED)]
    pub drawn: Option<u64>,
    /// Seed of the drawn tasks
    #[arg(
        long,
        value_name = "S",
        default_value_t = 1,
        value_parser = whole,
        allow_hyphen_values = true,
        requires = "drawn",
        conflicts_with_all = NAMED,
    )]
    pub seed: u64,
    /// Number of threads [default: one for each core]
    #[arg(long, value_name = "N", value_parser = in_range(1_u16, u16::MAX), allow_hyphen_values = true)]
    pub threads: Option<u16>,
}
