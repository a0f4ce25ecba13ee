//! The `hydraxis` command; `hydraxis --help` tells what it does.

mod cli;
mod failure;
mod identify;
mod table;

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    let result = match cli::Arguments::parse().command {
        cli::Command::Identify(arguments) => identify::run(&arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("{failure}");
            failure.exit_code()
        }
    }
}
