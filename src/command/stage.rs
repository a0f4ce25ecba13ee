//! `hydraxis STAGE`: one stage in the foreground.

use clap::Args;
use pipeline::{
    channel::{Prefix, remove_leftovers},
    stage::{Clock, StageKind, StageOptions, missing},
};

use crate::{
    arguments::{MachineFile, load},
    failure::Failure,
    group::{
        lifeline,
        signals::{reset_flag, stop_flag},
    },
};

/// One stage by name.
#[derive(Debug, Args)]
#[command(after_help = "\
The stages of one group are started with the same machine file, prefix and clock, in any order. They end after
--ticks, or at Ctrl-C. Without --arm control-proc keeps every valve neutral.")]
pub struct StageArguments {
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
    /// Number of the first tick: where a source that was started again goes on
    #[arg(long, hide = true, default_value_t = 0)]
    pub first_tick: u64,
    /// End when this process does, or standard input
    #[arg(long, hide = true)]
    pub parent: Option<i32>,
}

/// Runs one stage until its last tick or a signal.
pub fn run(kind: StageKind, arguments: &StageArguments) -> Result<(), Failure> {
    let named = |error: &dyn std::fmt::Display| format!("{}: {error}", kind.name());
    let machine = load(&arguments.machine)?;
    let clock = if arguments.lockstep { Clock::LockStep } else { Clock::RealTime };
    let options = StageOptions {
        prefix: arguments.prefix.clone(),
        clock,
        ticks: arguments.ticks,
        seed: arguments.seed,
        arm: arguments.arm,
        first_tick: arguments.first_tick,
        // A supervisor has said what it could foretell.
        warn: arguments.parent.is_none() || missing(&machine, clock).is_empty(),
        stop: stop_flag()?,
        reset: reset_flag()?,
    };
    if let Some(parent) = arguments.parent {
        lifeline::hold(parent, kind.name()).map_err(|error| Failure::Run(named(&error)))?;
    }
    let result = match kind {
        StageKind::PlantSim => plant_sim::process::run(&machine, options),
        StageKind::SensorProc => sensor_proc::process::run(&machine, options),
        StageKind::IdentProc => ident_proc::process::run(&machine, options),
        StageKind::ControlProc => control_proc::process::run(&machine, options),
    };
    // The last member of a group that was started by hand leaves nothing behind.
    let _ = remove_leftovers(&arguments.prefix);
    result.map_err(|error| Failure::Run(named(&error)))
}
