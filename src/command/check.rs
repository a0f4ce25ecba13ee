//! `hydraxis check`: everything that can be known to be wrong before anything starts.

use control_proc::Controller;
use pipeline::machine::{Machine, Source};
use plant_sim::PlantSim;
use sensor_proc::source::Replay;

use crate::{
    arguments::{MachineFile, load},
    failure::Failure,
    report::output::show,
};

/// Checks a machine file and says what it describes.
pub fn run(arguments: &MachineFile) -> Result<(), Failure> {
    let machine = load(arguments)?;
    deep(&machine)?;
    let names: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    let source = match &machine.source {
        Source::Sim => "simulated".to_owned(),
        Source::Replay(file) => format!("replayed from {}", file.display()),
    };
    show(&format!(
        "{}: {} axes ({}), every {}, {source}: no problem found.\n",
        machine.name,
        names.len(),
        names.join(", "),
        humantime::format_duration(machine.timing.period)
    ))
}

/// What the machine file points at and what its values amount to, axis by axis: trajectories, recordings, plants.
/// Returns the rows of the recording that the machine replays, if it does.
pub fn deep(machine: &Machine) -> Result<Option<u64>, Failure> {
    let (mut problems, mut rows) = (Vec::new(), None);
    for axis in &machine.axes {
        let alone = Machine { axes: vec![axis.clone()], ..machine.clone() };
        problems.extend(Controller::new(&alone).err().map(|error| error.to_string()));
        match &machine.source {
            Source::Sim => problems.extend(PlantSim::new(&alone, 0).err().map(|error| error.to_string())),
            Source::Replay(file) => match Replay::new(&alone, file) {
                Ok(replay) => rows = Some(replay.len()),
                Err(error) => problems.push(format!("source.file: {error}")),
            },
        }
    }
    // A file that all axes share is as wrong for each.
    problems.dedup();
    if problems.is_empty() { Ok(rows) } else { Err(Failure::Usage(problems.join("\n"))) }
}
