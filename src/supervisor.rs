//! The process group: starts the stages, watches them, ends them, and names the first cause when one fails.
//!
//! Every stage gets a process group of its own, so that Ctrl-C on the terminal reaches the supervisor alone, which
//! then ends them in order: the controller first, so that the valves are neutral.

use std::{
    os::unix::process::{CommandExt, ExitStatusExt},
    process::{Child, Command, ExitStatus, Stdio},
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::stage::StageKind;
use rustix::process::{Pid, Signal, kill_process};

use crate::failure::Failure;

/// The order in which stages are asked to end.
const STOP_ORDER: [StageKind; 4] =
    [StageKind::ControlProc, StageKind::IdentProc, StageKind::SensorProc, StageKind::PlantSim];
/// How long a stage may take to end before it is killed: two of its longest waits, many times over.
const GRACE: Duration = Duration::from_millis(600);
/// How often children are looked at while they end.
const POLL: Duration = Duration::from_millis(5);

/// One stage as a process.
struct Member {
    kind: StageKind,
    process: Child,
    ended: Option<ExitStatus>,
}

/// The running stages. Dropping it ends them.
#[derive(Default)]
pub struct Supervisor {
    members: Vec<Member>,
}

impl Supervisor {
    /// Starts a stage.
    ///
    /// # Errors
    /// The program cannot be started.
    pub fn start(&mut self, kind: StageKind, mut command: Command) -> Result<(), Failure> {
        command.stdin(Stdio::null()).process_group(0);
        let process = command.spawn().map_err(|error| {
            let program = command.get_program().to_string_lossy().into_owned();
            Failure::Run(format!("{}: \"{program}\" cannot be started: {error}", kind.name()))
        })?;
        self.members.push(Member { kind, process, ended: None });
        Ok(())
    }

    /// Reaps what has ended; the first stage that failed, if any, with its cause.
    pub fn failed(&mut self) -> Option<Failure> {
        self.reap();
        self.members.iter().find_map(|member| {
            let status = member.ended.filter(|status| !status.success())?;
            Some(Failure::Run(format!("{} {}", member.kind.name(), cause(status))))
        })
    }

    /// Whether a stage is running.
    pub fn is_running(&mut self, kind: StageKind) -> bool {
        self.reap();
        self.members.iter().any(|member| member.kind == kind && member.ended.is_none())
    }

    /// Whether any stage is running.
    pub fn any_running(&mut self) -> bool {
        self.reap();
        self.members.iter().any(|member| member.ended.is_none())
    }

    fn reap(&mut self) {
        for member in self.members.iter_mut().filter(|member| member.ended.is_none()) {
            if let Ok(Some(status)) = member.process.try_wait() {
                member.ended = Some(status);
            }
        }
    }

    /// Asks every running stage to end, the controller first, and kills whatever has not after a bounded time.
    pub fn stop(&mut self) {
        self.reap();
        for kind in STOP_ORDER {
            for member in self.members.iter().filter(|member| member.kind == kind && member.ended.is_none()) {
                signal(&member.process, Signal::TERM);
            }
            if kind == StageKind::ControlProc {
                // The neutral command goes out before its readers end.
                self.await_end(kind, GRACE / 4);
            }
        }
        let until = Instant::now() + GRACE;
        while self.any_running() && Instant::now() < until {
            sleep(POLL);
        }
        for member in self.members.iter_mut().filter(|member| member.ended.is_none()) {
            eprintln!("{}: did not end within {GRACE:?}, killed", member.kind.name());
            signal(&member.process, Signal::KILL);
            member.ended = member.process.wait().ok();
        }
    }

    fn await_end(&mut self, kind: StageKind, longest: Duration) {
        let until = Instant::now() + longest;
        while self.is_running(kind) && Instant::now() < until {
            sleep(POLL);
        }
    }
}

impl Drop for Supervisor {
    fn drop(&mut self) {
        self.stop();
    }
}

fn signal(process: &Child, signal: Signal) {
    if let Some(pid) = i32::try_from(process.id()).ok().and_then(Pid::from_raw) {
        // It may have ended since it was last looked at: then there is nobody to ask.
        let _ = kill_process(pid, signal);
    }
}

/// What ended a process, in words.
fn cause(status: ExitStatus) -> String {
    match (status.signal(), status.code()) {
        (Some(number), _) => match signal_hook::low_level::signal_name(number) {
            Some(name) => format!("killed by {name}"),
            None => format!("killed by signal {number}"),
        },
        (None, Some(code)) => format!("ended with exit code {code}"),
        (None, None) => "ended".to_owned(),
    }
}
