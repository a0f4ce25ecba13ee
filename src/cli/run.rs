//! The arguments of `hydraxis run`, `simulate`, `check`, and of the stages.

use std::{path::PathBuf, time::Duration};

use clap::Args;
use pipeline::channel::Prefix;

use super::values::{duration, setting};

/// A machine and what is changed of it.
#[derive(Debug, Args)]
pub struct MachineFile {
    /// Machine file; without one the built-in four-axis excavator
    #[arg(value_name = "MACHINE.toml")]
    pub machine: Option<PathBuf>,
    /// Use another value for a key of the machine file; may be given several times
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = setting)]
    pub settings: Vec<(String, String)>,
}

/// `run`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis run                                        the built-in excavator in real time, 20 s
  hydraxis run --lockstep --duration 60s --seed 7     as fast as the machine allows, bit for bit repeatable
  hydraxis run my.toml --set axis.boom.forgetting=constant:0.995 --json out.json")]
pub struct Run {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// How long; without it 20 s when the machine is simulated, the whole record when it is replayed
    #[arg(long, value_parser = duration)]
    pub duration: Option<Duration>,
    /// Lock-step instead of real time: the next tick begins when the last is answered
    #[arg(long)]
    pub lockstep: bool,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Name of the group's channels; without it one that no other run has
    #[arg(long)]
    pub prefix: Option<Prefix>,
    /// Write the figures as JSON, to a file or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// `simulate`.
#[derive(Debug, Args)]
pub struct Simulate {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// How long, in the machine's time; without it 20 s, or the whole record when it is replayed
    #[arg(long, value_parser = duration)]
    pub duration: Option<Duration>,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Write the figures as JSON, to a file or to standard output with -
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// One stage by name.
#[derive(Debug, Args)]
#[command(after_help = "\
The stages of one group are started with the same machine file, prefix and clock, in any order. They end after
--ticks, or at Ctrl-C. Without --arm control-proc keeps every valve neutral.")]
pub struct Stage {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// Name of the group's channels
    #[arg(long)]
    pub prefix: Prefix,
    /// Lock-step instead of real time
    #[arg(long)]
    pub lockstep: bool,
    /// End after so many ticks
    #[arg(long)]
    pub ticks: Option<u64>,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Let control-proc move the machine
    #[arg(long)]
    pub arm: bool,
    /// End when this process does
    #[arg(long, hide = true)]
    pub parent: Option<i32>,
}
