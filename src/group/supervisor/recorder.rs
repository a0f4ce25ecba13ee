//! The process that records all channels while the run lasts.
//!
//! ```text
//! start --attached--> records --end of the run--> asked to end, 10 s | killed
//!   '--ends before--> nothing is recorded     '--dies--> starts again, within bounds
//! ```
//!
//! No stage waits for it, and nothing that happens to it ends the run. It is started before the stages, because a
//! reader that attaches to a channel makes the next message on it take longer.

use std::{
    fs,
    path::PathBuf,
    time::{Duration, Instant},
};

use humantime::format_duration;
use pipeline::channel::Group;
use rustix::process::{Pid, Signal};

use super::{
    deaths::Deaths,
    life::{Life, cause},
    log::{Log, Origin},
    restarts::RestartHistory,
};
use crate::{
    group::{launch::record_command, running::recording_mark},
    recording::store::{Place, free_name},
};

/// Longest wait for the recorder to attach before the first stage starts.
const ATTACHES: Duration = Duration::from_secs(1);
/// Time that the recorder has to end its file. It runs on cores that nobody else wants, and ten seconds may wait in it.
const ENDS: Duration = Duration::from_secs(10);
/// Time between two looks.
const POLL: Duration = Duration::from_millis(5);

/// The recorder of a run, over all its lives.
pub struct RecorderProcess {
    place: Place,
    /// The file that says where the recorder writes. It is there once the recorder has attached.
    mark: PathBuf,
    life: Option<Life>,
    /// When the next life begins.
    due: Option<Instant>,
    history: RestartHistory,
}

impl RecorderProcess {
    /// Starts a recorder, and waits a little until it has attached.
    pub fn start(place: Place, group: &Group, log: &Log, deaths: &Deaths) -> Self {
        let mark = recording_mark(group.prefix());
        let mut recorder = Self { place, mark, life: None, due: None, history: RestartHistory::default() };
        recorder.begin(group, log, deaths);
        let until = Instant::now() + ATTACHES;
        while recorder.life.is_some() && !recorder.mark.exists() && Instant::now() < until {
            for pid in deaths.wait(POLL) {
                recorder.take_death(pid, log);
            }
        }
        recorder
    }

    fn begin(&mut self, group: &Group, log: &Log, deaths: &Deaths) {
        let _ = fs::remove_file(&self.mark);
        let begun = record_command(&self.place, group.prefix())
            .map_err(|error| error.to_string())
            .and_then(|command| Life::begin(Origin::Recorder, command, log, deaths).map_err(|error| error.to_string()));
        match begun {
            Ok(life) => self.life = Some(life),
            Err(error) => log.say(format!("warning: nothing is recorded: the recorder cannot be started: {error}")),
        }
    }

    /// Takes in that a process has ended. False for another process.
    pub fn take_death(&mut self, pid: Pid, log: &Log) -> bool {
        let Some(life) = self.life.take_if(|life| life.pid() == pid) else { return false };
        let age = life.age();
        let cause = life.end().map_or_else(|error| error.to_string(), cause);
        // One that has not attached would fail again.
        let wait = self.mark.exists().then(|| self.history.died(Instant::now(), age)).flatten();
        self.due = wait.map(|wait| Instant::now() + wait);
        log.say(match wait {
            Some(wait) => format!("warning: recording: record {cause}; starts again in {} s", wait.as_secs_f64()),
            None => format!("warning: nothing is recorded any more: record {cause}"),
        });
        true
    }

    /// Begins the life that is due.
    pub fn start_again(&mut self, group: &Group, log: &Log, deaths: &Deaths) {
        if self.due.is_none_or(|due| due > Instant::now()) {
            return;
        }
        self.due = None;
        // The killed one still has its places on the channels.
        group.bury_the_dead();
        if let Place::File(path) = &mut self.place {
            *path = free_name(path);
        }
        self.begin(group, log, deaths);
    }

    /// Ends the recorder, which says where the recording is. `hurries`: whether somebody wants a faster end.
    pub fn end(&mut self, log: &Log, deaths: &Deaths, mut hurries: impl FnMut() -> bool) {
        self.due = None;
        let Some(life) = self.life.take() else { return };
        life.signal(Signal::TERM);
        let until = Instant::now() + ENDS;
        while !deaths.wait(POLL).contains(&life.pid()) {
            if Instant::now() > until || hurries() {
                life.signal(Signal::KILL);
                let (ends, file) = (format_duration(ENDS), fs::read_to_string(&self.mark).unwrap_or_default());
                log.say(format!("warning: recording: did not end within {ends}: killed; it has no end: {file}"));
                break;
            }
        }
        match life.end() {
            Ok(status) if status.success() => {}
            Ok(status) => log.say(format!("warning: recording: record {}", cause(status))),
            Err(error) => log.say(format!("warning: recording: {error}")),
        }
    }
}
