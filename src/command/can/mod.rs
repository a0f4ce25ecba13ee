//! `hydraxis can`: beside a CAN bus.
//!
//! | file | what |
//! |---|---|
//! | `bus` | which bus: options, machine file |
//! | `scan` | the nodes of a bus |
//! | `sdo`, `dialogue` | objects of a device |
//! | `monitor`, `decode` | what is on a bus, and what it means |
//! | `record` | a log of a bus |
//! | `calibrate` | direction, scale and zero of an encoder |
//! | `simulate` | devices without hardware |

mod bus;
mod calibrate;
mod decode;
mod dialogue;
mod monitor;
mod record;
mod scan;
mod sdo;
mod simulate;

use clap::Subcommand;

use crate::failure::Failure;
use calibrate::CalibrateArguments;
use monitor::MonitorBusArguments;
use record::RecordBusArguments;
use scan::ScanArguments;
use sdo::Sdo;
use simulate::SimulateBusArguments;

/// What is done with a CAN bus.
#[derive(Debug, Subcommand)]
pub enum Can {
    /// Show the nodes of a bus: identity, heartbeat, state
    Scan(ScanArguments),
    /// Read or write one object of a device
    #[command(subcommand)]
    Sdo(Sdo),
    /// Show what is on a bus: decoded, with rates and load
    Monitor(MonitorBusArguments),
    /// Record the frames of a bus as a log of candump
    Record(RecordBusArguments),
    /// Find direction, scale and zero of an axis' encoder
    Calibrate(CalibrateArguments),
    /// Play the encoders and valves of a machine on a bus, without hardware
    Simulate(SimulateBusArguments),
}

/// Runs the command.
pub fn run(command: &Can) -> Result<(), Failure> {
    match command {
        Can::Scan(arguments) => scan::run(arguments),
        Can::Sdo(sdo) => sdo::run(sdo),
        Can::Monitor(arguments) => monitor::run(arguments),
        Can::Record(arguments) => record::run(arguments),
        Can::Calibrate(arguments) => calibrate::run(arguments),
        Can::Simulate(arguments) => simulate::run(arguments),
    }
}
