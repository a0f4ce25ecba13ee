//! `hydraxis STAGE`: one stage in the foreground.

use std::{
    process::Command,
    sync::{Arc, atomic::AtomicBool},
};

use pipeline::{
    channel::remove_leftovers,
    machine::Machine,
    stage::{Clock, StageKind, StageOptions, missing},
};

use crate::{cli, failure::Failure, lifeline};

/// Runs one stage until its last tick or a signal.
pub fn run(kind: StageKind, arguments: &cli::Stage) -> Result<(), Failure> {
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

/// Reads a machine file with what was typed in its place.
pub fn load(arguments: &cli::MachineFile) -> Result<Machine, Failure> {
    load_bare(&arguments.bare, arguments.scenario.as_deref())
}

/// Reads a machine file with what was typed in its place, under `scenario`.
pub fn load_bare(arguments: &cli::BareMachine, scenario: Option<&str>) -> Result<Machine, Failure> {
    let settings = arguments.settings(scenario).map_err(Failure::usage)?;
    Machine::load(arguments.machine.as_deref(), &settings).map_err(Failure::usage)
}

/// The axes that were named, or all.
pub fn axes(machine: &Machine, names: &[String]) -> Result<Vec<usize>, Failure> {
    if names.is_empty() {
        return Ok((0..machine.axes.len()).collect());
    }
    let known: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    if let Some(name) = names.iter().find(|name| !known.contains(&name.as_str())) {
        return Err(Failure::Usage(format!("--axis: found \"{name}\"; allowed: one of {}", known.join(", "))));
    }
    let wanted = |name: &&str| names.iter().any(|other| other == *name);
    Ok((0..known.len()).filter(|index| wanted(&known[*index])).collect())
}

/// A flag that SIGINT, SIGTERM and SIGHUP set; the last comes when a terminal is closed, and to a stopped process that
/// has lost its parent.
pub fn stop_flag() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [signal_hook::consts::SIGINT, signal_hook::consts::SIGTERM, signal_hook::consts::SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop)).map_err(Failure::run)?;
    }
    Ok(stop)
}

/// A flag that SIGUSR1 sets: count from zero again.
fn reset_flag() -> Result<Arc<AtomicBool>, Failure> {
    let reset = Arc::new(AtomicBool::new(false));
    signal_hook::flag::register(signal_hook::consts::SIGUSR1, Arc::clone(&reset)).map_err(Failure::run)?;
    Ok(reset)
}

/// The command that starts a stage of `machine` as a process of its own.
pub fn command(
    kind: StageKind,
    machine: &Machine,
    arguments: &cli::MachineFile,
    options: &StageOptions,
) -> Result<Command, Failure> {
    let mut command = match &machine.stage(kind).command {
        Some(words) => {
            let mut command = Command::new(&words[0]);
            command.args(&words[1..]);
            command
        }
        None => {
            let executable = std::env::current_exe().map_err(Failure::run)?;
            let mut command = Command::new(executable);
            command.arg(kind.name());
            // Another program would not know the option; it has its signals and the end of its input.
            command.arg("--parent").arg(std::process::id().to_string());
            command
        }
    };
    command.args(&arguments.bare.machine);
    for (key, value) in arguments.settings().map_err(Failure::usage)? {
        command.arg("--set").arg(format!("{key}={value}"));
    }
    command.arg("--prefix").arg(options.prefix.to_string()).arg("--seed").arg(options.seed.to_string());
    if options.clock == Clock::LockStep {
        command.arg("--lockstep");
    }
    if let Some(ticks) = options.ticks {
        command.arg("--ticks").arg(ticks.to_string());
    }
    if options.arm && kind == StageKind::ControlProc {
        command.arg("--arm");
    }
    if options.first_tick > 0 && kind == StageKind::SensorProc {
        command.arg("--first-tick").arg(options.first_tick.to_string());
    }
    Ok(command)
}
