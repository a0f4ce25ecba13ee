//! What the test binaries share: running the command, groups of real processes, waiting within a bound.
#![allow(dead_code, unused_imports, reason = "each test binary uses a part of the harness")]

pub mod bus;
pub mod channel;
pub mod cli;
mod cores;
mod dice;
mod group;
pub mod mechanism;
pub mod place;
pub mod records;
pub mod replay;
mod report;
pub mod running;

pub use cores::{Cores, alone, is_strict, shared};
pub use dice::Dice;
pub use group::{TestGroup, files, processes};
pub use report::{report, strip_times, succeed};

use std::{
    fmt::Display,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    str::FromStr,
    time::{Duration, Instant},
};

use rustix::process::{Pid, Signal, kill_process};

/// Longest wait for something that has to come. It is far longer than the same thing takes on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// The machine file of four independent axes, on which groups are tested.
pub const FOUR_AXES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/four-axes.toml");

/// `arguments` with [`FOUR_AXES`] in front, unless they name a machine file themselves.
fn with_machine<'a>(arguments: &[&'a str]) -> Vec<&'a str> {
    let is_model = |index: usize| index > 0 && arguments[index - 1] == "--model";
    let is_machine = |(index, argument): (usize, &&str)| argument.ends_with(".toml") && !is_model(index);
    let machine = (!arguments.iter().enumerate().any(is_machine)).then_some(FOUR_AXES);
    machine.into_iter().chain(arguments.iter().copied()).collect()
}

/// The command under test, without standard input.
pub fn hydraxis() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hydraxis"));
    command.stdin(Stdio::null());
    // Black boxes of runs with faults.
    command.env("XDG_STATE_HOME", env!("CARGO_TARGET_TMPDIR")).env_remove("STATE_DIRECTORY");
    // Most tests want no recording of their runs.
    command.env("HYDRAXIS_RECORDINGS", "off");
    command
}

/// Calls `look` until it returns something, for [`PATIENCE`] at most.
pub fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let until = Instant::now() + PATIENCE;
    loop {
        if let Some(seen) = look() {
            return seen;
        }
        assert!(Instant::now() < until, "waited {PATIENCE:?} for {what}");
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// The value of an environment variable, or the default where it is not set.
pub fn variable<T: FromStr<Err: Display>>(name: &str, default: T) -> T {
    std::env::var(name).map_or(default, |text| text.parse().unwrap_or_else(|error| panic!("{name}={text}: {error}")))
}

/// Sends a signal to a process.
pub fn signal(pid: u32, signal: Signal) {
    kill_process(Pid::from_raw(i32::try_from(pid).unwrap()).unwrap(), signal).unwrap();
}

/// Whether a process runs: it exists, and is not a zombie whose threads have all ended.
pub fn is_running(pid: u32) -> bool {
    let Ok(stat) = std::fs::read_to_string(format!("/proc/{pid}/stat")) else { return false };
    // The state follows the name, which may contain spaces and ends at the last bracket.
    let is_zombie = stat.rsplit(") ").next().is_some_and(|rest| rest.starts_with('Z'));
    // The main thread may be a zombie while other threads are still ending: then the process has not died yet.
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).map_or(0, Iterator::count);
    !is_zombie || threads > 1
}

/// Writes a machine file: the machine of [`FOUR_AXES`] with the first `from` replaced by `to`.
pub fn machine_file(folder: &Path, from: &str, to: &str) -> PathBuf {
    let text = pipeline::machine::FOUR_AXES;
    assert!(text.contains(from), "the machine has no {from:?}");
    let file = folder.join("machine.toml");
    std::fs::write(&file, text.replacen(from, to, 1)).unwrap();
    file
}
