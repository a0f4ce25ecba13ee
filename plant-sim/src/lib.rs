#![doc = include_str!("../README.md")]
//!
//! # Contents
//!
//! | module | what it holds |
//! |---|---|
//! | [`valve`] | dead time, hysteresis, spool, curve |
//! | [`orifice`] | flow through one control edge |
//! | [`supply`] | the pump and what each axis gets of it |
//! | [`oil`] | bulk modulus with air, viscosity |
//! | [`port`] | relief and make-up valves |
//! | [`friction`] | LuGre friction |
//! | [`load`] | gravity and other forces |
//! | [`end_stop`] | the ends of the stroke |
//! | [`cylinder`] | edges, chambers, leakage, force balance: the rates of one axis |
//! | [`conditions`] | what a scenario has made of an axis |
//! | [`lanes`] | four numbers, one per axis |
//! | [`group`] | four axes through time |
//! | [`integrate`] | the Runge-Kutta step |
//! | [`stiffness`] | which axes that step can integrate |
//! | [`encoder`] | noise and counts |
//! | [`plant`] | the machine: [`PlantSim`] |
//! | [`process`] | the stage: channels in, channels out |
//!
//! The core is deterministic: it sees no clock, no file and no channel, and allocates at construction only.

pub mod conditions;
pub mod cylinder;
pub mod encoder;
pub mod end_stop;
pub mod friction;
pub mod group;
pub mod integrate;
pub mod lanes;
pub mod load;
pub mod oil;
pub mod orifice;
pub mod plant;
pub mod port;
pub mod process;
pub mod stiffness;
pub mod supply;
pub mod valve;

pub use group::AxisState;
pub use plant::{PlantError, PlantSim};
