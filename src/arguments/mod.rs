//! Arguments that several subcommands share: the machine, and values as a user types them.
//!
//! Subcommands use this folder; nothing here uses a subcommand. Nothing here runs beside the loop.

mod clash;
mod columns;
mod machine;
mod mistyped;
pub mod values;

pub use clash::clash;
pub use columns::ColumnArguments;
pub use machine::{
    BareMachine, MachineFile, UnknownAxis, axes, axes_of, load, load_bare, mechanism_only, simulated_only,
    with_scenarios,
};
pub use mistyped::refusal;
