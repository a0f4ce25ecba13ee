//! What the supervisor does about its stages while a run lasts: it reaps processes that have ended, kills stages
//! without a heartbeat, feeds the watchdog of the service manager, says when there is no room left, and starts stages
//! again.

use std::time::{Duration, Instant};

use humantime::format_duration;
use pipeline::{
    MAX_AXES,
    machine::Restart,
    stage::{Clock, StageKind, StageOptions, monotonic_ns},
};
use rustix::process::{Pid, Signal};

use super::{
    FOREIGN_START, SupervisedStage, Supervisor, SupervisorError,
    life::cause,
    restarts::{MOST_RESTARTS, WINDOW, next_tick},
};
use crate::group::monitor::Monitor;

/// Longest time between two looks at the group. The end of a process is seen at once.
const POLL: Duration = Duration::from_millis(10);
/// Time that the controller has to disarm the axes before this process is suspended.
const SUSPEND_PATIENCE: Duration = Duration::from_millis(200);
/// Time in which a stage must open its channels.
const START_PATIENCE: Duration = Duration::from_secs(10);
/// A heartbeat older than this is not fresh: ten of them are missing.
const FRESH: Duration = Duration::from_secs(1);
/// A stage whose heartbeat is older than this hangs and is killed.
const HUNG: Duration = Duration::from_secs(2);
/// Both bounds on heartbeats are at least this many periods, because a stage sends at most one heartbeat per tick.
const PERIODS: u32 = 3;

impl Supervisor<'_> {
    /// Waits a little, reads the messages of the group, and does what follows from them.
    ///
    /// # Errors
    /// A stage has ended and must not be started again; the error names the first cause.
    pub fn step(&mut self, monitor: &mut Monitor) -> Result<(), SupervisorError> {
        let deaths = self.deaths.wait(POLL);
        self.suspend();
        monitor.poll()?;
        for pid in deaths {
            if !self.take_recorder_death(pid) {
                self.take_death(pid, monitor)?;
            }
        }
        self.watch_faults(monitor, false);
        // A reader in lock-step does not see every command.
        for line in monitor.events().lines().into_iter().filter(|_| self.launch.options.clock == Clock::RealTime) {
            self.say(line);
        }
        if monitor.was_taken_over() {
            self.say("a program has taken over the operation of the group from another one");
        }
        self.judge_heartbeats(monitor);
        if self.stages.iter().all(|stage| self.is_attended(stage, monitor)) {
            self.service_manager.alive();
        }
        for line in self.room.look() {
            self.say(line);
        }
        let (health, last) = monitor.readings();
        if let Some(line) = self.source.as_mut().and_then(|source| source.look(Instant::now(), &health, last)) {
            self.say(line);
            // A program that was killed still holds its place, which it needs when it is started again.
            self.group.bury_the_dead();
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.start_again(self.group, &self.log, &self.deaths);
        }
        self.start_again(monitor)
    }

    /// Takes in the end of the recorder. False for another process.
    fn take_recorder_death(&mut self, pid: Pid) -> bool {
        self.recorder.as_mut().is_some_and(|recorder| recorder.take_death(pid, &self.log))
    }

    /// At Ctrl-Z: axes must not go on while nobody watches their stages.
    fn suspend(&mut self) {
        let (board, log) = (&self.board, &self.log);
        self.interrupts.suspend(|| {
            let ticket = board.stop(0..MAX_AXES);
            // The shell writes to the terminal until the process goes on.
            log.show(Vec::new());
            log.say("suspended: all axes are disarmed; `hydraxis arm` arms them after `fg`");
            let until = Instant::now() + SUSPEND_PATIENCE;
            while !board.is_done(&ticket) && Instant::now() < until {
                std::thread::sleep(Duration::from_millis(1));
            }
        });
    }

    /// Reaps a process that has ended. Its stage is done, or starts again, or the run ends.
    fn take_death(&mut self, pid: Pid, monitor: &mut Monitor) -> Result<(), SupervisorError> {
        let has_died = |stage: &SupervisedStage| stage.life.as_ref().is_some_and(|life| life.pid() == pid);
        let Some(index) = self.stages.iter().position(has_died) else { return Ok(()) };
        let Some(life) = self.stages[index].life.take() else { return Ok(()) };
        let (kind, age, killed_for) = (self.stages[index].kind, life.age(), self.stages[index].killed_for.take());
        let status = life.end().map_err(|source| SupervisorError::Status { stage: kind.name(), source })?;
        // The process may have sent messages after the last poll.
        monitor.poll()?;
        let was_ready = monitor.is_ready(kind) || (self.is_foreign(kind) && age > FOREIGN_START);
        monitor.forget(kind);
        let (is_over, is_asked) = (self.is_over(monitor), self.interrupts.any());
        // A service manager may ask all processes of the group to end, not only the supervisor.
        if status.success() && (is_over || is_asked) {
            self.stages[index].is_done = true;
            return Ok(());
        }
        let cause = killed_for.unwrap_or_else(|| cause(status));
        if let Some(black_box) = &mut self.black_box {
            black_box.note(format!("{} {cause}", kind.name()));
        }
        let has_lived = was_ready || !self.stages[index].causes.is_empty();
        monitor.events().restart(format!("{} {cause}", kind.name()));
        if has_lived && !is_over && self.may_restart(kind) {
            return self.plan_restart(index, cause, age);
        }
        Err(self.end_of_run(kind, &cause))
    }

    /// Whether the machine file and the clock allow a stage to start again.
    fn may_restart(&self, kind: StageKind) -> bool {
        self.launch.options.clock == Clock::RealTime && self.launch.machine.stage(kind).restart == Restart::OnFailure
    }

    /// Sets the time of the next life of a stage whose process ended for `cause` after `age`.
    fn plan_restart(&mut self, index: usize, cause: String, age: Duration) -> Result<(), SupervisorError> {
        let now = Instant::now();
        let stage = &mut self.stages[index];
        let name = stage.kind.name();
        let Some(wait) = stage.history.died(now, age) else {
            let first = stage.causes.first().unwrap_or(&cause);
            let (times, window) = (MOST_RESTARTS + 1, format_duration(WINDOW));
            let what = format!("{name} {first}, first of {times} times within {window}");
            return Err(SupervisorError::Ended { what, last_lines: self.log.last_lines(stage.kind) });
        };
        self.log.say(format!("{name} {cause}; starts again in {} s", wait.as_secs_f64()));
        stage.causes.push(cause);
        stage.due = Some(now + wait);
        Ok(())
    }

    /// The reason for the end of the run: the first death after which no new process has started yet, then the last
    /// one.
    fn end_of_run(&self, kind: StageKind, cause: &str) -> SupervisorError {
        let before = self.stages.iter().filter(|stage| stage.due.is_some());
        let first = before.min_by_key(|stage| stage.due).and_then(|stage| {
            let cause = stage.causes.last()?;
            Some(format!("{} {cause}; then ", stage.kind.name()))
        });
        let what = format!("{}{} {cause}", first.unwrap_or_default(), kind.name());
        SupervisorError::Ended { what, last_lines: self.log.last_lines(kind) }
    }

    /// Whether the last sample of the run is out. After it the stages end by themselves.
    fn is_over(&self, monitor: &Monitor) -> bool {
        let ticks = self.launch.options.ticks;
        ticks.is_some_and(|ticks| monitor.last_sample().is_some_and(|(sequence, _)| sequence + 1 >= ticks))
    }

    /// Kills stages that have sent no heartbeat for too long.
    fn judge_heartbeats(&mut self, monitor: &Monitor) {
        let hung = self.bound(HUNG);
        for i in 0..self.stages.len() {
            let stage = &self.stages[i];
            let Some(life) = stage.life.as_ref().filter(|_| stage.killed_for.is_none()) else { continue };
            let reason = match monitor.heartbeat_age(stage.kind) {
                // In lock-step a stage may wait for another without a bound; `run` judges a group in which no stage
                // works.
                Some(age) if age > hung && self.launch.options.clock == Clock::RealTime => {
                    format!("killed: no heartbeat for {}", format_duration(hung))
                }
                None if life.age() > START_PATIENCE && !self.is_foreign(stage.kind) => {
                    format!("killed: no heartbeat within {} of its start", format_duration(START_PATIENCE))
                }
                _ => continue,
            };
            life.signal(Signal::KILL);
            self.stages[i].killed_for = Some(reason);
        }
    }

    fn bound(&self, bound: Duration) -> Duration {
        bound.max(self.launch.machine.timing.period * PERIODS)
    }

    /// Whether the heartbeat of a stage is fresh, or the stage is starting within its bounds, or it is done.
    fn is_attended(&self, stage: &SupervisedStage, monitor: &Monitor) -> bool {
        let age = monitor.heartbeat_age(stage.kind);
        stage.life.is_none() || age.is_none_or(|age| age < self.bound(FRESH))
    }

    /// Begins the lives that are due.
    fn start_again(&mut self, monitor: &Monitor) -> Result<(), SupervisorError> {
        let now = Instant::now();
        for i in 0..self.stages.len() {
            if self.stages[i].due.is_none_or(|due| due > now) {
                continue;
            }
            let kind = self.stages[i].kind;
            self.stages[i].due = None;
            if self.is_over(monitor) {
                self.stages[i].is_done = true;
                continue;
            }
            // The dead process still has its place on the channels, and some channels have only one.
            self.group.bury_the_dead();
            let options = self.restart_options(monitor);
            self.stages[i].life = Some(self.begin(kind, &options)?);
            self.say(restart_message(kind, &options));
        }
        Ok(())
    }

    /// How a stage starts again: disarmed, and at the tick that is due next.
    fn restart_options(&self, monitor: &Monitor) -> StageOptions {
        let options = self.launch.options;
        let last = monitor.last_sample();
        let since = last.map_or(0, |(_, acquired_ns)| monotonic_ns().saturating_sub(acquired_ns));
        let period = self.launch.machine.timing.period;
        let next = next_tick(last.map(|(sequence, _)| sequence), Duration::from_nanos(since), period);
        let last_tick = options.ticks.map_or(u64::MAX, |ticks| ticks.saturating_sub(1));
        StageOptions { arm: false, first_tick: next.min(last_tick), ..options.clone() }
    }
}

fn restart_message(kind: StageKind, options: &StageOptions) -> String {
    match kind {
        StageKind::ControlProc => format!(
            "control-proc: started again, disarmed; when the machine may move, type: hydraxis arm --prefix {}",
            options.prefix
        ),
        StageKind::SensorProc => format!("sensor-proc: started again, at tick {}", options.first_tick),
        StageKind::PlantSim | StageKind::IdentProc => format!("{}: started again", kind.name()),
    }
}
