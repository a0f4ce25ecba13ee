//! How a stage is started as a process of its own.

use std::process::Command;

use pipeline::{
    machine::Machine,
    stage::{Clock, StageKind, StageOptions},
};

use crate::{arguments::MachineFile, failure::Failure};

/// The command that starts a stage of `machine` as a process of its own.
pub fn command(
    kind: StageKind,
    machine: &Machine,
    arguments: &MachineFile,
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
