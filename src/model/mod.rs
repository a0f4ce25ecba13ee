//! Identified models outside of the loop: in a file, as source code for other programs, and their predictions of a
//! whole record.
//!
//! | file | what it has |
//! |---|---|
//! | `file` | the model file that `hydraxis identify` writes and `hydraxis predict` reads |
//! | `learned` | what the grey boxes of a run have learned, for `hydraxis run --warm` |
//! | `source` | the model as C, Python and MATLAB |
//! | `prediction` | predictions one step and h steps ahead, and free runs |
//! | `response` | poles, and the answer to a command that is held |
//! | `without_commands` | how well the past outputs alone predict |
//!
//! Nothing here runs beside the loop or in a stage.

pub mod file;
pub mod learned;
pub mod prediction;
pub mod response;
pub mod source;
pub mod without_commands;

use pipeline::hammerstein::Coefficients;

/// A model of the position of one axis, with what has to be known to apply it.
#[derive(Debug, Clone, PartialEq)]
pub struct IdentifiedModel {
    /// The coefficients; every number is finite.
    pub coefficients: Coefficients,
    /// Sample period, s.
    pub period: f64,
    /// Horizon of the h-step error that it was judged by, samples.
    pub horizon: usize,
    /// Unit of the output; none where it was not stated.
    pub unit: Option<String>,
    /// Lowest and highest command that N was identified from.
    pub commands: [f64; 2],
    /// Where it comes from.
    pub origin: Origin,
}

/// Where a model comes from, in words.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Origin {
    /// The recordings.
    pub recordings: String,
    /// The estimator.
    pub estimator: String,
    /// The verdict.
    pub verdict: String,
}
