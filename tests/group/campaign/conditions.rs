//! What else happens on the computer while a stop is asked for.

use std::{
    process::Child,
    time::{Duration, Instant},
};

use pipeline::{
    channel::Reader,
    message::{AxisMode, ValveCommand},
    stage::StageKind,
};
use rustix::process::Signal;

use super::watched::{NAMES, Watched};
use crate::harness::{
    Dice, is_running,
    place::{FullMemory, Hogs},
    signal,
};

/// Time between two kills of the same stage. The supervisor waits for longer and longer before it starts a stage again
/// that has not lived for 10 s, and gives up after six deaths within 30 s.
const BETWEEN_KILLS: Duration = Duration::from_secs(11);
/// Time between two kills of one stage, one of them with full memory, in which a stage that starts again ends several
/// times.
const BETWEEN_KILLS_WHEN_FULL: Duration = Duration::from_secs(31);
const KILLED: [StageKind; 3] = [StageKind::ControlProc, StageKind::SensorProc, StageKind::IdentProc];

/// Conditions that were drawn.
#[derive(Debug, Clone, Copy, Default)]
pub struct Conditions {
    is_loaded: bool,
    is_full: bool,
    has_hung_operator: bool,
    has_no_place: bool,
    killed: Option<StageKind>,
}

/// When each stage was killed for the last time, and whether that was with full memory.
#[derive(Default)]
pub struct Kills([Option<(Instant, bool)>; 4]);

impl Conditions {
    /// Draws some. Memory is filled up only in a place of its own.
    pub fn draw(dice: &mut Dice, kills: &mut Kills, is_private: bool) -> Self {
        let mut drawn = Self {
            is_loaded: dice.once_in(3),
            is_full: dice.once_in(4) && is_private,
            has_hung_operator: dice.once_in(6),
            has_no_place: dice.once_in(6),
            killed: dice.once_in(8).then(|| dice.one_of(&KILLED)),
        };
        if let Some(kind) = drawn.killed {
            let last = &mut kills.0[kind as usize];
            let is_too_soon = |(at, was_full): (Instant, bool)| {
                let pause = if was_full || drawn.is_full { BETWEEN_KILLS_WHEN_FULL } else { BETWEEN_KILLS };
                at.elapsed() < pause
            };
            if last.is_some_and(is_too_soon) {
                drawn.killed = None;
            } else {
                *last = Some((Instant::now(), drawn.is_full));
            }
        }
        drawn
    }

    /// Whether no controller runs in the moment of the stop, or hardly: its drive's time-out is what stops then.
    pub fn is_control_down(&self) -> bool {
        self.killed == Some(StageKind::ControlProc)
    }

    /// Whether a killed controller cannot start again before the conditions have ended.
    pub fn keep_control_down(&self) -> bool {
        self.is_control_down() && self.is_full
    }

    /// Names of all conditions.
    pub fn names(&self) -> Vec<String> {
        let named = [
            (self.is_loaded, "busy cores"),
            (self.is_full, "full memory"),
            (self.has_hung_operator, "hung operator"),
            (self.has_no_place, "no place for a reader"),
        ];
        let mut names: Vec<String> = named.iter().filter(|one| one.0).map(|one| one.1.to_owned()).collect();
        names.extend(self.killed.map(|kind| format!("{} killed", kind.name())));
        names
    }

    /// Begins them.
    pub fn begin(&self, watched: &mut Watched, dice: &mut Dice) -> Held {
        let operator = self.has_hung_operator.then(|| hang_operator(watched));
        let hogs = self.is_loaded.then(Hogs::start);
        let readers = if self.has_no_place {
            std::iter::from_fn(|| watched.channels.reader::<ValveCommand>().ok()).collect()
        } else {
            Vec::new()
        };
        let memory = self.is_full.then(FullMemory::take);
        watched.look_for(Duration::from_micros(dice.below(15_000)));
        if let Some(kind) = self.killed {
            let pid = watched.pid(kind);
            if is_running(pid) {
                signal(pid, Signal::KILL);
            }
            watched.look_for(Duration::from_micros(dice.below(400_000)));
        }
        Held { operator, _hogs: hogs, _readers: readers, _memory: memory, is_left_to_go_on: dice.once_in(2) }
    }
}

/// Conditions that last until they are dropped.
pub struct Held {
    operator: Option<Child>,
    _hogs: Option<Hogs>,
    _readers: Vec<Reader<ValveCommand>>,
    _memory: Option<FullMemory>,
    /// A hung operator goes on after the stop; otherwise it is killed.
    is_left_to_go_on: bool,
}

impl Held {
    /// Ends all conditions. What a hung operator does when it goes on is watched.
    pub fn end(mut self, watched: &mut Watched) {
        let operator = self.operator.take();
        let goes_on = self.is_left_to_go_on;
        drop(self);
        let Some(mut operator) = operator else { return };
        signal(operator.id(), if goes_on { Signal::CONT } else { Signal::KILL });
        watched.finish(&mut operator);
        watched.look_for(Duration::from_millis(30));
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        if let Some(operator) = &mut self.operator {
            let _ = operator.kill();
            let _ = operator.wait();
        }
    }
}

/// An operator that holds the armed axes and the only place on the channel of requests, and is stopped.
fn hang_operator(watched: &mut Watched) -> Child {
    let axes = watched.armed();
    let mut arguments = vec!["operate", "--mode", "hold"];
    axes.iter().for_each(|axis| arguments.extend(["--axis", NAMES[*axis]]));
    let mut operator = watched.client(&arguments);
    let is_held =
        watched.look_until(|watched| watched.are_in(&axes, AxisMode::Hold) || operator.try_wait().unwrap().is_some());
    if !is_held {
        watched.fail(&format!("the operator does not hold the axes {axes:?}"));
    }
    if operator.try_wait().unwrap().is_none() {
        signal(operator.id(), Signal::STOP);
    }
    operator
}
