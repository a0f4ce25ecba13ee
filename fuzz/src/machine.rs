//! Machine files.

use std::{path::Path, time::Duration};

use control_proc::Controller;
use ident_proc::Identifiers;
use pipeline::{
    machine::{Machine, ReferenceSource, Source},
    message::CoefficientSnapshot,
};
use plant_sim::PlantSim;
use sensor_proc::Acquisition;

/// Number of ticks for which an accepted machine runs.
const TICKS: u64 = 3;
/// Longest model time of a tick, so that a long period is not mistaken for a hang.
const LONGEST: Duration = Duration::from_millis(20);
/// Longest training with which a machine is built, in samples. The memory for the training is allocated at once, and
/// the machine file allows days.
const LONGEST_TRAINING: usize = 10_000;

/// Reads a machine file. After the first NUL byte follow settings `KEY=VALUE`, separated by NUL bytes.
pub fn machine_file(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    let mut parts = text.split('\0');
    let file = parts.next().unwrap_or_default();
    let settings: Vec<(String, String)> =
        parts.filter_map(|part| part.split_once('=')).map(|(key, value)| (key.into(), value.into())).collect();
    match Machine::parse(file, "machine.toml", Path::new("/nowhere"), &settings) {
        Ok(machine) => run(&machine),
        Err(error) => {
            let said = error.to_string();
            assert!(!error.problems.is_empty() && said.contains("allowed:"), "{said}");
        }
    }
}

/// Builds an accepted machine, unless it is refused with an error, and runs it.
fn run(machine: &Machine) {
    let reads_a_file = |source: &ReferenceSource| matches!(source, ReferenceSource::Trajectory { .. });
    let is_short = machine.axes.iter().all(|axis| axis.identification.training <= LONGEST_TRAINING);
    // Other targets test the reading of files. Here the name could be that of any file of the computer.
    if machine.source != Source::Sim || machine.axes.iter().any(|axis| reads_a_file(&axis.reference)) || !is_short {
        return;
    }
    let mut plant = match PlantSim::new(machine, 1) {
        Ok(plant) => plant,
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    let mut controller = Controller::new(machine).expect("no file to read");
    controller.arm();
    let (mut acquisition, mut identifiers) = (Acquisition::new(machine), Identifiers::new(machine));
    let mut snapshot = CoefficientSnapshot::default();
    for tick in 0..TICKS {
        let sample = acquisition.update(tick, Some(&plant.read()));
        let command = controller.update(&sample, Some(&snapshot), None);
        assert!(command.axes.iter().all(|axis| (-1.0..=1.0).contains(&axis.command)));
        identifiers.update(&sample, Some(&command), &mut snapshot);
        plant.command(&command);
        plant.advance(machine.timing.period.min(LONGEST));
    }
}
