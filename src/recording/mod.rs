//! Messages of a group kept and written to files, beside the loop.
//!
//! ```text
//! channels --tapes--> shared memory: the last seconds of each --a latch, a death--> black box, a file
//! channels --recorder--> queue --store--> files, the oldest ones removed
//! ```
//!
//! | file | what |
//! |---|---|
//! | `tape` | the last messages of one channel |
//! | `tapes` | all channels of a group |
//! | `kept` | the last messages of all channels in shared memory, also after the death of the supervisor |
//! | `black_box` | when a file is written, and where |
//! | `recorder` | all messages of all channels, into a queue that never waits |
//! | `store` | the queue into files, whatever the disk does |
//! | `file` | one file: MCAP, CDR, zstd |
//! | `latency` | ages of the samples as histograms |
//! | `checksum` | the last field of every message |
//! | `controller_state` | a command and its sample under the names of ROS |
//! | `schema` | a schema as columns, and their values in bytes |
//! | `reading` | the messages of a file, also of a damaged one |
//! | `typed` | the messages of a file as structs |
//! | `rows` | the position and the command of an axis at every tick |

pub mod black_box;
pub mod checksum;
pub mod controller_state;
pub mod file;
#[cfg(test)]
mod hostile;
mod kept;
mod latency;
pub mod reading;
pub mod recorder;
pub mod rows;
pub mod schema;
pub mod store;
pub mod tape;
pub mod tapes;
pub mod typed;

use std::{collections::BTreeMap, path::PathBuf, time::SystemTime};

pub use pipeline::cdr;
use pipeline::stage::monotonic_ns;

/// Facts about a recording, by name.
pub type Facts = BTreeMap<String, String>;

/// Numbers by name of the channel.
type Counts = BTreeMap<&'static str, u64>;

/// Name of the record of facts that are known at the beginning.
const FACTS: &str = "hydraxis";
/// Name of the attached machine file.
pub const MACHINE: &str = "machine.toml";
/// Name of the attached list of values that replace those of the machine file.
pub const SETTINGS: &str = "settings.json";
/// What the fact `clock` says of a run in lock-step.
pub const LOCK_STEP: &str = "lock-step";

/// Name of the attached trajectory of an axis.
pub fn trajectory_name(axis: &str) -> String {
    format!("trajectory-{axis}.csv")
}

/// Whether a run was in lock-step: the ticks are the time of the machine, whatever time they took.
pub fn is_lock_step(facts: &Facts) -> bool {
    facts.get("clock").is_some_and(|clock| clock == LOCK_STEP)
}

/// Period of the ticks of a run in lock-step, s; none of a run in real time.
pub fn lock_step_period(facts: &Facts) -> Option<f64> {
    facts.get("period_s").filter(|_| is_lock_step(facts))?.parse().ok()
}

/// Names of the axes, as far as the facts tell them.
fn axes_in(facts: &Facts) -> Vec<String> {
    facts.get("axes").map(|axes| axes.split_whitespace().map(str::to_owned).collect()).unwrap_or_default()
}

/// Name of the record of facts that are known at the end only.
const END_FACTS: &str = "hydraxis.end";

/// What is to be added to `CLOCK_MONOTONIC` for the time since 1970, ns.
fn clock_ns() -> i64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    since.as_nanos() as i64 - monotonic_ns() as i64
}

/// Names the folder for recordings, or says that a run is not recorded.
const VARIABLE: &str = "HYDRAXIS_RECORDINGS";
/// Most bytes of all recordings in a folder, unless the user says otherwise.
pub const LIMIT: &str = "2GB";

/// Where recordings go unless the user says otherwise; none where the environment wants no recordings.
pub fn recordings_folder() -> Option<PathBuf> {
    match std::env::var_os(VARIABLE).filter(|value| !value.is_empty()) {
        Some(off) if off == "off" => None,
        Some(folder) => Some(folder.into()),
        None => Some(default_folder()),
    }
}

/// Where black boxes and recordings are kept unless the user says otherwise: where a service or a user keeps state.
pub fn default_folder() -> PathBuf {
    let variable = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if let Some(folder) = variable("STATE_DIRECTORY") {
        return folder;
    }
    let state = variable("XDG_STATE_HOME").or_else(|| Some(variable("HOME")?.join(".local/state")));
    state.unwrap_or_else(std::env::temp_dir).join("hydraxis")
}
