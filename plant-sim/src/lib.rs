#![doc = include_str!("../README.md")]
//!
//! # Contents
//!
//! Each module uses only modules above it.
//!
//! | module | what it holds |
//! |---|---|
//! | [`lanes`] | four numbers side by side, one for each of four axes |
//! | [`hydraulics`] | oil, flow through a control edge, relief and make-up valves, the pump |
//! | [`conditions`] | the factors by which a scenario changes the parameters of an axis |
//! | [`valve`] | dead time, hysteresis, spool and opening of the control edges |
//! | [`actuator`] | the cylinder with its chambers, friction, load and end stops: the rates of one axis |
//! | [`coupling`] | the linkage that couples the first four axes, and the soil at its teeth |
//! | [`integration`] | four axes through time, and the Runge-Kutta step |
//! | [`sensors`] | encoders and pressure transducers: noise and counts |
//! | [`plant`] | the whole machine: [`PlantSim`] |
//! | [`process`] | the stage: valve commands in, encoder readings out |
//!
//! Every module but [`process`] is the core. The core is deterministic: it sees no clock, no file and no channel.
//! Memory is allocated by the constructors only; [`PlantSim::command`], [`PlantSim::advance`] and [`PlantSim::read`]
//! allocate nothing.

pub mod actuator;
pub mod conditions;
pub mod coupling;
pub mod hydraulics;
pub mod integration;
pub mod lanes;
pub mod plant;
pub mod process;
pub mod sensors;
pub mod valve;

pub use integration::TrueState;
pub use plant::{PlantError, PlantSim};
