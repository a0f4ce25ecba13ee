//! Options, phases and outcome of an experiment.

use std::time::Duration;

use super::abort::Abort;

/// What the experiment may do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExperimentOptions {
    /// Travel of the window around where the axis stands, m; 0.4 of the travel between the soft limits without it.
    pub travel: Option<f64>,
    /// Speed bound, m/s; 0.25 of the axis' `max_speed` without it.
    pub speed: Option<f64>,
    /// Duration of the whole experiment with one axis.
    pub duration: Duration,
    /// Seed of the random steps.
    pub seed: u64,
}

impl Default for ExperimentOptions {
    fn default() -> Self {
        Self { travel: None, speed: None, duration: Duration::from_secs(120), seed: 1 }
    }
}

/// The phase that the experiment is in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Measures the noise at neutral.
    Rest,
    /// Searches the levels that move the axis.
    Pulses,
    /// Searches the levels that make the allowed speed.
    Strokes,
    /// Random steps.
    Random,
    /// Waits for standstill.
    End,
    /// The experiment is over.
    Over,
}

impl Phase {
    /// Name of the phase.
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

/// How the experiment ended. The command is neutral from then on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Outcome {
    /// The record is complete.
    Finished,
    /// A bound was exceeded, or somebody ended the experiment.
    Aborted(Abort),
}
