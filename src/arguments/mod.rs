//! What several subcommands take on the command line: the machine, and values as a user types them.
//!
//! Nothing here knows a subcommand.

mod machine;
pub mod values;

pub use machine::{BareMachine, MachineFile, axes, load, load_bare, with_scenarios};
