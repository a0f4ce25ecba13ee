//! The last figures of `hydraxis doctor`, which are kept for `hydraxis check`.
//!
//! They are in the file `doctor.json` of the folder where black boxes are kept as well. A folder may be that of several
//! computers, so the name of the computer is in the file.

use std::{
    fs,
    path::PathBuf,
    time::{Duration, SystemTime},
};

use serde::{Deserialize, Serialize};

use super::latency::WakeUpLatency;
use crate::recording::default_folder;

/// What is kept.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Kept {
    /// Name of the computer.
    pub computer: String,
    /// Time of the measurement since 1970, s.
    pub at_s: u64,
    /// 99.9th percentile of the lateness of a wake-up, ns: the larger one of both measurements.
    pub p99_9_ns: u64,
    /// Largest lateness, ns.
    pub max_ns: u64,
}

fn file() -> PathBuf {
    default_folder().join("doctor.json")
}

fn computer() -> String {
    fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default().trim().to_owned()
}

fn now_s() -> u64 {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_secs()
}

/// Keeps the figures. A folder that cannot be written is no failure: `check` then compares with nothing.
pub fn keep(latency: &[WakeUpLatency]) {
    let largest = |figure: fn(&WakeUpLatency) -> u64| latency.iter().map(figure).max().unwrap_or_default();
    let kept = Kept {
        computer: computer(),
        at_s: now_s(),
        p99_9_ns: largest(|latency| latency.percentiles.p99_9),
        max_ns: largest(|latency| latency.percentiles.max),
    };
    let Ok(text) = serde_json::to_string_pretty(&kept) else { return };
    let _ = fs::create_dir_all(default_folder()).and_then(|()| fs::write(file(), text + "\n"));
}

impl Kept {
    /// The figures that were kept last on this computer, if there are any.
    pub fn last() -> Option<Self> {
        let kept: Self = serde_json::from_str(&fs::read_to_string(file()).ok()?).ok()?;
        (kept.computer == computer()).then_some(kept)
    }

    /// Where and when they were measured, in words.
    pub fn when(&self) -> String {
        // To the minute.
        let minutes = now_s().saturating_sub(self.at_s) / 60;
        match minutes {
            0 => "`hydraxis doctor`, just now".to_owned(),
            _ => format!("`hydraxis doctor`, {} ago", humantime::format_duration(Duration::from_secs(60 * minutes))),
        }
    }
}
