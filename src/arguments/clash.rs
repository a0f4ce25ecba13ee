//! Two arguments that name the same file, one of which is to be written: a slip that would destroy what is read.

use std::{
    ffi::{OsStr, OsString},
    fs,
    os::unix::fs::MetadataExt,
};

use clap::{Arg, ArgMatches, Command, ValueHint, parser::ValueSource};

/// Arguments that name a file to write.
const OUTPUTS: [&str; 13] = [
    "csv",
    "json",
    "jsonl",
    "model_out",
    "new",
    "out",
    "output",
    "parquet",
    "plot",
    "record",
    "report",
    "trajectory",
    "urdf",
];

/// A file that was named.
struct Named {
    argument: String,
    file: OsString,
    is_output: bool,
}

/// Says which two arguments name the same file where one of them is to be written; none where all is well.
pub fn clash(command: &Command, matches: &ArgMatches) -> Option<String> {
    let (mut command, mut matches) = (command, matches);
    while let Some((name, inner)) = matches.subcommand() {
        (command, matches) = (command.find_subcommand(name)?, inner);
    }
    let named: Vec<Named> = command.get_arguments().flat_map(|argument| files(argument, matches)).collect();
    named.iter().enumerate().find_map(|(i, one)| {
        let other = named[i + 1..].iter().find(|other| are_same(one, other))?;
        let (written, other) = if other.is_output { (other, one) } else { (one, other) };
        Some(format!(
            "{}: found {}, the file that {} {}; allowed: a file of its own",
            written.argument,
            written.file.display(),
            other.argument,
            if other.is_output { "writes" } else { "reads" },
        ))
    })
}

/// The files that were typed for an argument.
fn files<'a>(argument: &'a Arg, matches: &'a ArgMatches) -> impl Iterator<Item = Named> + 'a {
    let id = argument.get_id().as_str();
    // `trajectory` is an option that writes in one command, and what another one reads.
    let is_output = OUTPUTS.contains(&id) && (!argument.is_positional() || id == "new");
    let is_typed = matches.try_contains_id(id).is_ok() && matches.value_source(id) == Some(ValueSource::CommandLine);
    let is_file = is_output || argument.get_value_hint() == ValueHint::AnyPath;
    let name = move || match (argument.get_long(), argument.get_value_names()) {
        (Some(long), _) => format!("--{long}"),
        (None, Some([name, ..])) => name.to_string(),
        (None, _) => id.to_owned(),
    };
    let values = if is_typed && is_file { matches.get_raw(id) } else { None };
    values.into_iter().flatten().map(move |file| Named { argument: name(), file: file.to_owned(), is_output })
}

/// Whether one of the two would destroy the other. An output need not be there yet; `-` is no file.
fn are_same(one: &Named, other: &Named) -> bool {
    let place = |file: &OsStr| fs::metadata(file).ok().filter(fs::Metadata::is_file).map(|at| (at.dev(), at.ino()));
    match (place(&one.file), place(&other.file)) {
        (Some(at), Some(there)) => at == there && (one.is_output || other.is_output),
        (None, None) => one.file == other.file && one.file != "-" && one.is_output && other.is_output,
        _ => false,
    }
}
