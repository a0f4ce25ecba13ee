//! The process group: starts the stages, watches them, starts them again, ends them, and names the first cause when one
//! fails.
//!
//! ```text
//! start --heartbeat--> up --death, no heartbeat--> waiting --start again, within bounds--> start
//!                                    '--lock-step, restart = "never", too many--> the run ends
//! ```
//!
//! Every stage gets a process group of its own, so that Ctrl-C on the terminal reaches the supervisor alone, which then
//! ends them in order: the controller first, so that the valves are neutral.
//!
//! Trap: a controller that is started again begins disarmed, whatever the run was started with. Nobody may be moved by
//! a program that came back by itself.

mod deaths;
mod interrupts;
mod log;
mod member;
mod notify;
mod policy;
mod stop;

use std::{
    path::Path,
    time::{Duration, Instant, SystemTime},
};

use pipeline::{
    channel::Group,
    machine::{Machine, Restart},
    stage::{Clock, StageKind, StageOptions, monotonic_ns},
};
use rustix::process::{Pid, Signal};

use super::{launch::command, monitor::Monitor};
use crate::{arguments::MachineFile, failure::Failure};
use deaths::Deaths;
use interrupts::Interrupts;
use log::Log;
use member::{Life, cause};
use notify::Notifier;
use policy::History;

/// How often the group is looked at; a death is seen at once.
const POLL: Duration = Duration::from_millis(10);
/// How long a stage may take to open its channels.
const START_PATIENCE: Duration = Duration::from_secs(10);
/// The same for another program in its place, which may have no heartbeat at all.
const FOREIGN_START: Duration = Duration::from_secs(1);
/// A heartbeat older than this is not fresh: ten of them are missing.
const FRESH: Duration = Duration::from_secs(1);
/// A stage whose heartbeat is older than this hangs, and is killed.
const HUNG: Duration = Duration::from_secs(2);
/// Periods that both bounds are at the least: a stage with a timer beats once per tick at the most.
const PERIODS: u32 = 3;

/// What all stages are started with.
pub struct Launch<'a> {
    /// The machine.
    pub machine: &'a Machine,
    /// Where it comes from.
    pub arguments: &'a MachineFile,
    /// How the stages run.
    pub options: &'a StageOptions,
}

/// One stage of the group, over all its lives.
struct Member {
    kind: StageKind,
    life: Option<Life>,
    /// When the next life begins, between two.
    due: Option<Instant>,
    /// What this process has ended it for.
    sentence: Option<String>,
    history: History,
    /// What ended each life that was followed by another.
    causes: Vec<String>,
    /// Whether it has come to its end as it should.
    is_done: bool,
}

/// The running stages. Dropping it ends them.
pub struct Supervisor<'a> {
    launch: Launch<'a>,
    group: &'a Group,
    members: Vec<Member>,
    deaths: Deaths,
    interrupts: Interrupts,
    notifier: Notifier,
    is_stopping: bool,
    /// First thing that went wrong while the stages were being ended.
    failure: Option<Failure>,
    log: Log,
}

impl<'a> Supervisor<'a> {
    /// Of a group that nobody works in yet.
    ///
    /// # Errors
    /// The log's file cannot be created, or signals not be taken.
    pub fn new(launch: Launch<'a>, group: &'a Group, log_folder: Option<&Path>) -> Result<Self, Failure> {
        let file = log_folder.map(|folder| log::file_name(folder, group.prefix(), SystemTime::now()));
        let supervisor = Self {
            launch,
            group,
            members: Vec::new(),
            deaths: Deaths::new().map_err(Failure::run)?,
            interrupts: Interrupts::new()?,
            notifier: Notifier::new(),
            is_stopping: false,
            failure: None,
            log: Log::start(file.as_deref())?,
        };
        if let Some(file) = file {
            supervisor.say(format!("log: {}", file.display()));
        }
        Ok(supervisor)
    }

    /// A line of the supervisor's own, in order with those of the stages.
    pub fn say(&self, text: impl Into<String>) {
        self.log.say(text);
    }

    /// The line of this second: to the service manager, and to a terminal.
    pub fn report(&self, line: &str, show: bool) {
        self.notifier.status(line);
        if show {
            self.say(line);
        }
    }

    /// Starts a stage for the first time.
    ///
    /// # Errors
    /// The program cannot be started.
    pub fn start(&mut self, kind: StageKind) -> Result<(), Failure> {
        let life = self.begin(kind, self.launch.options)?;
        self.members.push(Member {
            kind,
            life: Some(life),
            due: None,
            sentence: None,
            history: History::default(),
            causes: Vec::new(),
            is_done: false,
        });
        Ok(())
    }

    fn begin(&self, kind: StageKind, options: &StageOptions) -> Result<Life, Failure> {
        let command = command(kind, self.launch.machine, self.launch.arguments, options)?;
        let program = command.get_program().to_string_lossy().into_owned();
        Life::begin(kind, command, &self.log, &self.deaths)
            .map_err(|error| Failure::Run(format!("{}: \"{program}\" cannot be started: {error}", kind.name())))
    }

    /// Waits a little, reads what the group says, and does what is to be done about it.
    ///
    /// # Errors
    /// A stage has ended that is not to be started again, with the first cause.
    pub fn step(&mut self, monitor: &mut Monitor) -> Result<(), Failure> {
        let deaths = self.deaths.wait(POLL);
        monitor.poll().map_err(Failure::run)?;
        for pid in deaths {
            self.take_death(pid, monitor)?;
        }
        self.judge_heartbeats(monitor);
        if self.members.iter().all(|member| self.is_attended(member, monitor)) {
            self.notifier.alive();
        }
        self.start_again(monitor)
    }

    /// Tells the service manager, the first time that this is so, that all stages are ready.
    pub fn announce(&mut self, monitor: &Monitor) {
        let ready = |member: &Member| member.is_done || self.is_ready(member.kind, monitor);
        if self.members.iter().all(ready) {
            self.notifier.ready();
        }
    }

    /// Whether a stage has opened its channels, or is a program that may not say so and has had its time.
    pub fn is_ready(&self, kind: StageKind, monitor: &Monitor) -> bool {
        let age = self.member(kind).and_then(|member| member.life.as_ref()).map(Life::age);
        monitor.is_ready(kind) || (self.is_foreign(kind) && age.is_some_and(|age| age > FOREIGN_START))
    }

    /// Whether somebody has asked for the end.
    pub fn is_interrupted(&mut self) -> bool {
        self.interrupts.any()
    }

    /// Whether a stage has come to its end as it should.
    pub fn is_done(&self, kind: StageKind) -> bool {
        self.member(kind).is_some_and(|member| member.is_done)
    }

    /// Whether all stages have.
    pub fn all_done(&self) -> bool {
        self.members.iter().all(|member| member.is_done)
    }

    /// Whether every stage that is not done runs: none waits for its next life or is just beginning it.
    pub fn all_up(&self, monitor: &Monitor) -> bool {
        self.members.iter().all(|member| member.is_done || self.is_ready(member.kind, monitor))
    }

    /// What ended the lives that were followed by another, by stage.
    pub fn restart_causes(&self) -> [Vec<String>; 4] {
        StageKind::ALL.map(|kind| self.member(kind).map(|member| member.causes.clone()).unwrap_or_default())
    }

    fn member(&self, kind: StageKind) -> Option<&Member> {
        self.members.iter().find(|member| member.kind == kind)
    }

    fn is_foreign(&self, kind: StageKind) -> bool {
        self.launch.machine.stage(kind).command.is_some()
    }

    /// Whether the last sample of the run is out, after which stages end by themselves.
    fn is_over(&self, monitor: &Monitor) -> bool {
        let ticks = self.launch.options.ticks;
        ticks.is_some_and(|ticks| monitor.last_sample().is_some_and(|(sequence, _)| sequence + 1 >= ticks))
    }

    /// A process has ended: well, to be followed by another life, or for a reason that ends the run.
    fn take_death(&mut self, pid: Pid, monitor: &mut Monitor) -> Result<(), Failure> {
        let is_it = |member: &&mut Member| member.life.as_ref().is_some_and(|life| life.pid() == pid);
        let Some(member) = self.members.iter_mut().find(is_it) else { return Ok(()) };
        let Some(life) = member.life.take() else { return Ok(()) };
        let (kind, age, sentence) = (member.kind, life.age(), member.sentence.take());
        let status = life.end().map_err(Failure::run)?;
        // What it has sent before it died.
        monitor.poll().map_err(Failure::run)?;
        let was_ready = monitor.is_ready(kind) || (self.is_foreign(kind) && age > FOREIGN_START);
        monitor.forget(kind);
        let (is_over, is_asked) = (self.is_over(monitor), self.interrupts.any());
        let has_lived = was_ready || self.member(kind).is_some_and(|member| !member.causes.is_empty());
        let may_restart = self.launch.options.clock == Clock::RealTime
            && self.launch.machine.stage(kind).restart == Restart::OnFailure
            && has_lived
            && !is_over;
        let cause = sentence.unwrap_or_else(|| cause(status));
        let Some(member) = self.members.iter_mut().find(|member| member.kind == kind) else { return Ok(()) };
        // A service manager may ask all processes at once.
        if status.success() && (is_over || is_asked) {
            member.is_done = true;
            return Ok(());
        }
        let what = format!("{} {cause}", kind.name());
        if !may_restart {
            return Err(self.end_of_run(kind, &what));
        }
        let now = Instant::now();
        let Some(wait) = member.history.died(now, age) else {
            let first = member.causes.first().unwrap_or(&cause);
            let limit = format!(
                "{} {first}, first of {} times within {:?}",
                kind.name(),
                policy::MOST_RESTARTS + 1,
                policy::WINDOW
            );
            return Err(Failure::Run(limit + &self.log.last_lines(kind)));
        };
        member.causes.push(cause);
        member.due = Some(now + wait);
        self.say(format!("{what}; starts again in {} s", wait.as_secs_f64()));
        Ok(())
    }

    /// Why the run ends: the first death that has not been made good, and the last one.
    fn end_of_run(&self, kind: StageKind, what: &str) -> Failure {
        let before = self.members.iter().filter(|member| member.due.is_some());
        let first = before.min_by_key(|member| member.due).and_then(|member| {
            let cause = member.causes.last()?;
            Some(format!("{} {cause}; then ", member.kind.name()))
        });
        Failure::Run(first.unwrap_or_default() + what + &self.log.last_lines(kind))
    }

    /// Kills what has not said for too long that it lives.
    fn judge_heartbeats(&mut self, monitor: &Monitor) {
        let hung = self.bound(HUNG);
        for i in 0..self.members.len() {
            let member = &self.members[i];
            let Some(life) = member.life.as_ref().filter(|_| member.sentence.is_none()) else { continue };
            let sentence = match monitor.heartbeat_age(member.kind) {
                // In lock-step a stage may wait for another as long as it takes: nobody works, which is another rule.
                Some(age) if age > hung && self.launch.options.clock == Clock::RealTime => {
                    format!("killed: no heartbeat for {hung:?}")
                }
                None if life.age() > START_PATIENCE && !self.is_foreign(member.kind) => {
                    format!("killed: no heartbeat within {START_PATIENCE:?} of its start")
                }
                _ => continue,
            };
            life.signal(Signal::KILL);
            self.members[i].sentence = Some(sentence);
        }
    }

    fn bound(&self, bound: Duration) -> Duration {
        bound.max(self.launch.machine.timing.period * PERIODS)
    }

    /// Whether a stage says that it lives, or is being started within bounds, or is done.
    fn is_attended(&self, member: &Member, monitor: &Monitor) -> bool {
        let age = monitor.heartbeat_age(member.kind);
        member.life.is_none() || age.is_none_or(|age| age < self.bound(FRESH))
    }

    /// Begins the next lives that are due.
    fn start_again(&mut self, monitor: &Monitor) -> Result<(), Failure> {
        let now = Instant::now();
        for i in 0..self.members.len() {
            if self.members[i].due.is_none_or(|due| due > now) {
                continue;
            }
            let kind = self.members[i].kind;
            self.members[i].due = None;
            if self.is_over(monitor) {
                self.members[i].is_done = true;
                continue;
            }
            // The dead one still has its place on the channels, of which some have one only.
            self.group.bury_the_dead();
            let last = monitor.last_sample();
            let since = last.map_or(0, |(_, acquired_ns)| monotonic_ns().saturating_sub(acquired_ns));
            let period = self.launch.machine.timing.period;
            let next = policy::next_tick(last.map(|(sequence, _)| sequence), Duration::from_nanos(since), period);
            let last_tick = self.launch.options.ticks.map_or(u64::MAX, |ticks| ticks.saturating_sub(1));
            let options = StageOptions { arm: false, first_tick: next.min(last_tick), ..self.launch.options.clone() };
            self.members[i].life = Some(self.begin(kind, &options)?);
            let prefix = &options.prefix;
            self.say(match kind {
                StageKind::ControlProc => format!(
                    "control-proc: started again, disarmed; when the machine may move, type: hydraxis arm --prefix \
                     {prefix}"
                ),
                StageKind::SensorProc => format!("sensor-proc: started again, at tick {}", options.first_tick),
                StageKind::PlantSim | StageKind::IdentProc => format!("{}: started again", kind.name()),
            });
        }
        Ok(())
    }
}

impl Drop for Supervisor<'_> {
    fn drop(&mut self) {
        self.stop();
    }
}
