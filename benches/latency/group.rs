//! A group of processes that is measured.

use std::{
    process::{Child, Command, Stdio},
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::{
    channel::{Group, Prefix, Reader, remove_leftovers},
    message::{StageHealth, StageState},
    stage::StageKind,
};
use rustix::process::{Pid, Signal, kill_process};

use crate::PERIOD;

/// Longest time that anything may take to begin.
const PATIENCE: Duration = Duration::from_secs(20);

/// A group whose processes end when this value is dropped.
pub struct Running {
    pub prefix: Prefix,
    processes: Vec<Child>,
}

impl Running {
    /// A group without processes.
    pub fn new(name: &str) -> Self {
        let prefix = format!("b{}-{name}", std::process::id()).parse().expect("letters and digits");
        Self { prefix, processes: Vec::new() }
    }

    /// Starts `hydraxis` with these arguments in the group.
    pub fn start(&mut self, arguments: &[&str]) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hydraxis"));
        command.args(arguments).args(["--prefix", &self.prefix.to_string()]);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        self.processes.push(command.spawn().expect("the command was built for this benchmark"));
    }

    pub fn join(&self) -> Group {
        Group::join(&self.prefix, "bench").expect("the group can be joined")
    }

    /// A complete real-time group, after all stages have begun to work.
    pub fn real_time(name: &str, settings: &[&str]) -> (Self, Group, Reader<StageHealth>) {
        let mut running = Self::new(name);
        let period = format!("timing.period={}us", PERIOD.as_micros());
        let settings: Vec<&str> = [period.as_str()].iter().chain(settings).flat_map(|s| ["--set", *s]).collect();
        running.start(&[&["run", "--duration", "3600s", "--no-record"], &settings[..]].concat());
        await_some(|| running.prefix.folder().join("members").exists().then_some(()));
        let group = running.join();
        let mut health: Reader<StageHealth> = group.reader().expect("a place among the readers");
        let mut works = [false; 4];
        await_some(|| {
            while let Some(health) = health.read().expect("a channel").if_new() {
                works[health.stage as usize] |= health.state == StageState::Running as u32;
            }
            (works == [true; 4]).then_some(())
        });
        (running, group, health)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        for process in &mut self.processes {
            let _ = kill_process(Pid::from_child(process), Signal::TERM);
        }
        for process in &mut self.processes {
            let _ = process.wait();
        }
        let _ = remove_leftovers(&self.prefix);
    }
}

/// Polls until `look` returns something.
pub fn await_some<T>(mut look: impl FnMut() -> Option<T>) -> T {
    let until = Instant::now() + PATIENCE;
    loop {
        if let Some(seen) = look() {
            return seen;
        }
        assert!(Instant::now() < until, "nothing within {PATIENCE:?}");
        sleep(Duration::from_micros(200));
    }
}

/// The first health of a stage whose figures were all measured after `since_ns`.
pub fn health_of(kind: StageKind, health: &mut Reader<StageHealth>, since_ns: u64) -> StageHealth {
    let mut beats = 0;
    await_some(|| {
        while let Some(health) = health.read().expect("a channel").if_new() {
            // Each heartbeat evaluates one of four histograms.
            beats += u32::from(health.stage == kind as u32 && health.header.sent_ns > since_ns);
            if beats >= 5 && health.stage == kind as u32 {
                return Some(*health);
            }
        }
        None
    })
}
