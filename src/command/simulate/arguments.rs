//! The arguments of `hydraxis simulate`.

use std::{path::PathBuf, time::Duration};

use clap::Args;

use crate::arguments::{MachineFile, values::duration, with_scenarios};

/// `simulate`.
#[derive(Debug, Args)]
#[command(after_help = with_scenarios("\
Examples:
  hydraxis simulate --scenario payload --plot motion.svg              the loop as of `run`, and a picture
  hydraxis simulate --scenario open-loop --axis boom --plot boom.svg  no controller, the scenario's commands
  hydraxis simulate --open-loop u.csv > y.csv                         no controller, your commands: columns t, boom, ..")
)]
pub struct SimulateArguments {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// How long, in the machine's time; without it 20 s, or the whole record when it is replayed
    #[arg(long, value_parser = duration)]
    pub duration: Option<Duration>,
    /// Simulate the plant alone, under the commands of a CSV file: column `t` (s) and one per axis, in [-1, 1], each
    /// held until the next row
    #[arg(long, value_name = "U.csv", conflicts_with = "duration")]
    pub open_loop: Option<PathBuf>,
    /// What is kept of the motion
    #[command(flatten)]
    pub recording: Recording,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Write the figures as JSON, to a file or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// What `simulate` keeps of the motion.
#[derive(Debug, Args)]
pub struct Recording {
    /// Write commands and true states as CSV, to a file or to standard output with -
    #[arg(long, value_name = "FILE.csv")]
    pub trajectory: Option<PathBuf>,
    /// Draw commands and positions over time, to a file or to standard output with -
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    /// Only this axis in trajectory and picture; may be given several times
    #[arg(long = "axis", value_name = "NAME")]
    pub axes: Vec<String>,
}
