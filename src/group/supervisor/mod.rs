//! The supervisor of a group: starts the stages, watches them, starts them again, ends them, and names the first cause
//! when one of them fails.
//!
//! ```text
//! start --heartbeat--> up --end, no heartbeat--> waiting --start again, within bounds--> start
//!                                    '--lock-step, restart = "never", too many--> the run ends
//! ```
//!
//! Every stage gets a process group of its own. So Ctrl-C on the terminal reaches the supervisor alone, which then ends
//! the stages in order: the controller first, so that the valves are neutral.
//!
//! Trap: a controller that is started again begins disarmed, whatever the run was started with. A program that came
//! back by itself must not move a person.
//!
//! Runs in a process of its own, beside the loop; no stage ever waits for it.

mod deaths;
mod error;
mod interrupts;
mod life;
mod log;
mod recorder;
mod restarts;
mod room;
mod service_manager;
mod source;
mod stop;
mod watch;

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant, SystemTime},
};

use pipeline::{
    channel::{Board, Group},
    machine::Machine,
    stage::{StageKind, StageOptions},
};

use super::{
    launch::command,
    monitor::{Monitor, Second},
};
use crate::{
    arguments::MachineFile,
    recording::{
        black_box::{BlackBox, write_left},
        store::Place,
    },
};
use deaths::Deaths;
pub use error::SupervisorError;
use interrupts::Interrupts;
use life::Life;
use log::{Log, Origin};
use recorder::RecorderProcess;
use restarts::RestartHistory;
use room::RoomWatch;
use service_manager::ServiceManager;
use source::SourceWatch;

/// Time after which a foreign program in a stage's place counts as started. It may have no heartbeat at all.
const FOREIGN_START: Duration = Duration::from_secs(1);

/// What all stages are started with.
#[derive(Clone, Copy)]
pub struct Launch<'a> {
    /// The machine.
    pub machine: &'a Machine,
    /// The machine file and the values that replace those of the file.
    pub arguments: &'a MachineFile,
    /// How the stages run.
    pub options: &'a StageOptions,
    /// The devices of the start, where they are on a CAN bus: a stage that starts again must mean the same.
    pub wiring: Option<u64>,
}

/// One stage of the group, over all its lives.
struct SupervisedStage {
    kind: StageKind,
    /// Its process; none between two lives and after the last.
    life: Option<Life>,
    /// When the next life begins; none while a process runs.
    due: Option<Instant>,
    /// Why the supervisor killed the process, if it did.
    killed_for: Option<String>,
    history: RestartHistory,
    /// Why each life ended that was followed by another.
    causes: Vec<String>,
    /// Whether the stage has ended as it should.
    is_done: bool,
}

impl SupervisedStage {
    fn new(kind: StageKind, life: Life) -> Self {
        Self {
            kind,
            life: Some(life),
            due: None,
            killed_for: None,
            history: RestartHistory::default(),
            causes: Vec::new(),
            is_done: false,
        }
    }
}

/// The running stages. Dropping the supervisor ends them.
pub struct Supervisor<'a> {
    launch: Launch<'a>,
    group: &'a Group,
    board: Board,
    stages: Vec<SupervisedStage>,
    deaths: Deaths,
    interrupts: Interrupts,
    service_manager: ServiceManager,
    room: RoomWatch,
    source: Option<SourceWatch>,
    is_stopping: bool,
    /// The first failure while the stages were being ended.
    failure: Option<SupervisorError>,
    log: Log,
    black_box: Option<BlackBox>,
    recorder: Option<RecorderProcess>,
}

impl<'a> Supervisor<'a> {
    /// The supervisor of a group without stages yet.
    ///
    /// # Errors
    /// The group runs another machine, the file of the log cannot be created, or signals cannot be handled.
    pub fn new(launch: Launch<'a>, group: &'a Group, log_folder: Option<&Path>) -> Result<Self, SupervisorError> {
        let board = Board::of(group.prefix(), launch.machine)?;
        let source = SourceWatch::new(launch.machine, group.prefix());
        let file = log_folder.map(|folder| log::file_name(folder, group.prefix(), SystemTime::now()));
        let supervisor = Self {
            launch,
            group,
            board,
            stages: Vec::new(),
            deaths: Deaths::new().map_err(SupervisorError::Watch)?,
            interrupts: Interrupts::new()?,
            service_manager: ServiceManager::new(),
            room: RoomWatch::new(group.prefix()),
            source,
            is_stopping: false,
            failure: None,
            log: Log::start(file.as_deref())?,
            black_box: None,
            recorder: None,
        };
        if let Some(file) = file {
            supervisor.say(format!("log: {}", file.display()));
        }
        Ok(supervisor)
    }

    /// Keeps the last messages for a black box in `folder`. Writes first what a supervisor of this group has kept that
    /// was killed.
    pub fn keep_black_box(&mut self, folder: PathBuf, monitor: &mut Monitor) {
        write_left(Some(self.group.prefix())).into_iter().for_each(|line| self.say(line));
        let machine = self.launch.machine;
        let is_unusable = |error| format!("{}: {error}; --black-box FOLDER names another folder", folder.display());
        let made = BlackBox::new(folder.clone(), self.group.prefix(), machine).map_err(is_unusable);
        let kept = made.and_then(|mut black_box| {
            let kept = black_box.keep(machine.timing.period, monitor.tapes());
            kept.map(|()| black_box)
        });
        match kept {
            Ok(black_box) => self.black_box = Some(black_box),
            Err(error) => self.say(format!("warning: no black box: {error}")),
        }
    }

    /// Logs a line of the supervisor's own, in order with those of the stages.
    pub fn say(&self, text: impl Into<String>) {
        self.log.say(text);
    }

    /// Sends the line of this second to the service manager, and its lines to the terminal, if there is one.
    pub fn report(&self, second: Second) {
        self.service_manager.status(&second.line);
        self.log.show(second.lines);
    }

    /// Starts the process that records the run. Nothing that happens to it ends the run.
    pub fn record(&mut self, place: Place) {
        self.recorder = Some(RecorderProcess::start(place, self.group, &self.log, &self.deaths));
    }

    /// Starts a stage for the first time.
    ///
    /// # Errors
    /// The program cannot be started.
    pub fn start(&mut self, kind: StageKind) -> Result<(), SupervisorError> {
        let life = self.begin(kind, self.launch.options)?;
        self.stages.push(SupervisedStage::new(kind, life));
        Ok(())
    }

    fn begin(&self, kind: StageKind, options: &StageOptions) -> Result<Life, SupervisorError> {
        let command = command(kind, self.launch.machine, self.launch.arguments, options, self.launch.wiring)?;
        let program = command.get_program().to_string_lossy().into_owned();
        Life::begin(Origin::Stage(kind), command, &self.log, &self.deaths).map_err(|source| SupervisorError::Start {
            stage: kind.name(),
            program,
            source,
        })
    }

    /// Looks for faults in the last command, and writes the black box when it is due, or when the run `ends`.
    pub fn watch_faults(&mut self, monitor: &mut Monitor, ends: bool) {
        let Some(black_box) = &mut self.black_box else { return };
        monitor.last_command().into_iter().for_each(|command| black_box.look(command));
        // The writer may be at work on an older fault when the run ends.
        for _ in 0..if ends { 2 } else { 1 } {
            if let Some(said) = black_box.step(monitor.tapes(), ends) {
                self.log.say(said);
            }
        }
    }

    /// Tells the service manager, once, that all stages are ready.
    pub fn announce(&mut self, monitor: &Monitor) {
        if self.all_up(monitor) {
            self.service_manager.ready();
        }
    }

    /// Whether a stage has opened its channels. A foreign program without heartbeats is ready after a while.
    pub fn is_ready(&self, kind: StageKind, monitor: &Monitor) -> bool {
        let age = self.stage(kind).and_then(|stage| stage.life.as_ref()).map(Life::age);
        monitor.is_ready(kind) || (self.is_foreign(kind) && age.is_some_and(|age| age > FOREIGN_START))
    }

    /// Whether a signal has asked for the end.
    pub fn is_interrupted(&mut self) -> bool {
        self.interrupts.any()
    }

    /// Whether a stage has ended as it should.
    pub fn is_done(&self, kind: StageKind) -> bool {
        self.stage(kind).is_some_and(|stage| stage.is_done)
    }

    /// Whether all stages have ended as they should.
    pub fn all_done(&self) -> bool {
        self.stages.iter().all(|stage| stage.is_done)
    }

    /// Whether every stage that is not done is ready: none waits for its next life or is just starting.
    pub fn all_up(&self, monitor: &Monitor) -> bool {
        self.stages.iter().all(|stage| stage.is_done || self.is_ready(stage.kind, monitor))
    }

    /// Why the lives ended that were followed by another, by stage.
    pub fn restart_causes(&self) -> [Vec<String>; 4] {
        StageKind::ALL.map(|kind| self.stage(kind).map(|stage| stage.causes.clone()).unwrap_or_default())
    }

    fn stage(&self, kind: StageKind) -> Option<&SupervisedStage> {
        self.stages.iter().find(|stage| stage.kind == kind)
    }

    /// Whether another program stands in the place of a stage.
    fn is_foreign(&self, kind: StageKind) -> bool {
        self.launch.machine.stage(kind).command.is_some()
    }
}

impl Drop for Supervisor<'_> {
    fn drop(&mut self) {
        self.stop();
    }
}
