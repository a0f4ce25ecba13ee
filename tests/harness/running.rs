//! A whole group under `hydraxis run`.

use std::{
    io::Read,
    process::{Child, Command, ExitStatus, Stdio},
    thread,
};

use pipeline::{
    channel::Reader,
    message::{StageHealth, StageState},
    stage::StageKind,
};
use rustix::process::Signal;

use super::{TestGroup, hydraxis, is_running, signal, wait_for, with_machine};

/// What the supervisor has printed until its end.
pub struct Said {
    pub stdout: String,
    pub stderr: String,
}

/// All that comes through a pipe; nothing where there is no pipe.
pub fn text(pipe: Option<impl Read>) -> String {
    let mut text = String::new();
    if let Some(mut pipe) = pipe {
        pipe.read_to_string(&mut text).unwrap();
    }
    text
}

/// A whole group under a supervisor, with the pids of its stages.
pub struct Running {
    pub group: TestGroup,
    pub supervisor: Child,
    pub pids: [u32; 4],
}

/// Whether a run has ended in order: with exit code 0, or with 1 because a fault has latched an axis. In real time the
/// computer itself latches all axes when it gives a stage no time for three periods.
pub fn is_orderly(status: ExitStatus, said: &str) -> bool {
    status.success() || (status.code() == Some(1) && said.contains("the run ended with latched axes"))
}

impl Running {
    /// Starts `hydraxis run` in real time and waits until all four stages work.
    pub fn start(test: &str) -> Self {
        Self::start_with(test, &["--duration", "60s"])
    }

    /// Starts `hydraxis run` with these arguments and waits until all four stages work.
    pub fn start_with(test: &str, arguments: &[&str]) -> Self {
        let mut running = Self::spawn(test, arguments, &StageKind::ALL, |_| ());
        let channels = running.group.join();
        let mut health: Reader<StageHealth> = channels.reader().unwrap();
        wait_for("running stages", || {
            while let Some(health) = health.read().unwrap().if_new() {
                if health.state == StageState::Running as u32 {
                    running.pids[health.stage as usize] = health.pid;
                }
            }
            running.pids.iter().all(|pid| *pid != 0).then_some(())
        });
        running
    }

    /// Starts `hydraxis run` and waits for the first heartbeat of the stages in `kinds`. `set` may change the command.
    pub fn spawn(test: &str, arguments: &[&str], kinds: &[StageKind], set: impl FnOnce(&mut Command)) -> Self {
        let group = TestGroup::new(test);
        let mut command = hydraxis();
        command.args(["run", "--prefix", &group.prefix.to_string()]).args(with_machine(arguments));
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        set(&mut command);
        let supervisor = command.spawn().unwrap();
        // Trap: if the test joined before the supervisor, the supervisor would take the group for a running one.
        wait_for("the group", || group.prefix.folder().join("members").exists().then_some(()));
        let channels = group.join();
        let mut health: Reader<StageHealth> = channels.reader().unwrap();
        let mut pids = [0; 4];
        wait_for("stages that are ready", || {
            while let Some(health) = health.read().unwrap().if_new() {
                pids[health.stage as usize] = health.pid;
            }
            kinds.iter().all(|kind| pids[*kind as usize] != 0).then_some(())
        });
        drop(channels);
        Self { group, supervisor, pids }
    }

    /// Waits until another process works in a stage's place.
    pub fn await_next(&mut self, kind: StageKind, health: &mut Reader<StageHealth>) {
        let before = self.pid(kind);
        self.pids[kind as usize] = wait_for("the stage that was started again", || {
            let health = health.read().unwrap().if_new()?;
            let is_it =
                health.stage == kind as u32 && health.pid != before && health.state != StageState::Stopped as u32;
            is_it.then_some(health.pid)
        });
    }

    /// Asks the supervisor to end, as Ctrl-C does, and expects that it ends in order.
    pub fn interrupt(&mut self) -> Said {
        signal(self.supervisor.id(), Signal::INT);
        self.expect_orderly_end()
    }

    /// Waits for the supervisor's end and expects this exit code.
    pub fn expect_end(&mut self, code: i32) -> Said {
        let (status, said) = self.end();
        assert_eq!(status.code(), Some(code), "{}", said.stderr);
        said
    }

    /// Waits for the supervisor's end and expects that it ends in order ([`is_orderly`]).
    pub fn expect_orderly_end(&mut self) -> Said {
        let (status, said) = self.end();
        assert!(is_orderly(status, &said.stderr), "{status}\n{}", said.stderr);
        said
    }

    fn end(&mut self) -> (ExitStatus, Said) {
        let (stdout, stderr) = (self.supervisor.stdout.take(), self.supervisor.stderr.take());
        let (stdout, stderr) = (thread::spawn(move || text(stdout)), thread::spawn(move || text(stderr)));
        let status = wait_for("the supervisor to end", || self.supervisor.try_wait().unwrap());
        let said = Said { stdout: stdout.join().unwrap(), stderr: stderr.join().unwrap() };
        (status, said)
    }

    pub fn pid(&self, kind: StageKind) -> u32 {
        self.pids[kind as usize]
    }

    /// Whether none of the stages runs.
    pub fn none_runs(&self) -> bool {
        self.pids.iter().all(|pid| *pid == 0 || !is_running(*pid))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.supervisor.kill();
        let _ = self.supervisor.wait();
        wait_for("the stages to die with their supervisor", || self.none_runs().then_some(()));
    }
}
