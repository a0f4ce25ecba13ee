//! How the stages are ended: they are asked to end, the controller first, and killed when they do not end in time.
//!
//! ```text
//! SIGTERM control-proc, 150 ms | SIGTERM the others, 600 ms | SIGKILL what is left
//! ```
//!
//! A second signal to the supervisor skips to the last step; only the controller still gets a short time to send its
//! neutral command. Every signal goes to the whole process group of a stage, so that the children of a foreign program
//! end as well.

use std::{
    os::unix::process::ExitStatusExt,
    time::{Duration, Instant},
};

use humantime::format_duration;
use pipeline::stage::StageKind;
use rustix::process::Signal;

use super::{
    Supervisor, SupervisorError,
    life::{Life, cause},
};

/// The order in which stages are asked to end.
const ORDER: [StageKind; 4] =
    [StageKind::ControlProc, StageKind::IdentProc, StageKind::SensorProc, StageKind::PlantSim];
/// Time in which a stage must end before it is killed: many times the two longest waits of a stage.
const GRACE: Duration = Duration::from_millis(600);
/// Time that the controller has for its neutral command before the stages that read it are ended.
const NEUTRAL: Duration = Duration::from_millis(150);
/// Time that the controller has after a second signal.
const LAST_CHANCE: Duration = Duration::from_millis(100);
/// Time in which a killed process must have ended.
const KILLED: Duration = Duration::from_secs(1);
/// Time between two looks at the signals.
const POLL: Duration = Duration::from_millis(5);

impl Supervisor<'_> {
    /// Ends all stages. Returns the first failure of a stage to end as it was asked to, if any.
    pub fn stop(&mut self) -> Option<SupervisorError> {
        if !self.is_stopping {
            self.is_stopping = true;
            self.log.show(Vec::new());
            self.service_manager.stopping();
            // Signals that have come so far are the reason for this stop; only later ones hurry it.
            self.interrupts.any();
            self.stages.iter_mut().for_each(|stage| stage.due = None);
            self.settle(Duration::ZERO);
            self.end_all();
            // After the stages, whose last messages are wanted in the file.
            if let Some(mut recorder) = self.recorder.take() {
                let interrupts = &mut self.interrupts;
                recorder.end(&self.log, &self.deaths, || interrupts.again());
            }
        }
        self.failure.take()
    }

    fn end_all(&mut self) {
        self.ask(StageKind::ControlProc);
        let mut in_hurry = self.await_end(NEUTRAL, Some(StageKind::ControlProc), true);
        for kind in ORDER.into_iter().skip(1).filter(|_| !in_hurry) {
            self.ask(kind);
        }
        in_hurry = in_hurry || self.await_end(GRACE, None, true);
        if in_hurry {
            self.say("asked again: killing what still runs");
            self.await_end(LAST_CHANCE, Some(StageKind::ControlProc), false);
        }
        for stage in self.stages.iter_mut() {
            let Some(life) = &stage.life else { continue };
            life.signal(Signal::KILL);
            let why = if in_hurry {
                "killed in a hurry".into()
            } else {
                format!("did not end within {}: killed", format_duration(GRACE))
            };
            self.log.say(format!("{}: {why}", stage.kind.name()));
            stage.killed_for = Some(why);
        }
        self.await_end(KILLED, None, false);
        for stage in self.stages.iter().filter(|stage| stage.life.is_some()) {
            let limit = format_duration(KILLED);
            self.log.say(format!("{}: killed, and still there after {limit}", stage.kind.name()));
        }
    }

    fn ask(&self, kind: StageKind) {
        for life in self.stages.iter().filter(|stage| stage.kind == kind).filter_map(|stage| stage.life.as_ref()) {
            life.signal(Signal::TERM);
            self.say(format!("{}: asked to end", kind.name()));
        }
    }

    /// Waits until `kind`, or all stages, have ended, at most for `longest`. True when a signal ended the wait, which
    /// it may where `may_hurry` is set.
    fn await_end(&mut self, longest: Duration, kind: Option<StageKind>, may_hurry: bool) -> bool {
        let until = Instant::now() + longest;
        loop {
            let mut running = self.stages.iter().filter(|stage| stage.life.is_some());
            if !running.any(|stage| kind.is_none_or(|kind| stage.kind == kind)) || Instant::now() >= until {
                return false;
            }
            if may_hurry && self.interrupts.again() {
                return true;
            }
            self.settle(POLL);
        }
    }

    /// Waits for the next end of a process, at most for `wait`, and reaps all that have ended.
    fn settle(&mut self, wait: Duration) {
        for pid in self.deaths.wait(wait) {
            let mut stages = self.stages.iter_mut();
            let Some(stage) = stages.find(|stage| stage.life.as_ref().is_some_and(|life| life.pid() == pid)) else {
                continue;
            };
            let (kind, killed_for) = (stage.kind, stage.killed_for.take());
            let Some(Ok(status)) = stage.life.take().map(Life::end) else { continue };
            // A program that does not handle the signal has ended as it was asked to.
            if status.success() || status.signal() == Some(Signal::TERM.as_raw()) {
                self.say(format!("{}: ended", kind.name()));
                continue;
            }
            let what = format!("{} {}", kind.name(), killed_for.unwrap_or_else(|| cause(status)));
            self.say(what.as_str());
            let last_lines = self.log.last_lines(kind);
            self.failure.get_or_insert(SupervisorError::Ended { what, last_lines });
        }
    }
}
