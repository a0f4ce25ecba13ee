//! The arguments of `hydraxis simulate`.

use std::{path::PathBuf, time::Duration};

use clap::Args;

use crate::arguments::{
    MachineFile,
    values::{duration, whole},
    with_scenarios,
};

/// `simulate`.
#[derive(Debug, Args)]
#[command(after_help = with_scenarios("\
Examples:
  hydraxis simulate --scenario payload --plot motion.svg              the control loop, and a picture of its motion
  hydraxis simulate --scenario open-loop --axis boom --plot boom.svg  no controller, commands of the scenario
  hydraxis simulate --open-loop u.csv > y.csv                         no controller, your commands: columns t, boom, ..

Computes the loop of `hydraxis run --lockstep` in one process and gives the same figures. Runs with equal seeds are bit
for bit equal. Without a controller only the plant is simulated, and the trajectory goes to standard output.")
)]
pub struct SimulateArguments {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// Length of the simulated time [default: 20s for a simulated machine, the whole record for a replayed one]
    #[arg(long, value_parser = duration, allow_hyphen_values = true)]
    pub duration: Option<Duration>,
    /// Simulate only the plant, under the commands of a CSV file: column `t` (s), and one column per axis with commands
    /// in [-1, 1]. Each row is held until the next one
    #[arg(long, value_name = "U.csv", conflicts_with = "duration")]
    pub open_loop: Option<PathBuf>,
    /// Records of the motion
    #[command(flatten)]
    pub recording: RecordingArguments,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1, value_parser = whole, allow_hyphen_values = true)]
    pub seed: u64,
    /// Write the figures as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Records of the motion that `simulate` writes.
#[derive(Debug, Args)]
pub struct RecordingArguments {
    /// Write commands and true states as CSV to a file, or to standard output with -
    #[arg(long, value_name = "FILE.csv")]
    pub trajectory: Option<PathBuf>,
    /// Draw commands, positions and errors over time, and a machine with a mechanism in a few poses, into a file that
    /// ends with .svg or .png, or as SVG to standard output with -
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
    /// Only this axis in trajectory and picture; may be given several times [default: all axes]
    #[arg(long = "axis", value_name = "NAME")]
    pub axes: Vec<String>,
}
