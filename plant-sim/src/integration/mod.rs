//! Integration of the axes over time. Only [`FourAxes::new`] allocates, for the dead times; a step allocates nothing.
//!
//! | module | what it holds |
//! |---|---|
//! | [`four_axes`] | parameters and state of four axes side by side, and the parts of one step |
//! | [`runge_kutta`] | one Runge-Kutta step of all axes of the machine |

pub mod four_axes;
pub mod runge_kutta;

pub use four_axes::{FourAxes, TrueState};
