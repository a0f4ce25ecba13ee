//! The simulator compared with an independent reference: its equations written again in plain numbers, integrated with
//! error control.
//!
//! The reference shares nothing with the simulator but the machine file. It cannot find errors in the equations
//! themselves; the tests in `tests/machine` compare the equations with closed formulas.

mod agreement;
mod commands;
mod conditions;
mod cylinder;
mod dormand_prince;
mod machine;
mod pump;
mod valve;
