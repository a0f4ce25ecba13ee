//! The arguments of `hydraxis doctor`.

use std::path::PathBuf;

use clap::Args;

use crate::arguments::{BareMachine, values::in_range};

/// `doctor`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis doctor my.toml                  for the period, the cores and the priorities of this machine file
  hydraxis doctor my.toml --seconds 600    a longer measurement, which also finds delays that are rare
  sudo -u control hydraxis doctor my.toml  with the rights of the user that will run the machine

Shows a line for each property of this computer that can delay a control loop: good, bad or unknown, what was found, and
after an arrow what to do. Then it measures how late a sleeping thread wakes up, alone and beside one busy thread per
core. The result is bad when the 99.9th percentile is more than a quarter of the period of the machine. The command
changes nothing but doctor.json in the folder for black boxes, where it keeps its figures for `hydraxis check`. The
measurement keeps all cores busy for --seconds: do not run it beside a machine that moves.

Exit codes: 0 nothing is bad, 1 something is bad, 2 bad usage or a bad file. You decide about lines that are unknown.")]
pub struct DoctorArguments {
    /// The machine
    #[command(flatten)]
    pub machine: BareMachine,
    /// Length of each of the two measurements, alone and under load, s
    #[arg(
        long,
        value_name = "S",
        default_value = "5",
        value_parser = in_range(1_usize, 86400),
        allow_hyphen_values = true,
    )]
    pub seconds: usize,
    /// Write the findings as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
