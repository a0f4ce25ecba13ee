//! The arguments of `hydraxis doctor`.

use std::path::PathBuf;

use clap::Args;

use crate::arguments::{BareMachine, values::in_range};

/// `doctor`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis doctor my.toml                  for the period, the cores and the priorities of this machine
  hydraxis doctor my.toml --seconds 600    a longer look: what comes once in ten minutes shows in no shorter one
  sudo -u control hydraxis doctor my.toml  with the rights of the user that will run it

One line for each thing that makes a machine late: good, bad or unknown, what was found, and after an arrow what to do.
Then how late a thread was woken that slept until one time after another, alone and beside a busy thread per core: bad
where all but one in a thousand took more than a quarter of the machine's period. Nothing is changed; the measurement
keeps all cores busy for --seconds, so do not run it beside a machine that moves.

Exit codes: 0 nothing is bad, 1 something is, 2 bad usage or a bad file. What is unknown is left to you.")]
pub struct DoctorArguments {
    /// The machine
    #[command(flatten)]
    pub machine: BareMachine,
    /// How long wake-ups are measured, s: so long alone, and so long under load
    #[arg(long, value_name = "S", default_value = "5", value_parser = in_range(1, 86400))]
    pub seconds: usize,
    /// Write the findings as JSON, to a file or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
