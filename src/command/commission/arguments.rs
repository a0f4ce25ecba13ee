//! The arguments of `hydraxis commission`.

use std::{path::PathBuf, time::Duration};

use clap::Args;

use pipeline::channel::Prefix;

use crate::arguments::{
    MachineFile,
    values::{duration, positive},
};

/// `commission`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis commission                                  all axes of the built-in excavator, one after another
  hydraxis commission my.toml --axis boom --out boom.toml --travel 0.3 --speed 0.15
  hydraxis commission my.toml --prefix demo --enable   the machine of the group that `hydraxis run --prefix demo` runs
  hydraxis run my.toml --model model.toml              what to type next")]
pub struct CommissionArguments {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// Commission the machine of this running group, over its channels; without it a simulated one, in one process
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Let the running group's axes move, one after another; all others are off meanwhile
    #[arg(long, requires = "prefix")]
    pub enable: bool,
    /// Only this axis; may be given several times
    #[arg(long = "axis", value_name = "NAME")]
    pub axes: Vec<String>,
    /// Model file to write
    #[arg(long, value_name = "MODEL.toml", default_value = "model.toml")]
    pub out: PathBuf,
    /// Overwrite the model file if it is there
    #[arg(long)]
    pub force: bool,
    /// Travel of the window around where an axis stands, m; without it 0.4 of what is between the soft limits
    #[arg(long, value_name = "M", value_parser = positive)]
    pub travel: Option<f64>,
    /// Speed bound, m/s; without it a quarter of the axis' max_speed
    #[arg(long, value_name = "M/S", value_parser = positive)]
    pub speed: Option<f64>,
    /// How long the experiment with each axis takes
    #[arg(long, value_parser = duration, default_value = "60s")]
    pub duration: Duration,
    /// Seed of the random steps and of the simulated noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Write the figures as JSON, to a file or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
