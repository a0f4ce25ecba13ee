//! A group of real processes for one test: its own prefix, nothing left behind.
#![allow(dead_code, reason = "each test file uses the part that it needs")]

pub mod channel;
pub mod running;

use std::{
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

use pipeline::{
    channel::{Group, Prefix, remove_leftovers},
    stage::StageKind,
};
use rustix::process::{Pid, Signal, kill_process};

/// Longest wait for anything that has to come; far beyond what it takes on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// Groups in real time take the machine's cores: there is one of them at a time in a test binary.
pub fn alone() -> MutexGuard<'static, ()> {
    static CORES: Mutex<()> = Mutex::new(());
    CORES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The command under test.
pub fn hydraxis() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hydraxis"));
    command.stdin(Stdio::null());
    command
}

/// Runs the command to its end and expects success.
pub fn succeed(arguments: &[&str]) -> Output {
    let output = hydraxis().args(arguments).output().unwrap();
    assert!(output.status.success(), "{arguments:?}\n{}", String::from_utf8_lossy(&output.stderr));
    output
}

/// What a run reports as JSON, without wall times and latencies.
pub fn report(arguments: &[&str]) -> serde_json::Value {
    let output = succeed(&[arguments, &["--json", "-"]].concat());
    let mut value = serde_json::from_slice(&output.stdout).unwrap();
    strip_times(&mut value);
    value
}

/// Removes what differs from run to run.
pub fn strip_times(value: &mut serde_json::Value) {
    if let serde_json::Value::Object(object) = value {
        object.retain(|key, _| !key.ends_with("_ns") && key != "wall_s");
        object.values_mut().for_each(strip_times);
    }
}

/// A prefix of its own, and the processes that were started under it.
pub struct TestGroup {
    pub prefix: Prefix,
    children: Vec<Child>,
}

impl TestGroup {
    pub fn new(test: &str) -> Self {
        Self { prefix: format!("t{}-{test}", std::process::id()).parse().unwrap(), children: Vec::new() }
    }

    pub fn join(&self) -> Group {
        Group::join(&self.prefix, "test").unwrap()
    }

    /// Starts one stage as a process of its own.
    pub fn start(&mut self, kind: StageKind, arguments: &[&str]) {
        let child = hydraxis()
            .arg(kind.name())
            .args(["--prefix", &self.prefix.to_string()])
            .args(arguments)
            .stderr(Stdio::piped())
            .spawn();
        self.children.push(child.unwrap());
    }

    /// Starts all stages but one, which is the test's to play.
    pub fn start_all_but(&mut self, played: StageKind, arguments: &[&str]) {
        for kind in StageKind::ALL.into_iter().filter(|kind| *kind != played) {
            self.start(kind, arguments);
        }
    }

    /// Waits until every stage has ended well.
    pub fn expect_end(&mut self) {
        for mut child in self.children.drain(..) {
            let status = wait_for("the stage to end", || child.try_wait().unwrap());
            let mut text = String::new();
            if let Some(mut stderr) = child.stderr.take() {
                std::io::Read::read_to_string(&mut stderr, &mut text).unwrap();
            }
            assert!(status.success(), "{status}: {text}");
        }
    }

    /// Files of the group in shared memory and elsewhere.
    pub fn files(&self) -> Vec<PathBuf> {
        files(&self.prefix)
    }
}

impl Drop for TestGroup {
    fn drop(&mut self) {
        for child in &mut self.children {
            let _ = child.kill();
            let _ = child.wait();
        }
        // Whoever is still attached belongs to a test that has failed.
        let _ = remove_leftovers(&self.prefix);
    }
}

/// Files that belong to a prefix.
pub fn files(prefix: &Prefix) -> Vec<PathBuf> {
    let start = format!("{prefix}.");
    let shared = std::fs::read_dir("/dev/shm").unwrap().flatten().map(|entry| entry.path());
    let mut found: Vec<PathBuf> =
        shared.filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&start))).collect();
    found.extend(Some(prefix.folder()).filter(|folder| folder.exists()));
    found
}

/// Looks until there is something to see, within a bound.
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

/// Sends a signal to a process.
pub fn signal(pid: u32, signal: Signal) {
    kill_process(Pid::from_raw(i32::try_from(pid).unwrap()).unwrap(), signal).unwrap();
}

/// Whether a process runs: neither gone nor a zombie with all its threads.
pub fn is_running(pid: u32) -> bool {
    let Ok(stat) = std::fs::read_to_string(format!("/proc/{pid}/stat")) else { return false };
    // The state follows the name, which may hold spaces and is closed by the last bracket.
    let is_zombie = stat.rsplit(") ").next().is_some_and(|rest| rest.starts_with('Z'));
    // The first thread may be one while others are still ending: the process has not died yet.
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).map_or(0, Iterator::count);
    !is_zombie || threads > 1
}

/// A machine file in a folder, from the built-in text with one piece replaced.
pub fn machine_file(folder: &Path, from: &str, to: &str) -> PathBuf {
    let text = pipeline::machine::BUILT_IN;
    assert!(text.contains(from), "{from}");
    let file = folder.join("machine.toml");
    std::fs::write(&file, text.replacen(from, to, 1)).unwrap();
    file
}
