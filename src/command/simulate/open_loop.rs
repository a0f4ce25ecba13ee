//! The plant without a controller, under commands that are held from row to row.

use std::time::Duration;

use pipeline::{
    machine::{Machine, Timing},
    message::ValveCommand,
};
use plant_sim::PlantSim;

use super::{arguments::SimulateArguments, commands::Commands, recorder::Recorder, ticks};
use crate::{failure::Failure, report::table::progress};

/// Simulates the plant and records its motion.
///
/// # Errors
/// The commands or the machine are wrong, or a record cannot be written.
pub fn run(machine: &Machine, arguments: &SimulateArguments) -> Result<(), Failure> {
    let commands = match &arguments.open_loop {
        Some(file) => Commands::read(file, machine).map_err(|error| Failure::usage(error).about("--open-loop"))?,
        None => Commands::Sines {
            sines: &machine.scenario.commands,
            period: machine.timing.period,
            rows: ticks(machine, None, arguments.duration)? as usize,
        },
    };
    // A long row is held on purpose. Without this the drive would take it for a controller that has died.
    let patient = Machine { timing: Timing { drive_timeout: Duration::MAX, ..machine.timing }, ..machine.clone() };
    let mut plant = PlantSim::new(&patient, arguments.seed).map_err(Failure::usage)?;
    let mut recorder = Recorder::for_open_loop(machine, &arguments.recording, &commands)?;
    let neutral = machine.axes.iter().enumerate().filter(|(index, _)| !commands.has(*index));
    let neutral: Vec<&str> = neutral.map(|(_, axis)| axis.name.as_str()).collect();
    if !neutral.is_empty() {
        eprintln!("without a column, neutral: {}", neutral.join(", "));
    }

    let rows = commands.rows();
    let progress = progress(rows as u64, "rows");
    let mut command = ValveCommand::default();
    for row in 0..rows {
        if let Some(last) = row.checked_sub(1) {
            let mut rest = commands.since_begin(row) - commands.since_begin(last);
            // The plant gives the same states for any division of time; the picture shows the motion between distant
            // rows.
            while rest > machine.timing.period {
                plant.advance(machine.timing.period);
                rest -= machine.timing.period;
                recorder.draw(commands.time(row) - rest.as_secs_f64(), &plant, &command);
            }
            plant.advance(rest);
        }
        commands.fill(row, &mut command);
        recorder.row(commands.time(row), &plant, &command)?;
        if !recorder.is_wanted() {
            break;
        }
        plant.command(&command);
        if row % 1024 == 0 {
            progress.set_position(row as u64);
        }
    }
    progress.finish_and_clear();
    recorder.finish()
}
