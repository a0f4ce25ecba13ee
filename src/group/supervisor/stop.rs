//! How the stages are ended: asked, the controller first, then killed when they have not ended within a bound.
//!
//! ```text
//! SIGTERM control-proc, 150 ms | SIGTERM the others, 600 ms | SIGKILL what is left
//! ```
//!
//! Another signal to the supervisor goes to the last step at once, but for a last chance of the controller's. Every
//! signal goes to the whole process group of a stage, so that a program in its place takes its children with it.

use std::{
    os::unix::process::ExitStatusExt,
    time::{Duration, Instant},
};

use pipeline::stage::StageKind;
use rustix::process::Signal;

use super::{Supervisor, cause, member::Life};
use crate::failure::Failure;

/// The order in which stages are asked to end.
const ORDER: [StageKind; 4] =
    [StageKind::ControlProc, StageKind::IdentProc, StageKind::SensorProc, StageKind::PlantSim];
/// How long a stage may take to end before it is killed: two of its longest waits, many times over.
const GRACE: Duration = Duration::from_millis(600);
/// How long the controller has for its neutral command before those end who read it.
const NEUTRAL: Duration = Duration::from_millis(150);
/// What is left of that when somebody is in a hurry.
const LAST_CHANCE: Duration = Duration::from_millis(100);
/// How long a killed process may take to be gone.
const KILLED: Duration = Duration::from_secs(1);
/// How often signals are looked for meanwhile.
const POLL: Duration = Duration::from_millis(5);

impl Supervisor<'_> {
    /// Ends all stages; the first failure to end well, if any.
    pub fn stop(&mut self) -> Option<Failure> {
        if !self.is_stopping {
            self.is_stopping = true;
            self.notifier.stopping();
            // What has come so far is being obeyed.
            self.interrupts.any();
            self.members.iter_mut().for_each(|member| member.due = None);
            self.settle(Duration::ZERO);
            self.end_all();
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
        for member in self.members.iter_mut() {
            let Some(life) = &member.life else { continue };
            life.signal(Signal::KILL);
            let why =
                if in_hurry { "killed in a hurry".into() } else { format!("did not end within {GRACE:?}: killed") };
            self.log.say(format!("{}: {why}", member.kind.name()));
            member.sentence = Some(why);
        }
        self.await_end(KILLED, None, false);
        for member in self.members.iter().filter(|member| member.life.is_some()) {
            self.log.say(format!("{}: killed, and not gone within {KILLED:?}", member.kind.name()));
        }
    }

    fn ask(&self, kind: StageKind) {
        for life in self.members.iter().filter(|member| member.kind == kind).filter_map(|member| member.life.as_ref()) {
            life.signal(Signal::TERM);
            self.say(format!("{}: asked to end", kind.name()));
        }
    }

    /// Waits until `kind`, or all, have ended, for so long at most. True when a signal cut it short, where one may.
    fn await_end(&mut self, longest: Duration, kind: Option<StageKind>, may_hurry: bool) -> bool {
        let until = Instant::now() + longest;
        loop {
            let mut running = self.members.iter().filter(|member| member.life.is_some());
            if !running.any(|member| kind.is_none_or(|kind| member.kind == kind)) || Instant::now() >= until {
                return false;
            }
            if may_hurry && self.interrupts.again() {
                return true;
            }
            self.settle(POLL);
        }
    }

    /// Reaps what has ended, after waiting for the next death.
    fn settle(&mut self, wait: Duration) {
        for pid in self.deaths.wait(wait) {
            let mut members = self.members.iter_mut();
            let Some(member) = members.find(|member| member.life.as_ref().is_some_and(|life| life.pid() == pid)) else {
                continue;
            };
            let (kind, sentence) = (member.kind, member.sentence.take());
            let Some(Ok(status)) = member.life.take().map(Life::end) else { continue };
            // A program that does nothing about the signal has ended as it was asked to.
            if status.success() || status.signal() == Some(Signal::TERM.as_raw()) {
                self.say(format!("{}: ended", kind.name()));
                continue;
            }
            let what = format!("{} {}", kind.name(), sentence.unwrap_or_else(|| cause(status)));
            self.say(what.as_str());
            let lines = self.log.last_lines(kind);
            self.failure.get_or_insert_with(|| Failure::Run(what + &lines));
        }
    }
}
