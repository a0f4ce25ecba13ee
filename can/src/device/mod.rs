//! Devices of a machine as their master sees them: encoders (CiA 406), inclinometers (CiA 410), valves (CiA 408), and
//! all of them together.
//!
//! | file | what it holds |
//! |---|---|
//! | `fault` | what is wrong with a device, as one word |
//! | `plan` | what is written to a device and read back before it is used |
//! | `node` | start-up, configuration, heartbeat and emergencies of a node |
//! | `encoder` | position and alarms |
//! | `valve`, `proof` | set points, states, spool feedback; the test of the drive's own time-out |
//! | `receiver`, `frame_drive`, `frames` | messages that are no CANopen: received ones, drives, all of a machine |
//! | `network` | all devices of a machine: one SYNC, one sample; the interlock of each axis |
//!
//! Nothing here has a clock or a bus: frames and times come from the caller, frames to be sent go to an [`Outbox`].

mod encoder;
mod fault;
mod frame_drive;
mod frames;
mod network;
mod node;
mod outbox;
mod plan;
mod proof;
mod receiver;
mod valve;

pub use encoder::{Encoder, EncoderSettings, PositionObject};
pub use fault::{Cause, Fault};
pub use frame_drive::{FrameDrive, FrameDriveSettings, Pattern, SetPoint};
pub use frames::{AxisFrames, Frames, SignalPosition, Source};
pub use network::{AxisDevices, AxisState, AxisTarget, Network, NetworkCounters};
pub use node::{Node, NodeTiming};
pub use outbox::Outbox;
pub use plan::{Plan, Value};
pub use proof::Proof;
pub use receiver::{Receiver, ReceiverCounters};
pub use valve::{Demand, Valve, ValveSettings};
