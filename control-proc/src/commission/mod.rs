//! Commissioning: a bounded experiment with one axis, and the model that explains what the axis did.
//!
//! | module | what it holds |
//! |---|---|
//! | [`terms`] | options, phases, record and outcome of an experiment |
//! | [`experiment`] | what is commanded when; runs once per sample, without clock, I/O or allocation |
//! | [`analysis`] | from the record to [`pipeline::machine::Commissioned`]; never called in a loop |
//!
//! One axis is commissioned at a time. The caller keeps all other axes neutral.

pub mod analysis;
pub mod experiment;
pub mod terms;

pub use analysis::{AnalysisError, analyse};
pub use experiment::{Experiment, watch::Abort};
pub use terms::{ExperimentOptions, ExperimentRecord, Outcome, Phase};
