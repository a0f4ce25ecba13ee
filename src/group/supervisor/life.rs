//! One life of a stage: a process in a process group of its own, from its start until it is reaped.
//!
//! The standard input of the process is a pipe whose other end only the supervisor holds. The pipe ends when the
//! supervisor does, and the stage then ends as well. Standard output and standard error go to the log.
//!
//! Trap: only the main thread may start a process. A stage asks the kernel for a signal at the end of its parent, and
//! the kernel takes the *thread* that started the stage for the parent.

use std::{
    io,
    os::unix::process::{CommandExt, ExitStatusExt},
    process::{Child, ChildStdin, Command, ExitStatus, Stdio},
    thread::{Builder, JoinHandle, sleep},
    time::{Duration, Instant},
};

use rustix::process::{Pid, Signal, kill_process_group};

use super::{
    deaths::{Deaths, Watched},
    log::{Log, Origin},
};

/// Stack of a thread that only copies lines, bytes.
const STACK: usize = 128 * 1024;
/// Longest time to wait for the last lines of a process that has ended.
const LAST_LINES: Duration = Duration::from_millis(200);
/// Environment variables by which a service manager speaks to the supervisor alone.
const NOT_INHERITED: [&str; 3] = ["NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"];

/// A process that runs, or that has ended and is not reaped yet.
pub struct Life {
    process: Child,
    pid: Pid,
    _lifeline: Option<ChildStdin>,
    readers: Vec<JoinHandle<()>>,
    _watched: Option<Watched>,
    started: Instant,
}

impl Life {
    /// Starts the process. `deaths` reports its end.
    pub fn begin(from: Origin, mut command: Command, log: &Log, deaths: &Deaths) -> io::Result<Self> {
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
        let begun = life.watch(from, log, deaths);
        if begun.is_err() {
            life.signal(Signal::KILL);
            let _ = life.process.wait();
        }
        begun.map(|()| life)
    }

    fn watch(&mut self, from: Origin, log: &Log, deaths: &Deaths) -> io::Result<()> {
        let thread = || Builder::new().stack_size(STACK);
        if let Some(stdout) = self.process.stdout.take() {
            self.readers.push(thread().spawn(log.drain(from, stdout))?);
        }
        if let Some(stderr) = self.process.stderr.take() {
            self.readers.push(thread().spawn(log.drain(from, stderr))?);
        }
        self._watched = Some(deaths.watch(self.pid)?);
        Ok(())
    }

    /// The number of the process, which is also that of its process group.
    pub fn pid(&self) -> Pid {
        self.pid
    }

    /// Time since the start.
    pub fn age(&self) -> Duration {
        self.started.elapsed()
    }

    /// Sends a signal to the process and to all processes that it has started.
    pub fn signal(&self, signal: Signal) {
        // The process may have ended already; then there is nothing to do.
        let _ = kill_process_group(self.pid, signal);
    }

    /// Reaps a process that has ended, kills the processes that it has left, and waits until its last lines are in the
    /// log.
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

/// Why a process ended, in words.
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
