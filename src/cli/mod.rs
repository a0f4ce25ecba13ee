//! What a user types.

mod bench;
mod clean;
mod commission;
mod doctor;
mod identify;
mod operate;
mod run;
mod status;
mod values;

use clap::{Parser, Subcommand};

pub use bench::{Bench, BenchControl};
pub use clean::Clean;
pub use commission::Commission;
pub use doctor::Doctor;
pub use identify::Identify;
pub use operate::{Arm, Disarm, GroupAxes, Operate, Reset};
pub use run::{BareMachine, MachineFile, Recording, Run, Simulate, Stage};
pub use status::Status;
pub use values::Samples;

/// Identifies and controls the electrohydraulic axes of a machine.
#[derive(Debug, Parser)]
#[command(name = "hydraxis", version, max_term_width = 110)]
#[command(after_help = "\
Start with `hydraxis run`: it needs no file, simulates the built-in four-axis excavator, and moves nothing real.
Exit codes: 0 done, 1 the run failed, 2 bad usage or a bad file.")]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a machine: one process per stage, over shared memory
    Run(Run),
    /// Run the same loop in one process, without shared memory, or the simulated machine without a controller
    Simulate(Simulate),
    /// Find the model of every axis by a bounded experiment, and write it to a file
    Commission(Commission),
    /// Operate the axes of a running group: off, manual, hold, track
    Operate(Operate),
    /// Let the axes of a running group move: enable those that are off, and leave them so
    Arm(Arm),
    /// Put the axes of a running group off, neutral at once
    Disarm(Disarm),
    /// Release the axes of a running group that a fault has latched, and say what it was
    Reset(Reset),
    /// Show how a running group is doing: states, rates, losses, latencies, axes
    Status(Status),
    /// Identify a Hammerstein model on a recording, offline and adaptive side by side
    Identify(Box<Identify>),
    /// Compare controllers on the simulated machine
    #[command(subcommand)]
    Bench(Bench),
    /// Check a machine file and say everything that is wrong with it
    Check(MachineFile),
    /// Say whether this computer is fit for real time, what is not, and what to do about it
    Doctor(Doctor),
    /// Remove what dead groups have left in shared memory and beside it
    Clean(Clean),
    /// Run the simulated machine alone, in the foreground
    PlantSim(Stage),
    /// Run the encoder acquisition alone, in the foreground
    SensorProc(Stage),
    /// Run the identification alone, in the foreground
    IdentProc(Stage),
    /// Run the controller alone, in the foreground
    ControlProc(Stage),
}
