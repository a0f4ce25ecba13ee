//! The subcommands: one file or folder for each, with its clap arguments.
//!
//! | command | runs |
//! |---|---|
//! | `plant-sim`, `can-proc`, `sensor-proc`, `ident-proc`, `control-proc` ([`stage`]) | one stage, in this process |
//! | [`run`], [`operate`], [`status`], [`monitor`], [`record`] | beside the loop, in a process of its own |
//! | [`commission`] | beside the loop, or on a simulated machine in this process |
//! | [`simulate`], [`mod@bench`], [`identify`], [`predict`] | without a loop in real time, in this process |
//! | [`init`], [`example`] | before there is a machine file |
//! | [`mod@can`] | beside a CAN bus |
//! | [`check`], [`mechanism`], [`tip`], [`doctor`], [`clean`] | before or after a run |
//! | [`info`], [`recover`], [`export`], [`replay`], [`mod@report`], [`mod@plot`] | with files that were written |
//! | [`completions`], [`manual`] | when the command is installed |

mod bench;
mod can;
mod check;
mod clean;
mod commission;
mod completions;
mod doctor;
mod example;
mod export;
mod identify;
mod info;
mod init;
mod manual;
mod mechanism;
mod monitor;
mod operate;
mod plot;
mod predict;
mod record;
mod recover;
mod replay;
mod report;
mod run;
mod simulate;
mod stage;
mod status;
mod tip;

use clap::{Parser, Subcommand};

use pipeline::stage::StageKind;

use self::can::Can;
use self::mechanism::MechanismArguments;
use crate::failure::Failure;
use bench::Bench;
use check::CheckArguments;
use clean::CleanArguments;
use commission::CommissionArguments;
use completions::CompletionsArguments;
use doctor::DoctorArguments;
use example::ExampleArguments;
use export::ExportArguments;
use identify::IdentifyArguments;
use info::InfoArguments;
use init::InitArguments;
use manual::ManualArguments;
use monitor::MonitorArguments;
use operate::{ArmArguments, DisarmArguments, OperateArguments, ResetArguments};
use plot::PlotArguments;
use predict::PredictArguments;
use record::RecordArguments;
use recover::RecoverArguments;
use replay::ReplayArguments;
use report::ReportArguments;
use run::RunArguments;
use simulate::SimulateArguments;
use stage::StageArguments;
use status::StatusArguments;
use tip::TipArguments;

/// Identifies and controls the electrohydraulic axes of a machine.
#[derive(Debug, Parser)]
#[command(name = "hydraxis", version = env!("HYDRAXIS_VERSION"), max_term_width = 110)]
#[command(after_help = "\
Start with `hydraxis run`: it needs no file, simulates the built-in excavator, and moves nothing real.
Each subcommand has examples: `hydraxis run --help`.
Exit codes: 0 done, 1 the run failed, 2 bad usage or a bad file.")]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write a commented machine file for a rig, from flags or from a few questions
    Init(Box<InitArguments>),
    /// Write an example file: machine files, programs in Python and Rust
    Example(ExampleArguments),
    /// Run a machine: one process for each stage, connected by shared memory
    Run(RunArguments),
    /// Simulate the loop in one process without shared memory, or the machine without a controller
    Simulate(SimulateArguments),
    /// Draw a trajectory that `simulate` has written
    Plot(PlotArguments),
    /// Find the model of each axis by a bounded experiment, and write it to a file
    Commission(CommissionArguments),
    /// Operate the axes of a running group: off, manual, hold, track
    Operate(OperateArguments),
    /// Arm axes of a running group: they may move, and follow their references
    Arm(ArmArguments),
    /// Disarm axes of a running group: neutral at once
    Disarm(DisarmArguments),
    /// Release axes of a running group that a fault has latched, and show the fault
    Reset(ResetArguments),
    /// Show the state of a running group: stages, channels, latencies, axes
    Status(StatusArguments),
    /// Show a running group as a page for browsers, and its figures for Prometheus
    Monitor(MonitorArguments),
    /// Record all messages of a running group
    Record(RecordArguments),
    /// Show what a recording holds: channels, gaps, faults, changes of mode
    Info(InfoArguments),
    /// Write a damaged recording anew, as far as it can be read
    Recover(RecoverArguments),
    /// Compute a recorded run again, bit for bit, or with another estimator or model beside what was
    Replay(ReplayArguments),
    /// Write a recording as a table for other tools
    Export(ExportArguments),
    /// Write a page about a recorded run: verdict, axes, models, latencies, faults
    Report(ReportArguments),
    /// Identify a Hammerstein model on a recording: classical and adaptive side by side
    Identify(Box<IdentifyArguments>),
    /// Apply a model that identify has saved to another recording
    Predict(PredictArguments),
    /// Compare controllers on the simulated machine
    #[command(subcommand)]
    Bench(Bench),
    /// Look at a CAN bus: its nodes, objects and messages; calibrate encoders; play devices without hardware
    #[command(subcommand)]
    Can(Can),
    /// Check a machine file and show everything that is wrong with it
    Check(CheckArguments),
    /// Show reach, joints, masses and loads of the machine's linkage, evaluate states, write URDF
    Mechanism(MechanismArguments),
    /// Plan the task of the bucket's teeth and show it, piece by piece, without moving anything
    Tip(TipArguments),
    /// Show whether this computer is fit for real time, and what to do about it
    Doctor(DoctorArguments),
    /// Remove files that dead groups have left
    Clean(CleanArguments),
    /// Run the simulated machine alone, in the foreground
    PlantSim(StageArguments),
    /// Drive the encoders and valves of a CAN bus alone, in the foreground
    CanProc(StageArguments),
    /// Run the encoder acquisition alone, in the foreground
    SensorProc(StageArguments),
    /// Run the identification alone, in the foreground
    IdentProc(StageArguments),
    /// Run the controller alone, in the foreground
    ControlProc(StageArguments),
    /// Write the script by which a shell completes subcommands and options
    Completions(CompletionsArguments),
    /// Write the help as manual pages
    Man(ManualArguments),
}

/// The command line of a stop. It is read without those of the other commands, whose help alone takes longer than a
/// stop.
#[derive(Debug, Parser)]
#[command(name = "hydraxis")]
pub enum Stop {
    /// As [`Command::Disarm`].
    Disarm(DisarmArguments),
}

impl Stop {
    /// What was typed, if it is a stop without a mistake.
    pub fn typed() -> Option<Self> {
        (std::env::args_os().nth(1)? == "disarm").then(|| Self::try_parse().ok())?
    }

    /// Asks for the stop.
    ///
    /// # Errors
    /// No group runs, or one does not answer.
    pub fn run(&self) -> Result<(), Failure> {
        let Self::Disarm(arguments) = self;
        operate::disarm(arguments)
    }
}

impl Command {
    /// Runs the subcommand.
    ///
    /// # Errors
    /// The subcommand fails; the failure has the exit code.
    pub fn run(&self) -> Result<(), Failure> {
        match self {
            Self::Init(arguments) => init::run(arguments),
            Self::Example(arguments) => example::run(arguments),
            Self::Run(arguments) => run::run(arguments),
            Self::Simulate(arguments) => simulate::run(arguments),
            Self::Plot(arguments) => plot::run(arguments),
            Self::Commission(arguments) => commission::run(arguments),
            Self::Operate(arguments) => operate::run(arguments),
            Self::Arm(arguments) => operate::arm(arguments),
            Self::Disarm(arguments) => operate::disarm(arguments),
            Self::Reset(arguments) => operate::reset(arguments),
            Self::Status(arguments) => status::run(arguments),
            Self::Monitor(arguments) => monitor::run(arguments),
            Self::Record(arguments) => record::run(arguments),
            Self::Info(arguments) => info::run(arguments),
            Self::Recover(arguments) => recover::run(arguments),
            Self::Replay(arguments) => replay::run(arguments),
            Self::Export(arguments) => export::run(arguments),
            Self::Report(arguments) => report::run(arguments),
            Self::Identify(arguments) => identify::run(arguments),
            Self::Predict(arguments) => predict::run(arguments),
            Self::Bench(Bench::Control(arguments)) => bench::run(arguments),
            Self::Bench(Bench::Identify(arguments)) => bench::identify(arguments),
            Self::Can(command) => self::can::run(command),
            Self::Bench(Bench::Tip(arguments)) => bench::tip::run(arguments),
            Self::Check(arguments) => check::run(arguments),
            Self::Mechanism(arguments) => mechanism::run(arguments),
            Self::Tip(arguments) => tip::run(arguments),
            Self::Doctor(arguments) => doctor::run(arguments),
            Self::Clean(arguments) => clean::run(arguments),
            Self::PlantSim(arguments) => stage::run(StageKind::PlantSim, arguments),
            Self::CanProc(arguments) => stage::run_can(arguments),
            Self::SensorProc(arguments) => stage::run(StageKind::SensorProc, arguments),
            Self::IdentProc(arguments) => stage::run(StageKind::IdentProc, arguments),
            Self::ControlProc(arguments) => stage::run(StageKind::ControlProc, arguments),
            Self::Completions(arguments) => completions::run(arguments),
            Self::Man(arguments) => manual::run(arguments),
        }
    }
}
