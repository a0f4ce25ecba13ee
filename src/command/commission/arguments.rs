//! The arguments of `hydraxis commission`.

use std::{path::PathBuf, time::Duration};

use clap::Args;

use pipeline::channel::Prefix;

use crate::arguments::{
    MachineFile,
    values::{duration, positive_in, whole},
};

/// `commission`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis commission                                  all axes of the built-in excavator, one after another
  hydraxis commission my.toml --axis boom --out boom.toml --travel 300mm --speed 0.15
  hydraxis commission --enable                         the machine of the group that runs, by its own machine file
  hydraxis commission --prefix demo --enable           the same where several groups run
  hydraxis run my.toml --model model.toml              the next command: control with the models that were found

Moves one axis after the other by small random steps within a window of travel and a bound of speed. From the motion it
finds dead time, time constant, dead bands and a static curve of speed over command, and tunes the gains of the fallback
controller by simulation. All axes are disarmed before and after. A simulated machine does not change meanwhile:
its scenario is nominal, unless --scenario asks for another one.")]
pub struct CommissionArguments {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// Name of the running group, with --enable [default: the only group that runs]
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Commission the machine of a running group, over its channels: arm its axes, one after the other; all others are
    /// disarmed meanwhile [default: a simulated machine, in one process]
    #[arg(long)]
    pub enable: bool,
    /// Only this axis; may be given several times [default: all axes]
    #[arg(long = "axis", value_name = "NAME")]
    pub axes: Vec<String>,
    /// Model file to write
    #[arg(long, value_name = "MODEL.toml", default_value = "model.toml")]
    pub out: PathBuf,
    /// Overwrite the model file if it exists
    #[arg(long)]
    pub force: bool,
    /// Width of the window around the present position of an axis, in m or with its unit, such as 300mm [default: 0.4
    /// of the travel between the soft limits]
    #[arg(long, value_name = "LENGTH", value_parser = positive_in("m"), allow_hyphen_values = true)]
    pub travel: Option<f64>,
    /// Bound of the speed, in m/s or with its unit, such as 50mm/s [default: a quarter of max_speed of the axis]
    #[arg(long, value_name = "SPEED", value_parser = positive_in("m/s"), allow_hyphen_values = true)]
    pub speed: Option<f64>,
    /// Length of the experiment with each axis
    #[arg(long, value_parser = duration, allow_hyphen_values = true, default_value = "120s")]
    pub duration: Duration,
    /// Seed of the random steps and of the simulated noise
    #[arg(long, default_value_t = 1, value_parser = whole, allow_hyphen_values = true)]
    pub seed: u64,
    /// Write a report with pictures, one HTML file that needs no other: the experiment, the model, and the loops
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Write the figures as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
