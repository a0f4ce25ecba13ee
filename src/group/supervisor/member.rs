//! One life of a stage: a process in a group of its own, from its start until it is reaped.
//!
//! Its standard input is a pipe that only this process holds the other end of: it ends when this process does, which a
//! stage takes as a request to end. Its output and its errors go to the log.
//!
//! Trap: lives begin on the main thread only. A stage asks the kernel for a signal at the death of its parent, and the
//! kernel takes the thread for the parent.

use std::{
    io,
    os::unix::process::{CommandExt, ExitStatusExt},
    process::{Child, ChildStdin, Command, ExitStatus, Stdio},
    thread::{Builder, JoinHandle, sleep},
    time::{Duration, Instant},
};

use pipeline::stage::StageKind;
use rustix::process::{Pid, Signal, kill_process_group};

use super::{
    deaths::{Deaths, Watched},
    log::Log,
};

/// Stack of a thread that only copies lines.
const STACK: usize = 128 * 1024;
/// How long the last lines of a dead process are waited for.
const LAST_LINES: Duration = Duration::from_millis(200);
/// What a service manager says to the supervisor alone.
const NOT_INHERITED: [&str; 3] = ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"];

/// A process that runs, or has ended and is not reaped yet.
pub struct Life {
    process: Child,
    pid: Pid,
    _lifeline: Option<ChildStdin>,
    readers: Vec<JoinHandle<()>>,
    _watched: Option<Watched>,
    started: Instant,
}

impl Life {
    /// Starts the process, whose end is told by `deaths`.
    pub fn begin(kind: StageKind, mut command: Command, log: &Log, deaths: &Deaths) -> io::Result<Self> {
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).process_group(0);
        for name in NOT_INHERITED {
            command.env_remove(name);
        }
        let mut process = command.spawn()?;
        let pid = Pid::from_child(&process);
        let mut life = Self {
            pid,
            _lifeline: process.stdin.take(),
            readers: Vec::new(),
            _watched: None,
            started: Instant::now(),
            process,
        };
        let begun = life.watch(kind, log, deaths);
        if begun.is_err() {
            life.signal(Signal::KILL);
            let _ = life.process.wait();
        }
        begun.map(|()| life)
    }

    fn watch(&mut self, kind: StageKind, log: &Log, deaths: &Deaths) -> io::Result<()> {
        let thread = || Builder::new().stack_size(STACK);
        if let Some(stdout) = self.process.stdout.take() {
            self.readers.push(thread().spawn(log.drain(kind, stdout))?);
        }
        if let Some(stderr) = self.process.stderr.take() {
            self.readers.push(thread().spawn(log.drain(kind, stderr))?);
        }
        self._watched = Some(deaths.watch(self.pid)?);
        Ok(())
    }

    /// Its process, which is also its group.
    pub fn pid(&self) -> Pid {
        self.pid
    }

    /// For how long it has lived.
    pub fn age(&self) -> Duration {
        self.started.elapsed()
    }

    /// Signals the process and all that it has started.
    pub fn signal(&self, signal: Signal) {
        // It may have ended since it was last looked at: then there is nobody to ask.
        let _ = kill_process_group(self.pid, signal);
    }

    /// Reaps a process whose death was told, with what it has left running, once its last lines are in the log.
    pub fn end(mut self) -> io::Result<ExitStatus> {
        self.signal(Signal::KILL);
        let status = self.process.wait();
        let until = Instant::now() + LAST_LINES;
        while self.readers.iter().any(|reader| !reader.is_finished()) && Instant::now() < until {
            sleep(Duration::from_millis(1));
        }
        status
    }
}

/// What ended a process, in words.
pub fn cause(status: ExitStatus) -> String {
    match (status.signal(), status.code()) {
        (Some(number), _) => match signal_hook::low_level::signal_name(number) {
            Some(name) => format!("killed by {name}"),
            None => format!("killed by signal {number}"),
        },
        (None, Some(0)) => "ended before its time".to_owned(),
        (None, Some(code)) => format!("ended with exit code {code}"),
        (None, None) => "ended".to_owned(),
    }
}
