//! The arguments of `hydraxis operate`.

use std::time::Duration;

use clap::{Args, ValueEnum};
use pipeline::{channel::Prefix, message::AxisMode};

use super::{MachineFile, values::duration};

/// `operate`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis run --prefix demo --off --duration 10min     a machine of which nothing moves yet; then, elsewhere:
  hydraxis operate --prefix demo --axis boom --mode manual --command 0.2 --enable
  hydraxis operate --prefix demo --axis boom --mode hold --target 0.8 --enable
  hydraxis operate --prefix demo --mode hold --leave    all axes stop and stay where they come to a stand
  hydraxis operate --prefix demo --mode off

Modes:
  off     neutral at once; also ends a fault. The axis moves again only with --enable
  manual  --command goes to the valve, within limits of magnitude and rate and nearing a soft limit ever more slowly
  hold    goes to --target, bounded in speed, acceleration and jerk, and stays there
  track   follows its reference: the generator of the machine file, or the reference channel

An axis that is off, after a fault too, leaves it only with --enable. Among the other modes an axis changes without.
Ctrl-C makes the axes neutral and off. So does, in manual, the death of this program, within 0.1 s; an axis that holds
or tracks goes on without it. One program operates a group at a time.")]
pub struct Operate {
    /// The machine that the group was started with
    #[command(flatten)]
    pub machine: MachineFile,
    /// Name of the running group's channels
    #[arg(long)]
    pub prefix: Prefix,
    /// Only this axis; may be given several times
    #[arg(long = "axis", value_name = "NAME")]
    pub axes: Vec<String>,
    /// What the axes are to do
    #[arg(long)]
    pub mode: Mode,
    /// Valve command in [-1, 1], positive extends; manual only
    #[arg(long, value_name = "U", allow_negative_numbers = true)]
    pub command: Option<f64>,
    /// Where to hold, m; without it where the axis comes to a stand
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub target: Option<f64>,
    /// Let axes move that are off
    #[arg(long)]
    pub enable: bool,
    /// End as soon as the axes are in the mode, and leave them in it; hold and track only
    #[arg(long, conflicts_with = "duration")]
    pub leave: bool,
    /// End, neutral and off, after so long in the mode; without it at Ctrl-C
    #[arg(long, value_parser = duration)]
    pub duration: Option<Duration>,
}

/// `--mode`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// Neutral.
    Off,
    /// A command.
    Manual,
    /// A target.
    Hold,
    /// The reference.
    Track,
}

impl From<Mode> for AxisMode {
    fn from(mode: Mode) -> Self {
        match mode {
            Mode::Off => Self::Off,
            Mode::Manual => Self::Manual,
            Mode::Hold => Self::Hold,
            Mode::Track => Self::Track,
        }
    }
}
