//! The simulator held to an independent reference: the same equations in plain numbers, integrated with error control.
//!
//! The reference shares nothing with the simulator but the machine file. What it cannot find is an error in the
//! equations themselves; those are held to closed formulas elsewhere.

mod agreement;
mod commands;
mod conditions;
mod cylinder;
mod dormand_prince;
mod machine;
mod valve;
