//! `hydraxis can`: beside a CAN bus.

mod simulate;

use clap::Subcommand;

use crate::failure::Failure;
use simulate::SimulateBusArguments;

/// What is done with a CAN bus.
#[derive(Debug, Subcommand)]
pub enum Can {
    /// Play the encoders and valves of a machine on a bus, without hardware
    Simulate(SimulateBusArguments),
}

/// Runs the command.
pub fn run(command: &Can) -> Result<(), Failure> {
    match command {
        Can::Simulate(arguments) => simulate::run(arguments),
    }
}
