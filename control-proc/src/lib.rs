//! The controller: positions and models in, valve commands out.
//!
//! | module | what it holds |
//! |---|---|
//! | [`controller`] | all axes of the machine, one call per sample |
//! | [`axis`] | one axis: what it may do when, and who makes its command |
//! | [`mod@reference`] | target generators: sines, ramps, trajectories |
//! | [`trajectory`] | a trajectory's CSV file, read and refused |
//! | [`operation`] | off, manual, hold, track, commission: requests of a person or a program, accepted or refused |
//! | [`end_stops`] | how far a command by hand may go towards a soft limit |
//! | [`profile`] | targets bounded in speed, acceleration and jerk |
//! | [`target`] | from where the axis stands to what its generator asks for, without a jump |
//! | [`channel`] | targets from another program, accepted or refused |
//! | [`fallback`] | PI with dead-band compensation, and feed-forward where the axis is commissioned |
//! | [`feedforward`] | what the fallback adds for a motion that it sees coming |
//! | [`predictive`] | generalised predictive control on the identified model |
//! | [`response`] | what the model answers to nothing and to a step |
//! | [`quadratic`] | quadratic programmes, solved exactly |
//! | [`judge`] | which models may be used at all |
//! | [`recent`] | which of two models has predicted better of late |
//! | [`trust`] | taking a model away from an axis that is not where it should be |
//! | [`rest`] | leaving an axis alone that has arrived |
//! | [`course`] | the course on which controllers are tuned and compared |
//! | [`tuning`] | gains of the fallback from a commissioned model |
//! | [`commission`] | the experiment that finds an axis' model, and its analysis |
//! | [`kept`] | the last model that was approved, and how old it is |
//! | [`following`] | stopping an axis that is not where it should be |
//! | [`motion`] | whether an axis that is driven moves |
//! | [`history`] | past outputs and commands of one axis |
//! | [`limits`] | magnitude and rate of a command |
//! | [`process`] | the stage: channels in, channels out |
//!
//! Everything but the last is the core, and all of that but tuning runs in the loop: no clock, no I/O, no allocation after construction, no panic, and the same inputs
//! always give the same commands. Time is counted in ticks, the differences of the samples' sequence numbers.

pub mod axis;
pub mod channel;
pub mod commission;
pub mod controller;
pub mod course;
pub mod end_stops;
pub mod fallback;
pub mod feedforward;
pub mod following;
pub mod history;
pub mod judge;
pub mod kept;
pub mod limits;
pub mod motion;
pub mod operation;
pub mod predictive;
pub mod process;
pub mod profile;
pub mod quadratic;
pub mod recent;
pub mod reference;
pub mod response;
pub mod rest;
pub mod target;
pub mod trajectory;
pub mod trust;
pub mod tuning;

pub use controller::Controller;
pub use reference::ReferenceError;

#[cfg(test)]
mod tests;
