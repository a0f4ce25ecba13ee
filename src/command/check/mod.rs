//! `hydraxis check`: everything that can be found wrong before a process starts.
//!
//! Runs once, before the loop.

mod control;
mod explain;
mod margins;
mod models;
mod plausible;
mod references;
mod schema;
mod sensors;
mod walls;

use std::path::PathBuf;

use clap::Args;
use control_proc::{Controller, tip::TipPlan};
use pipeline::machine::{Axis, DeadBand, Drive, Machine, Source, StageKind};
use plant_sim::PlantSim;
use sensor_proc::Replay;

use super::{
    doctor::Kept,
    mechanism::{overloads, summary},
};
use crate::{
    arguments::{MachineFile, load},
    failure::Failure,
    recording::rows::read_recordings,
    report::output::show,
};

/// `check`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis check my.toml                               everything that is wrong with the file
  hydraxis check my.toml --model model.toml --explain  every value, where it comes from, and what is allowed
  hydraxis check --explain --json - | jq '.[] | select(.key == \"axis.boom.identification.nk\")'
  hydraxis check --schema > machine.schema.json        for an editor that knows JSON schemas

Reads the machine file and every file that it names, and starts nothing. Exit codes: 0 no problem found, 2 a problem.")]
pub struct CheckArguments {
    /// The machine
    #[command(flatten)]
    pub machine: MachineFile,
    /// Show the effective value of every key, where it comes from, and what is allowed
    #[arg(long)]
    pub explain: bool,
    /// With --explain, write the effective values as JSON to a file, or to standard output with -
    #[arg(long, value_name = "FILE", requires = "explain")]
    pub json: Option<PathBuf>,
    /// Write the JSON schema of machine files to standard output, for editors
    #[arg(long, exclusive = true)]
    pub schema: bool,
}

/// Checks a machine file and shows in a few lines what it describes, or all of its values.
pub fn run(arguments: &CheckArguments) -> Result<(), Failure> {
    if arguments.schema {
        return schema::run();
    }
    let machine = load(&arguments.machine)?;
    deep(&machine)?;
    let loops = margins::judge(&machine);
    verdict(&[models::refused(&machine), control::impossible(&machine), loops.problems].concat())?;
    if arguments.explain {
        return explain::run(arguments);
    }
    let names: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
    let source = match &machine.source {
        Source::Sim => "simulated".to_owned(),
        Source::Replay(file) => format!("replayed from {}", file.display()),
        Source::External => match machine.stage(StageKind::PlantSim).command.as_deref() {
            Some(words) => format!("read by {}", words.join(" ")),
            None => "read by a program that is started by hand".to_owned(),
        },
        Source::Can => format!("on CAN bus {}", machine.can.as_ref().map_or("", |can| &can.interface)),
    };
    let text = format!(
        "{}: {} {} ({}), every {}, {source}: no problem found.\n",
        machine.name,
        names.len(),
        if names.len() == 1 { "axis" } else { "axes" },
        names.join(", "),
        humantime::format_duration(machine.timing.period)
    );
    let mechanism = machine.mechanism.as_ref().map(|mechanism| summary(&machine, mechanism));
    let known = [warnings(&machine), plausible::doubtful(&machine), references::excesses(&machine), loops.warnings];
    // A record is replayed as fast as it can be.
    let kept = Kept::last().filter(|_| !matches!(machine.source, Source::Replay(_)));
    let of_computer = kept.map(|kept| plausible::beyond_computer(&machine.timing, &kept)).unwrap_or_default();
    let known = known.into_iter().flatten().chain(of_computer);
    let warnings: String = known.map(|warning| format!("warning: {warning}\n")).collect();
    let notes: String = models::unknown(&machine).into_iter().map(|note| format!("note: {note}\n")).collect();
    let text =
        text + &mechanism.unwrap_or_default() + &sensors::summary(&machine) + &loops.summary + &warnings + &notes;
    Ok(show(&text)?)
}

/// All problems and warnings of a machine that its file is to blame for.
///
/// # Errors
/// The machine has problems that leave nothing to judge.
pub fn findings(machine: &Machine) -> Result<Vec<String>, Failure> {
    deep(machine)?;
    let loops = margins::judge(machine);
    let problems = [models::refused(machine), control::impossible(machine), loops.problems];
    let doubts = [warnings(machine), plausible::doubtful(machine), references::excesses(machine), loops.warnings];
    Ok(problems.into_iter().chain(doubts).flatten().collect())
}

/// What may go wrong in a run of this machine.
pub fn warnings(machine: &Machine) -> Vec<String> {
    [warnings_of_plant(machine), control::doubtful(machine), walls::doubtful(machine)].concat()
}

/// What may go wrong in a run of this machine without a controller.
pub fn warnings_of_plant(machine: &Machine) -> Vec<String> {
    [warnings_of_models(machine), overloads(machine)].concat()
}

/// Which axes of this machine have the model of another one.
pub fn warnings_of_models(machine: &Machine) -> Vec<String> {
    models::doubtful(machine)
}

/// The loops that are unstable with the control settings of this machine.
pub fn unstable(machine: &Machine) -> Vec<String> {
    margins::judge(machine).problems
}

/// Refuses a machine whose loops cannot work, before a controller is simulated.
///
/// # Errors
/// All values with which a loop fails at once, one on each line.
pub fn expect_possible(machine: &Machine) -> Result<(), Failure> {
    verdict(&control::impossible(machine))
}

/// Refuses a machine whose loops cannot work or are unstable, or whose models are not its own, before a controller may
/// move it.
///
/// # Errors
/// All models of other machines, all values with which a loop fails at once, and all unstable loops, one on each line.
pub fn expect_controllable(machine: &Machine) -> Result<(), Failure> {
    if machine.drive == Drive::None {
        return Ok(());
    }
    verdict(&[models::refused(machine), control::impossible(machine), unstable(machine)].concat())
}

/// Refuses a machine with problems, one on each line.
fn verdict(problems: &[String]) -> Result<(), Failure> {
    if problems.is_empty() { Ok(()) } else { Err(Failure::usage(problems.join("\n"))) }
}

/// Why no command within `command_limit` moves the axis in one of its directions, if that is so. A model measured the
/// dead bands, and a simulated valve has them.
fn immovable(axis: &Axis, is_simulated: bool) -> Option<String> {
    let (name, limit) = (&axis.name, axis.control.command_limit);
    // The dead bands of a model hold half of the hysteresis.
    let measured = axis.commissioned.iter().map(|model| ("commissioned", model.dead_band, 0.0));
    let simulated = axis.plant.iter().filter(|_| is_simulated);
    let all = measured.chain(simulated.map(|plant| ("plant", plant.dead_band, 0.5 * plant.hysteresis)));
    let ends = all.flat_map(|(table, DeadBand { extend, retract }, more)| {
        [(table, "extends", extend + more), (table, "retracts", retract + more)]
    });
    let (table, direction, end) = ends.filter(|(.., end)| limit <= *end).max_by(|a, b| a.2.total_cmp(&b.2))?;
    Some(format!(
        "axis.{name}.control.command_limit: found {limit:.4}, with which the axis never {direction}; allowed: more \
         than {end:.4}, where the dead band of [axis.{name}.{table}] with half of the hysteresis ends"
    ))
}

/// Checks, axis by axis, the files that the machine file names and the values that follow from it: trajectories,
/// recordings, plants. Returns the rows of the recording if the machine replays one.
///
/// # Errors
/// All problems, one on each line.
pub fn deep(machine: &Machine) -> Result<Option<u64>, Failure> {
    let (mut problems, mut rows) = (Vec::new(), None);
    for axis in &machine.axes {
        let alone = Machine { axes: vec![axis.clone()], ..machine.clone() };
        problems.extend(Controller::new(&alone).err().map(|error| error.to_string()));
        problems.extend(immovable(axis, machine.source == Source::Sim));
        match &machine.source {
            // The axes of a mechanism are simulated together only.
            Source::Sim if machine.mechanism.is_some() => {
                problems.extend(PlantSim::new(machine, 0).err().map(|error| error.to_string()));
            }
            Source::Sim => problems.extend(PlantSim::new(&alone, 0).err().map(|error| error.to_string())),
            Source::Replay(file) => match read_recordings(&alone, file) {
                Ok(recordings) => rows = Some(Replay::new(&alone, recordings).len()),
                Err(error) => problems.push(format!("source.file: {error}")),
            },
            Source::External | Source::Can => {}
        }
    }
    if machine.source == Source::Can {
        problems.extend(can_proc::bus_address(machine).err().map(|error| error.to_string()));
        problems.extend(can_proc::network(machine).err().map(|error| error.to_string()));
    }
    // The axes of the teeth are planned together only.
    problems.extend(TipPlan::of(machine).err().map(|error| error.to_string()));
    // A file that all axes share has the same problem for each of them.
    problems.dedup();
    verdict(&problems).map(|()| rows)
}
