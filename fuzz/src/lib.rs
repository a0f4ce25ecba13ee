//! The fuzz targets: one function per target, which gets arbitrary bytes. A panic is a finding, and so is a hang.
//!
//! | target | meaning of the bytes | what must hold |
//! |---|---|---|
//! | [`machine_file`] | a machine file, then settings | refused with an error, or a machine that runs |
//! | [`csv`] | a recording | refused with an error, or columns of finite numbers with equal lengths |
//! | [`trajectory`] | a trajectory's file | refused with an error, or positions inside the soft limits at any time |
//! | [`slcan`], [`candump`] | text of an adapter, a log of a bus | nothing but frames, read as they are written |
//! | [`sdo`] | foreign frames in dialogues | no dialogue without an end |
//! | [`devices`] | foreign and lost frames between devices and their master | a valve opens on command only |
//! | [`dbc`] | a data base of messages | refused with an error, or signals that are read as they were put |
//! | [`recording`] | a recording in MCAP | refused with an error, or read as far as it goes, in bounded memory |
//! | [`messages`] | changes to the messages of a working loop | valid commands, neutral where they have to be |
//!
//! The fuzzer calls these functions. A test of the project calls them with the seeds and some mutations of the seeds.

mod bus;
mod csv;
mod machine;
mod messages;
mod recording;

pub use bus::{candump, dbc, devices, sdo, slcan};
pub use csv::{csv, trajectory};
pub use machine::machine_file;
pub use messages::messages;
pub use recording::recording;
