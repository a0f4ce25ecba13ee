//! The command lines that start a stage, and the recorder, as processes of their own.

use std::{io, process::Command};

use pipeline::{
    channel::Prefix,
    machine::{Machine, MachineError, Source},
    stage::{Clock, StageKind, StageOptions},
};
use thiserror::Error;

use crate::{arguments::MachineFile, recording::store::Place};

/// Why no command line can be made for a stage.
#[derive(Debug, Error)]
pub enum LaunchError {
    /// The path of this program is not known.
    #[error("the path of the program hydraxis cannot be found")]
    OwnPath(#[source] io::Error),
    /// The model file cannot be read any more.
    #[error(transparent)]
    Machine(#[from] MachineError),
}

/// The subcommand of a stage: on a CAN bus another one than plant-sim is in its place.
fn subcommand(kind: StageKind, machine: &Machine) -> &'static str {
    if kind == StageKind::PlantSim && machine.source == Source::Can { "can-proc" } else { kind.name() }
}

/// The command that starts a stage of `machine`: this program, or the one that the machine file names. `wiring`: the
/// devices that the group was started with, where they are on a CAN bus.
///
/// # Errors
/// The path of this program is not known, or the model file cannot be read.
pub fn command(
    kind: StageKind,
    machine: &Machine,
    arguments: &MachineFile,
    options: &StageOptions,
    wiring: Option<u64>,
) -> Result<Command, LaunchError> {
    let mut command = match &machine.stage(kind).command {
        Some(words) => {
            let mut command = Command::new(&words[0]);
            command.args(&words[1..]);
            command
        }
        None => {
            let mut command = Command::new(std::env::current_exe().map_err(LaunchError::OwnPath)?);
            command.arg(subcommand(kind, machine));
            // Only this program knows the option. Another one learns the end of the supervisor from SIGTERM, and from
            // the end of its standard input.
            command.arg("--parent").arg(std::process::id().to_string());
            command
        }
    };
    command.args(&arguments.bare.machine);
    for (key, value) in arguments.settings()? {
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
    let source = if machine.source == Source::Sim { StageKind::PlantSim } else { StageKind::SensorProc };
    // A foreign program does not know the option, and is not held back.
    if options.is_recorded && kind == source && machine.stage(kind).command.is_none() {
        command.arg("--recorded");
    }
    if let (Some(wiring), StageKind::PlantSim, None) = (wiring, kind, &machine.stage(kind).command) {
        command.arg("--wiring").arg(wiring.to_string());
    }
    if options.first_tick > 0 && kind == StageKind::SensorProc {
        command.arg("--first-tick").arg(options.first_tick.to_string());
    }
    Ok(command)
}

/// The command that records all channels of a group.
///
/// # Errors
/// The path of this program is not known.
pub fn record_command(place: &Place, prefix: &Prefix) -> Result<Command, LaunchError> {
    let mut command = Command::new(std::env::current_exe().map_err(LaunchError::OwnPath)?);
    command.args(["record", "--parent", &std::process::id().to_string(), "--prefix", &prefix.to_string()]);
    match place {
        Place::File(file) => command.arg("--output").arg(file),
        Place::Folder(folder, limit) => {
            command.arg("--folder").arg(folder).arg("--limit").arg(format!("{}MB", *limit as f64 * 1e-6))
        }
    };
    Ok(command)
}
