//! `hydraxis check`: everything that can be known to be wrong before anything starts.

use control_proc::Controller;
use pipeline::machine::{Machine, Source};
use plant_sim::PlantSim;
use sensor_proc::source::Replay;

use crate::{cli, failure::Failure, stage};

/// Checks a machine file and says what it describes.
pub fn run(arguments: &cli::MachineFile) -> Result<(), Failure> {
    let machine = stage::load(arguments)?;
    deep(&machine)?;
    let names: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    let source = match &machine.source {
        Source::Sim => "simulated".to_owned(),
        Source::Replay(file) => format!("replayed from {}", file.display()),
    };
    println!(
        "{}: {} axes ({}), every {}, {source}: no problem found.",
        machine.name,
        names.len(),
        names.join(", "),
        humantime::format_duration(machine.timing.period)
    );
    Ok(())
}

/// What the machine file points at and what its values amount to: trajectories, recordings, plants.
pub fn deep(machine: &Machine) -> Result<(), Failure> {
    let mut problems = Vec::new();
    problems.extend(Controller::new(machine).err().map(|error| error.to_string()));
    match &machine.source {
        Source::Sim => problems.extend(PlantSim::new(machine, 0).err().map(|error| error.to_string())),
        Source::Replay(file) => problems.extend(Replay::new(machine, file).err().map(|error| error.to_string())),
    }
    if problems.is_empty() { Ok(()) } else { Err(Failure::Usage(problems.join("\n"))) }
}

/// Rows of the recording that the machine replays, if it does.
pub fn recorded_ticks(machine: &Machine) -> Result<Option<u64>, Failure> {
    match &machine.source {
        Source::Sim => Ok(None),
        Source::Replay(file) => Ok(Some(Replay::new(machine, file).map_err(Failure::usage)?.len())),
    }
}
