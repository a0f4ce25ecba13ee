//! `hydraxis example`: the example files of the project, which the program carries with it.

use std::{
    fs::OpenOptions,
    io::Write,
    path::{Path, PathBuf},
};

use clap::Args;
use pipeline::nearest::did_you_mean;

use crate::{failure::Failure, report::output::show};

/// `example`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis example                                 all files, with a line each
  hydraxis example four-axes.toml                  into this folder
  hydraxis example watch.py --output tools/        into another folder
  hydraxis example excavator.toml --output my.toml under another name

Exit codes: 0 written, 2 an unknown name, or a file that is there already.")]
pub struct ExampleArguments {
    /// Name of the example [default: all of them are listed]
    pub name: Option<String>,
    /// Folder or file to write to [default: the present folder]
    #[arg(long, value_name = "PATH", requires = "name")]
    pub output: Option<PathBuf>,
    /// Overwrite the file if it exists
    #[arg(long, requires = "name")]
    pub force: bool,
}

/// One example.
struct Example {
    /// Name of its file.
    name: &'static str,
    /// What it is, in one line.
    summary: &'static str,
    text: &'static str,
}

/// A file of the folder `examples`, with a line that says what it is.
macro_rules! example {
    ($name:literal, $summary:literal) => {
        Example { name: $name, summary: $summary, text: include_str!(concat!("../../examples/", $name)) }
    };
}

const EXAMPLES: &[Example] = &[
    example!("excavator.toml", "machine file: a 20 t excavator with pilot-operated valves, the built-in machine"),
    example!("excavator-model.toml", "model file: what commissioning has found for excavator.toml"),
    example!("excavator-servo.toml", "machine file: the same excavator with servo valves"),
    example!("four-axes.toml", "machine file: four independent cylinders with fast valves"),
    example!("excavator-can.toml", "tables for a machine file: positions, levers and interlocks by messages of a bus"),
    example!("excavator.dbc", "data base of the messages in excavator-can.toml"),
    example!("auxiliary-valves.toml", "tables for a machine file: positions by messages, auxiliary valves of J1939"),
    example!("mechanism.toml", "tables for a machine file: the linkage of the excavator"),
    example!("plant.py", "Python: a plant in the place of plant-sim, or of a rig"),
    example!("watch.py", "Python: watches a running group"),
    example!("logger.py", "Python: writes what a running group measures and commands to a CSV file"),
    example!("reference.py", "Python: gives the references of a running group"),
    example!("read_recording.py", "Python: reads a recording, whole or damaged, and prints what each axis did"),
    example!("plotjuggler.xml", "layout of PlotJuggler for recordings: commands, positions, errors"),
    example!("foxglove.json", "layout of Foxglove for recordings: commands, positions, errors"),
    example!("commission.ipynb", "notebook: commissions an axis and draws what was found"),
    example!("watch.rs", "Rust: watches a running group"),
    example!("hydraxis.service", "a unit of systemd that runs a machine as a service"),
    example!("prometheus.yml", "Prometheus: collects the figures of `hydraxis monitor`"),
    example!("grafana.json", "Grafana: a dashboard of these figures"),
];

/// Runs the command.
pub fn run(arguments: &ExampleArguments) -> Result<(), Failure> {
    let Some(name) = &arguments.name else {
        let width = EXAMPLES.iter().map(|example| example.name.len()).max().unwrap_or_default();
        let lines = EXAMPLES.iter().map(|Example { name, summary, .. }| format!("{name:width$}  {summary}\n"));
        return Ok(show(&lines.collect::<String>())?);
    };
    let example = find(name)?;
    let path = match arguments.output.as_deref() {
        None => PathBuf::from(example.name),
        Some(folder) if folder.is_dir() => folder.join(example.name),
        Some(file) => file.to_owned(),
    };
    write(&path, example, arguments.force)?;
    let needs = if example.text.contains("import hydraxis") {
        "it needs the Python package: pip install ./python in the folder of Hydraxis\n"
    } else {
        ""
    };
    Ok(show(&format!("written: {}\n{needs}", path.display()))?)
}

/// The example with this name.
fn find(name: &str) -> Result<&'static Example, Failure> {
    EXAMPLES.iter().find(|example| example.name == name).ok_or_else(|| {
        let names = || EXAMPLES.iter().map(|example| example.name);
        // Without its ending a name is the beginning of another.
        let begun: Vec<&str> = names().filter(|known| known.split('.').next() == Some(name)).collect();
        let hint =
            if begun.is_empty() { did_you_mean(name, names()) } else { did_you_mean(begun[0], begun.iter().copied()) };
        let all: Vec<&str> = names().collect();
        Failure::usage(format!("example: found \"{name}\"; allowed: one of {}{hint}", all.join(", ")))
    })
}

fn write(path: &Path, example: &Example, force: bool) -> Result<(), Failure> {
    let mut options = OpenOptions::new();
    options.write(true).create(force).truncate(force).create_new(!force);
    let written = options.open(path).and_then(|mut file| file.write_all(example.text.as_bytes()));
    written.map_err(|error| match error.kind() {
        std::io::ErrorKind::AlreadyExists => Failure::usage(format!(
            "--output: found {}, which is there already; allowed: a new file, or --force",
            path.display()
        )),
        _ => Failure::usage(format!(
            "--output: {} cannot be written: {error}; allowed: a folder that exists, or a file in one",
            path.display()
        )),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::schema::columns_of;
    use pipeline::message::{EncoderSample, Message, ValveCommand};

    #[test]
    fn every_file_of_the_folder_is_an_example() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
        let mut files: Vec<String> = std::fs::read_dir(folder)
            .unwrap()
            .flatten()
            .filter(|entry| entry.path().is_file())
            .map(|entry| entry.file_name().into_string().unwrap())
            .collect();
        files.sort();
        let mut names: Vec<&str> = EXAMPLES.iter().map(|example| example.name).collect();
        names.sort_unstable();
        assert_eq!(files, names);
    }

    /// Whether a channel has this number.
    fn is_field(channel: &str, field: &str) -> bool {
        let columns = match channel {
            EncoderSample::CHANNEL => columns_of::<EncoderSample>(),
            ValveCommand::CHANNEL => columns_of::<ValveCommand>(),
            _ => return false,
        };
        columns.iter().any(|column| column.name == field)
    }

    #[test]
    fn layouts_show_numbers_that_recordings_have() {
        let plotjuggler = include_str!("../../examples/plotjuggler.xml");
        let curves = plotjuggler.split("<curve name=\"").skip(1).filter_map(|rest| rest.split('"').next());
        let curves: Vec<&str> = curves.collect();
        assert_eq!(curves.len(), 32);
        for curve in curves {
            let (channel, field) = curve.split_once('/').unwrap();
            assert!(is_field(channel, &field.replace('/', ".")), "{curve}");
        }
        let foxglove: serde_json::Value = serde_json::from_str(include_str!("../../examples/foxglove.json")).unwrap();
        let panels = foxglove["configById"].as_object().unwrap();
        let paths: Vec<_> = panels.values().flat_map(|panel| panel["paths"].as_array().unwrap()).collect();
        assert_eq!((panels.len(), paths.len()), (3, 16));
        for path in paths {
            let value = path["value"].as_str().unwrap();
            let (channel, field) = value[1..].split_once("\".").unwrap();
            assert!(is_field(channel, field), "{value}");
        }
    }
}
