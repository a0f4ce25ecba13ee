//! What is done with arbitrary bytes, one function per target. A panic is a finding, and so is a hang.
//!
//! | target | the bytes are | what must hold |
//! |---|---|---|
//! | [`machine_file`] | a machine file, then settings | refused in words, or a machine that can be built and runs |
//! | [`csv`] | a recording | refused in words, or as many finite numbers in each column |
//! | [`trajectory`] | a trajectory's file | refused in words, or positions inside the soft limits at any time |
//! | [`messages`] | what is done to the messages of a loop that works | every command is one, and neutral where it has to be |
//!
//! The fuzzer calls these, and so does a test of the project, with the seeds and some mutations of them.

mod csv;
mod machine;
mod messages;

pub use csv::{csv, trajectory};
pub use machine::machine_file;
pub use messages::messages;
