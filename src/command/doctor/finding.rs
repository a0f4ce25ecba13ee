//! One line of the doctor's: a verdict, what was found, and what to do about it.

use std::{collections::BTreeSet, time::Duration};

use pipeline::{
    machine::{Machine, Wait},
    stage::StageKind,
};
use serde::Serialize;

/// Whether something is fit for real time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// It is.
    Good,
    /// It is not.
    Bad,
    /// It cannot be told, or depends on what is not known.
    Unknown,
}

impl Verdict {
    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Bad => "bad",
            Self::Unknown => "unknown",
        }
    }
}

/// One line.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// What was looked at.
    pub check: &'static str,
    /// Whether it is fit.
    pub verdict: Verdict,
    /// What was found.
    pub found: String,
    /// What to do; empty when there is nothing to be done.
    pub advice: String,
}

/// All is well.
pub fn good(check: &'static str, found: impl Into<String>) -> Finding {
    Finding { check, verdict: Verdict::Good, found: found.into(), advice: String::new() }
}

/// It is not, and this would help.
pub fn bad(check: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Finding {
    Finding { check, verdict: Verdict::Bad, found: found.into(), advice: advice.into() }
}

/// It cannot be told; this would help, if anything.
pub fn unknown(check: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Finding {
    Finding { check, verdict: Verdict::Unknown, found: found.into(), advice: advice.into() }
}

/// What a machine file asks of the system.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Needs {
    /// Sample and control period.
    pub period: Duration,
    /// Cores that stages are to stay on, sorted.
    pub cores: Vec<usize>,
    /// Highest SCHED_FIFO priority of a stage.
    pub priority: Option<u8>,
    /// Whether a stage polls without a pause under SCHED_FIFO.
    pub spins: bool,
    /// Whether the stages lock their memory.
    pub lock_memory: bool,
}

impl Needs {
    /// Of this machine.
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
