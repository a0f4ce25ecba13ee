//! `hydraxis plant-sim`, `sensor-proc`, `ident-proc` and `control-proc`: one stage in the foreground.
//!
//! This is the only command whose process runs the loop. It sets up signals and the lifeline, and then calls the stage.

use std::path::PathBuf;

use clap::Args;
use pipeline::{
    channel::{Prefix, remove_leftovers},
    machine::{Machine, Source},
    stage::{Clock, StageError, StageKind, StageOptions, missing},
};

use super::{check, replay};
use crate::{
    arguments::{MachineFile, load, values::whole},
    failure::Failure,
    group::{
        lifeline,
        signals::{off_flag, reset_flag, stop_flag},
    },
    recording::rows::read_recordings,
};

/// One stage by name.
#[derive(Debug, Args)]
#[command(after_help = "\
Example, a terminal for each line:
  hydraxis plant-sim --prefix demo
  hydraxis ident-proc --prefix demo
  hydraxis control-proc --prefix demo --arm
  hydraxis sensor-proc --prefix demo

`hydraxis run` starts all stages; this command is for one stage alone. Start all stages of a group with the same machine
file, prefix and clock, in any order. They end after --ticks, or at Ctrl-C. Without --arm control-proc keeps every valve
neutral.")]
pub struct StageArguments {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// Name of the group and of its channels
    #[arg(long)]
    pub prefix: Prefix,
    /// Lock-step instead of real time: the next tick begins when all stages have answered the last one
    #[arg(long)]
    pub lockstep: bool,
    /// End after this number of ticks [default: no end]
    #[arg(long)]
    pub ticks: Option<u64>,
    /// Seed of the simulated noise
    #[arg(long, default_value_t = 1, value_parser = whole, allow_hyphen_values = true)]
    pub seed: u64,
    /// Let control-proc move the machine
    #[arg(long)]
    pub arm: bool,
    /// Number of the first tick, at which a source that was started again goes on
    #[arg(long, hide = true, default_value_t = 0)]
    pub first_tick: u64,
    /// Lock-step: wait for the recorder of the group
    #[arg(long, hide = true, requires = "lockstep")]
    pub recorded: bool,
    /// plant-sim only: the readings of this recording in the place of the simulated ones
    #[arg(long, hide = true)]
    pub recording: Option<PathBuf>,
    /// can-proc only: the number of the devices that the group was started with
    #[arg(long, hide = true)]
    pub wiring: Option<u64>,
    /// End when the process with this number ends, or when standard input does
    #[arg(long, hide = true)]
    pub parent: Option<i32>,
}

/// Runs one stage until its last tick or a signal.
pub fn run(kind: StageKind, arguments: &StageArguments) -> Result<(), Failure> {
    let machine = load(&arguments.machine)?;
    run_as(kind, kind.name(), arguments, &machine, |options| match kind {
        StageKind::PlantSim => match &arguments.recording {
            Some(file) => replay::source::run(&machine, file, options),
            None => plant_sim::process::run(&machine, options),
        },
        StageKind::SensorProc => sensor_proc::process::run_with(&machine, options, read_recordings),
        StageKind::IdentProc => ident_proc::process::run(&machine, options),
        StageKind::ControlProc => control_proc::process::run(&machine, options),
    })
}

/// Runs the stage of a CAN bus, which stands in the place of plant-sim.
pub fn run_can(arguments: &StageArguments) -> Result<(), Failure> {
    let machine = load(&arguments.machine)?;
    if machine.source != Source::Can {
        let found = machine.source.kind();
        return Err(Failure::usage(format!("source.kind: found \"{found}\"; allowed: \"can\"")).about("can-proc"));
    }
    if arguments.lockstep {
        return Err(Failure::usage("--lockstep: found a CAN bus, whose time nobody can hold; allowed: without it"));
    }
    if let Some(started) = arguments.wiring
        && can_proc::number(&machine).is_ok_and(|number| number != started)
    {
        return Err(Failure::usage(
            "can: found other devices or messages than the group was started with: machine file or data base have \
             changed; allowed: what they were, or a group that is started anew",
        ));
    }
    run_as(StageKind::PlantSim, "can-proc", arguments, &machine, |options| can_proc::process::run(&machine, options))
}

fn run_as(
    kind: StageKind,
    name: &'static str,
    arguments: &StageArguments,
    machine: &Machine,
    run: impl FnOnce(StageOptions) -> Result<(), StageError>,
) -> Result<(), Failure> {
    // The supervisor has checked the machine before it starts the stages.
    if kind == StageKind::ControlProc && arguments.parent.is_none() {
        check::expect_controllable(machine)?;
    }
    let clock = if arguments.lockstep { Clock::LockStep } else { Clock::RealTime };
    let options = StageOptions {
        prefix: arguments.prefix.clone(),
        clock,
        ticks: arguments.ticks,
        seed: arguments.seed,
        arm: arguments.arm,
        first_tick: arguments.first_tick,
        is_recorded: arguments.recorded,
        // The supervisor has shown the warnings that were known before the start.
        warn: arguments.parent.is_none() || missing(machine, clock).is_empty(),
        stop: stop_flag()?,
        reset: reset_flag()?,
        off: off_flag()?,
    };
    if let Some(parent) = arguments.parent {
        let held = lifeline::hold(parent, name, lifeline::STAGE_PATIENCE);
        held.map_err(|error| Failure::from(error).about(name))?;
    }
    let result = run(options);
    // The last member of a group that was started by hand removes its files.
    let _ = remove_leftovers(&arguments.prefix);
    result.map_err(|error| Failure::run(error).about(name))
}
