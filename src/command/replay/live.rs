//! A recording through the living stages: a group like that of `run`, with the recording in the place of the plant.
//!
//! The machine is simulated for this, whatever it was, so that nothing real moves: `[source]`, `[drive]` and what
//! belongs to a CAN bus are left out of its file.

use std::fs;

use clap::Parser;
use pipeline::channel::Prefix;

use super::{ReplayArguments, machine::Recorded, source::Script};
use crate::{
    command::{Arguments, Command, run},
    failure::Failure,
    recording::MACHINE,
};

/// Sections of the machine file that say what it is connected to.
const CONNECTIONS: [&str; 3] = ["source", "drive", "can"];

/// Runs a group on a recording.
///
/// # Errors
/// The recording has no readings, its machine cannot be simulated, or the run fails.
pub fn live(recorded: &Recorded, arguments: &ReplayArguments) -> Result<(), Failure> {
    let script = Script::read(&arguments.file, arguments.lockstep)?;
    let machine = recorded.folder.path().join(MACHINE);
    fs::write(&machine, simulated(&recorded.machine)?).map_err(Failure::run)?;
    let is_connection = |key: &str| key.split('.').any(|part| CONNECTIONS.contains(&part));
    let recorded_settings = recorded.settings.iter().filter(|(key, _)| !is_connection(key));
    let period = recorded.machine(None, &[])?.timing.period;
    let length = match arguments.lockstep {
        true => period.as_secs_f64() * script.len() as f64,
        false => 1e-9 * script.span_ns() as f64,
    };
    let mut words = vec!["hydraxis".to_owned(), "run".to_owned(), machine.display().to_string()];
    let mut option = |name: &str, value: String| words.extend([format!("--{name}"), value]);
    for (key, value) in recorded_settings {
        option("set", format!("{key}={value}"));
    }
    for (axis, file) in recorded.trajectory_files() {
        option("set", format!("axis.{axis}.reference.file={file:?}"));
    }
    for (key, value) in &arguments.settings {
        option("set", format!("{key}={value}"));
    }
    option("set", format!("stage.plant-sim.command={:?}", stage(arguments)?));
    option("duration", format!("{:.9}s", length.max(period.as_secs_f64())));
    option("prefix", arguments.prefix.clone().unwrap_or_else(Prefix::of_this_process).to_string());
    let paths = [("model", &arguments.model), ("record", &arguments.record), ("json", &arguments.json)];
    for (name, path) in paths {
        path.iter().for_each(|path| option(name, path.display().to_string()));
    }
    if let Some(address) = arguments.monitor {
        words.push(format!("--monitor={address}"));
    }
    words.push("--no-black-box".to_owned());
    let flags = [("--lockstep", arguments.lockstep), ("--off", !script.is_armed)];
    words.extend(flags.iter().filter(|(_, is_set)| *is_set).map(|(flag, _)| (*flag).to_owned()));
    if arguments.record.is_none() {
        words.push("--no-record".to_owned());
    }
    drop(script);
    match Arguments::try_parse_from(words).map_err(Failure::usage)?.command {
        Command::Run(arguments) => run::run(&arguments),
        other => unreachable!("the words of a run, not of {other:?}"),
    }
}

/// The program in the place of the plant: this one.
fn stage(arguments: &ReplayArguments) -> Result<Vec<String>, Failure> {
    let own = std::env::current_exe().map_err(Failure::run)?;
    let file = fs::canonicalize(&arguments.file).map_err(Failure::run)?;
    let mut words = vec![own.display().to_string(), "plant-sim".to_owned()];
    words.extend(["--parent".to_owned(), std::process::id().to_string()]);
    words.extend(["--recording".to_owned(), file.display().to_string()]);
    if arguments.lockstep && arguments.record.is_some() {
        words.push("--recorded".to_owned());
    }
    Ok(words)
}

/// A machine file that is connected to nothing real.
fn simulated(text: &str) -> Result<String, Failure> {
    let mut table: toml::Table = text.parse().map_err(|error| Failure::usage(error).about(MACHINE))?;
    let is_connection = |key: &str| CONNECTIONS.contains(&key);
    table.retain(|section, _| !is_connection(section));
    if let Some(toml::Value::Table(axes)) = table.get_mut("axis") {
        for (_, axis) in axes {
            axis.as_table_mut().into_iter().for_each(|axis| axis.retain(|key, _| !is_connection(key)));
        }
    }
    table.insert("source".to_owned(), toml::Table::from_iter([("kind".to_owned(), "sim".into())]).into());
    toml::to_string(&table).map_err(Failure::run)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_real_is_left_in_the_machine() {
        let text = "name = \"m\"\n[source]\nkind = \"can\"\n[drive]\nkind = \"can\"\n[can]\nbus = \"can0\"\n\
                    [axis.boom]\nstroke = 0.5\n[axis.boom.can.encoder]\nnode = 3\n";
        let simulated: toml::Table = simulated(text).unwrap().parse().unwrap();
        let expected: toml::Table =
            "name = \"m\"\n[axis.boom]\nstroke = 0.5\n[source]\nkind = \"sim\"\n".parse().unwrap();
        assert_eq!(simulated, expected);
    }
}
