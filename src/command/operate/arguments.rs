//! The arguments of `hydraxis operate`, `arm`, `disarm` and `reset`.

use std::time::Duration;

use clap::{Args, ValueEnum};
use pipeline::{channel::Prefix, message::AxisMode};

use crate::arguments::{MachineFile, values::duration};

/// The axes of a running group.
#[derive(Debug, Args)]
pub struct GroupAxes {
    /// The machine that the group was started with
    #[command(flatten)]
    pub machine: MachineFile,
    /// Name of the running group's channels
    #[arg(long)]
    pub prefix: Prefix,
    /// Only this axis; may be given several times
    #[arg(long = "axis", value_name = "NAME")]
    pub axes: Vec<String>,
}

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
or tracks goes on without it. One program operates a group at a time. `hydraxis arm`, `disarm` and `reset` are for the
usual three, and for scripts.")]
pub struct OperateArguments {
    /// Whose axes
    #[command(flatten)]
    pub group: GroupAxes,
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

/// `arm`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis arm --prefix demo                            all axes follow their references, as of `run` without --off
  hydraxis arm --prefix demo --axis boom --mode hold    the boom stays where it is

Enables the axes that are off, waits until they are in the mode, and leaves them in it. An axis that a fault has latched
is refused until `hydraxis reset` has released it, one in another mode until `hydraxis operate` has changed it; then no
axis is enabled. When an axis does not get there, or at Ctrl-C, those that this command has enabled are off again.")]
pub struct ArmArguments {
    /// Whose axes
    #[command(flatten)]
    pub group: GroupAxes,
    /// What the axes are to do
    #[arg(long, default_value = "track")]
    pub mode: ArmMode,
}

/// `--mode` of `arm`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ArmMode {
    /// Follow the reference.
    Track,
    /// Stay where the axis is.
    Hold,
}

impl From<ArmMode> for AxisMode {
    fn from(mode: ArmMode) -> Self {
        match mode {
            ArmMode::Track => Self::Track,
            ArmMode::Hold => Self::Hold,
        }
    }
}

/// `disarm`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis disarm --prefix demo                    all axes neutral, at once
  hydraxis disarm --prefix demo --axis bucket

The axes move again only after `hydraxis arm`, or `operate --enable`. An axis that a fault has latched is neutral already
and stays latched: `hydraxis reset` says by what, and releases it. This is no emergency stop: it needs the whole way from
this program to the valve.")]
pub struct DisarmArguments {
    /// Whose axes
    #[command(flatten)]
    pub group: GroupAxes,
}

/// `reset`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis reset --prefix demo                     says what has latched which axis, and releases all of them
  hydraxis reset --prefix demo --axis boom

A fault latches an axis at neutral, so that it does not move again by itself while somebody looks at why it stopped. Look
first. After a reset the axis is off: nothing moves before `hydraxis arm`. An axis that is not latched is left alone.")]
pub struct ResetArguments {
    /// Whose axes
    #[command(flatten)]
    pub group: GroupAxes,
}
