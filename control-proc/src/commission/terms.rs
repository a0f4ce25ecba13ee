//! What the experiment takes and gives.

use std::time::Duration;

use super::experiment::watch::Abort;

/// What the experiment may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExperimentOptions {
    /// Travel of the window, m, around where the axis stands; 0.4 of the soft limits' without it.
    pub travel: Option<f64>,
    /// Speed bound, m/s; 0.25 of the axis' greatest without it.
    pub speed: Option<f64>,
    /// All of it, of one axis.
    pub duration: Duration,
    /// Of the random steps.
    pub seed: u64,
}

impl Default for ExperimentOptions {
    fn default() -> Self {
        Self { travel: None, speed: None, duration: Duration::from_secs(60), seed: 1 }
    }
}

/// What was commanded and what came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct ExperimentRecord {
    /// s.
    pub period: f64,
    /// u(k), held from sample k to the next, in [-1, 1].
    pub commands: Vec<f64>,
    /// y(k), m; NaN where there was no usable sample.
    pub positions: Vec<f64>,
}

/// Where the experiment is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Looks at the noise.
    Rest,
    /// Looks for the levels that move the axis.
    Pulses,
    /// Looks for the levels that make the allowed speed.
    Strokes,
    /// Random steps.
    Random,
    /// Waits for standstill.
    End,
    /// It is over.
    Over,
}

impl Phase {
    /// In a word.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rest => "rest",
            Self::Pulses => "pulses",
            Self::Strokes => "strokes",
            Self::Random => "random steps",
            Self::End => "end",
            Self::Over => "over",
        }
    }
}

/// How it ended. The command is neutral from then on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome {
    /// The record is complete.
    Finished,
    /// A bound was met.
    Aborted(Abort),
}
