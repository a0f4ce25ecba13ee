//! The controller: positions and models in, valve commands out.
//!
//! The data goes through these folders in this order at every tick:
//!
//! | module | what it holds |
//! |---|---|
//! | [`process`] | the stage: reads the channels, calls the controller, publishes the commands |
//! | [`controller`] | all axes of the machine, one call per sample |
//! | [`axis`] | one axis: requests, feedback, states, and the decision who commands at this tick |
//! | [`model`] | which identified model may be used, and what it predicts |
//! | [`mod@reference`] | the reference of this tick and of the coming ticks |
//! | [`predictive`] | generalised predictive control on the identified model, with its quadratic programme |
//! | [`smith`] | Smith predictor on the commissioned model, with the adapted curve |
//! | [`fallback`] | PI controller with dead-band compensation and feed-forward |
//! | [`standstill`] | rest at the set point, and the last millimetres to it |
//! | `cylinder` | force of a cylinder, and how stiff its oil is |
//! | [`payload`] | what the bucket carries, by the chamber pressures |
//! | [`load`] | what the loads of a mechanism do to speeds and gains |
//! | [`protection`] | limits of the command, soft end stops, following error, motion |
//!
//! The other modules never run in the control loop:
//!
//! | module | what it holds |
//! |---|---|
//! | [`trajectory_file`] | reads trajectories from CSV files, once at the start |
//! | [`tip`] | plans the motion of the teeth, once at the start |
//! | [`gains`] | by how much the gains of the fallback may be changed while a group runs |
//! | [`margins`] | gain margin, delay margin, sensitivity and bandwidth of the linear loop |
//! | [`tuning`] | gains of the fallback from a commissioned model, and the course for comparisons |
//! | [`commission`] | the experiment that explores an axis, and the analysis of its record |
//!
//! All modules that run in the loop, except [`process`], are the core: they use no clock and no I/O, do not allocate
//! after construction and do not panic, and equal inputs always give equal commands. Time is counted in ticks, as
//! differences of the samples' sequence numbers.

pub mod axis;
pub mod commission;
pub mod controller;
mod cylinder;
pub mod fallback;
pub mod load;
pub mod model;
mod operators;
pub mod payload;
pub mod predictive;
pub mod process;
pub mod protection;
pub mod reference;
pub mod smith;
pub mod standstill;

pub mod gains;
pub mod margins;
pub mod tip;
pub mod trajectory_file;
pub mod tuning;

pub use controller::Controller;
pub use trajectory_file::ReferenceError;

#[cfg(test)]
mod tests;
