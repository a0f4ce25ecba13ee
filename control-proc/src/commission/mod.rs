//! Commissioning: a bounded experiment with one axis, and the model that explains what it did.
//!
//! | module | what it holds |
//! |---|---|
//! | [`experiment`] | what is commanded when: rest, pulses, strokes, random steps |
//! | [`terms`] | what it takes and gives: options, phases, record, outcome |
//! | `step` | one step of it, and what the axis does meanwhile |
//! | [`watch`] | what ends it at once: the bounds, and every reason to abort |
//! | [`foresight`] | how far the axis still goes, before its model is known |
//! | [`analysis`] | from the record to [`pipeline::machine::Commissioned`]; not for the loop |
//! | [`simplex`] | the search that the analysis uses |
//!
//! All but the last two are a core like the controller's: no clock, no I/O, no allocation after construction. One axis at a
//! time; whoever calls keeps all others neutral.

pub mod analysis;
pub mod experiment;
pub mod foresight;
pub mod simplex;
mod step;
pub mod terms;
pub mod watch;

pub use analysis::{AnalysisError, analyse};
pub use experiment::Experiment;
pub use terms::{ExperimentOptions, ExperimentRecord, Outcome, Phase};
pub use watch::Abort;
