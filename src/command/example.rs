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
    /// Another example that it needs beside it.
    needs: Option<&'static str>,
}

/// A file of the folder `examples`, with a line that says what it is.
macro_rules! example {
    ($name:literal, $summary:literal) => {
        example!($name, $summary, None)
    };
    ($name:literal, $summary:literal, $needs:expr) => {
        Example { name: $name, summary: $summary, text: include_str!(concat!("../../examples/", $name)), needs: $needs }
    };
}

/// The module that the programs in Python import.
const MODULE: Option<&str> = Some("hydraxis.py");

const EXAMPLES: &[Example] = &[
    example!("excavator.toml", "machine file: a 20 t excavator with pilot-operated valves, the built-in machine"),
    example!("excavator-model.toml", "model file: what commissioning has found for excavator.toml"),
    example!("excavator-servo.toml", "machine file: the same excavator with servo valves"),
    example!("four-axes.toml", "machine file: four independent cylinders with fast valves"),
    example!("mechanism.toml", "tables for a machine file: the linkage of the excavator"),
    example!("hydraxis.py", "Python: the messages and channels, a module for programs of your own"),
    example!("plant.py", "Python: a plant in the place of plant-sim", MODULE),
    example!("watch.py", "Python: watches a running group", MODULE),
    example!("watch.rs", "Rust: watches a running group"),
    example!("hydraxis.service", "a unit of systemd that runs a machine as a service"),
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
    let mut text = format!("written: {}\n", path.display());
    for needed in EXAMPLES.iter().filter(|other| example.needs == Some(other.name)) {
        let beside = path.with_file_name(needed.name);
        if beside.exists() {
            continue; // a program of the user may have changed it
        }
        write(&beside, needed, false)?;
        text += &format!("written: {}, which it needs\n", beside.display());
    }
    Ok(show(&text)?)
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
        assert!(EXAMPLES.iter().all(|example| example.needs.is_none_or(|needed| names.contains(&needed))));
    }
}
