//! Commissioning: a bounded experiment with one axis, and the model that explains what the axis did.
//!
//! | module | what it holds |
//! |---|---|
//! | [`experiment`] | what is commanded when; runs once per sample, without clock, I/O or allocation |
//! | [`record`] | commands and positions of an experiment |
//! | [`analysis`] | from the record to [`pipeline::machine::Commissioned`]; never called in a loop |
//!
//! One axis is commissioned at a time. The caller keeps all other axes neutral.

pub mod analysis;
pub mod experiment;
pub mod record;

pub use analysis::{AnalysisError, analyse, modelled};
pub use experiment::{
    Experiment,
    abort::Abort,
    terms::{ExperimentOptions, Outcome, Phase},
};
pub use record::ExperimentRecord;
