//! The `hydraxis` command; `hydraxis --help` says what it does.

mod arguments;
mod command;
mod failure;
mod group;
mod model;
mod recording;
mod report;
mod teeth;

use std::{
    io::{Write, stderr},
    process::ExitCode,
};

use clap::{CommandFactory, FromArgMatches};
use failure::Failure;

fn main() -> ExitCode {
    if let Some(stop) = command::Stop::typed() {
        return ended(stop.run());
    }
    let mut command = command::Arguments::command();
    let parsed = command.try_get_matches_from_mut(std::env::args_os());
    let arguments = match parsed.and_then(|matches| Ok((command::Arguments::from_arg_matches(&matches)?, matches))) {
        Ok((arguments, matches)) => match arguments::clash(&command, &matches) {
            Some(clash) => return refused(&Failure::usage(clash)),
            None => arguments,
        },
        Err(error) => {
            let typed: Vec<String> =
                std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
            let Some(refusal) = arguments::refusal(&error, &command::Arguments::command(), &typed) else {
                error.exit()
            };
            return refused(&Failure::usage(refusal));
        }
    };
    ended(arguments.command.run())
}

fn ended(result: Result<(), Failure>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => refused(&failure),
    }
}

/// Says why the command failed.
fn refused(failure: &Failure) -> ExitCode {
    // The reader of standard error may have ended.
    let _ = writeln!(stderr(), "{}", report::output::printable(&failure.to_string()));
    failure.exit_code()
}
