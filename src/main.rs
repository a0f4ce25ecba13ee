//! The `hydraxis` command; `hydraxis --help` tells what it does.

mod bench;
mod check;
mod clean;
mod cli;
mod commission;
mod doctor;
mod failure;
mod figures;
mod identify;
mod lifeline;
mod live;
mod operate;
mod operator;
mod output;
mod report;
mod run;
mod simulate;
mod stage;
mod status;
mod supervisor;
mod table;

use std::{
    io::{Write, stderr},
    process::ExitCode,
};

use clap::Parser;
use pipeline::stage::StageKind;

fn main() -> ExitCode {
    let result = match cli::Arguments::parse().command {
        cli::Command::Run(arguments) => run::run(&arguments),
        cli::Command::Simulate(arguments) => simulate::run(&arguments),
        cli::Command::Commission(arguments) => commission::run(&arguments),
        cli::Command::Status(arguments) => status::run(&arguments),
        cli::Command::Operate(arguments) => operate::run(&arguments),
        cli::Command::Arm(arguments) => operate::arm(&arguments),
        cli::Command::Disarm(arguments) => operate::disarm(&arguments),
        cli::Command::Reset(arguments) => operate::reset(&arguments),
        cli::Command::Identify(arguments) => identify::run(&arguments),
        cli::Command::Bench(cli::Bench::Control(arguments)) => bench::run(&arguments),
        cli::Command::Check(arguments) => check::run(&arguments),
        cli::Command::Doctor(arguments) => doctor::run(&arguments),
        cli::Command::Clean(arguments) => clean::run(&arguments),
        cli::Command::PlantSim(arguments) => stage::run(StageKind::PlantSim, &arguments),
        cli::Command::SensorProc(arguments) => stage::run(StageKind::SensorProc, &arguments),
        cli::Command::IdentProc(arguments) => stage::run(StageKind::IdentProc, &arguments),
        cli::Command::ControlProc(arguments) => stage::run(StageKind::ControlProc, &arguments),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // Whoever would read it may be gone.
            let _ = writeln!(stderr(), "{failure}");
            failure.exit_code()
        }
    }
}
