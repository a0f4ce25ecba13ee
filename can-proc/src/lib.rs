//! The stage of a machine with encoders and valves on a CAN bus. It stands in the place of plant-sim.
//!
//! ```text
//! valve-command --> set points --> bus --> valves
//! encoders --> bus --> positions of one SYNC --> encoder-reading
//! ```
//!
//! | file | what it holds |
//! |---|---|
//! | `wiring` | the devices of a machine file |
//! | `error` | what can be wrong with them |
//! | `messages` | its messages that are no CANopen |
//! | `range` | whether a position has numbers for all places of its axis |
//! | `process` | the stage: bus, channels, time |
//!
//! What a device is told and when it is at fault is in the crate `can`.
//!
//! One process has the whole bus: an adapter can be opened once, configuration and process data of a device are one
//! dialogue, and an axis whose encoder has a fault is held without a way through other processes.

mod error;
mod judge;
mod messages;
pub mod process;
mod range;
mod wiring;

pub use error::WiringError;
pub use messages::database;
pub use wiring::{bit_rates, bus_address, network, number, position_object, step};
