//! The `hydraxis` command; `hydraxis --help` says what it does.

mod arguments;
mod command;
mod failure;
mod group;
mod recording;
mod report;

use std::{
    io::{Write, stderr},
    process::ExitCode,
};

use clap::Parser;

fn main() -> ExitCode {
    match command::Arguments::parse().command.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // The reader of standard error may have ended.
            let _ = writeln!(stderr(), "{failure}");
            failure.exit_code()
        }
    }
}
