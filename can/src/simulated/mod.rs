//! Devices on a bus, simulated: what a real encoder and a real valve answer. For tests, and for a group without
//! hardware. Unlike the rest of this crate they allocate while they are made.
//!
//! | file | device |
//! |---|---|
//! | `objects` | an object dictionary |
//! | `node` | NMT, heartbeat, emergencies, service data |
//! | `encoder` | an encoder (CiA 406) |
//! | `valve` | a valve (CiA 408) with its own time-out |
//! | `frames` | a machine of messages that are no CANopen |
//!
//! Faults are injected by [`Flaw`]s.

mod encoder;
mod frames;
mod node;
mod objects;
mod valve;

pub use encoder::SimulatedEncoder;
pub use frames::SimulatedFrames;
pub use node::Flaw;
pub use valve::SimulatedValve;
