//! One line of the report: a verdict, what was found, and what to do about it.

use std::{collections::BTreeSet, time::Duration};

use pipeline::{
    machine::{Machine, Wait},
    stage::StageKind,
};
use serde::Serialize;

/// Whether a property of the computer is fit for real time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// It is fit.
    Good,
    /// It is not fit.
    Bad,
    /// It cannot be read, or depends on something that is not known.
    Unknown,
}

impl Verdict {
    /// The name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Bad => "bad",
            Self::Unknown => "unknown",
        }
    }
}

/// One line of the report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// The property.
    pub check: &'static str,
    /// Whether the property is fit.
    pub verdict: Verdict,
    /// What was found.
    pub found: String,
    /// What to do; empty when there is nothing to be done.
    pub advice: String,
}

/// The property is fit.
pub fn good(check: &'static str, found: impl Into<String>) -> Finding {
    Finding { check, verdict: Verdict::Good, found: found.into(), advice: String::new() }
}

/// The property is not fit; `advice` says what to do.
pub fn bad(check: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Finding {
    Finding { check, verdict: Verdict::Bad, found: found.into(), advice: advice.into() }
}

/// It is not known whether the property is fit; `advice` may be empty.
pub fn unknown(check: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Finding {
    Finding { check, verdict: Verdict::Unknown, found: found.into(), advice: advice.into() }
}

/// What a machine file asks of the system.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Needs {
    /// Sample and control period.
    pub period: Duration,
    /// Cores that stages ask for, sorted.
    pub cores: Vec<usize>,
    /// Highest SCHED_FIFO priority of a stage.
    pub priority: Option<u8>,
    /// Whether a stage polls without a pause under SCHED_FIFO.
    pub spins: bool,
    /// Whether the stages lock their memory.
    pub lock_memory: bool,
}

impl Needs {
    /// The needs of a machine.
    pub fn of(machine: &Machine) -> Self {
        let stages = StageKind::ALL.map(|kind| machine.stage(kind));
        let cores: BTreeSet<usize> = stages.iter().filter_map(|stage| stage.core).collect();
        Self {
            period: machine.timing.period,
            cores: cores.into_iter().collect(),
            priority: stages.iter().filter_map(|stage| stage.priority).max(),
            spins: stages.iter().any(|stage| stage.wait == Wait::Spin && stage.priority.is_some()),
            lock_memory: machine.realtime.lock_memory,
        }
    }
}
