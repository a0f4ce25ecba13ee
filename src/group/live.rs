//! A running group as a person watches it: its figures now, and what has happened since.
//!
//! It reads the two channels that no stage reads, so it can attach to a group at any time. Heartbeats come ten times a
//! second, and with each of them a state of the axes.
//!
//! Runs in a process of its own, beside the loop.

use std::{
    collections::VecDeque,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

use pipeline::{
    channel::{ChannelError, Group, Member, Prefix, Reader, Room, is_joined, remove_leftovers, rooms},
    machine::Machine,
    message::{MachineState, Message, StageHealth, ValveCommand},
    stage::{Life, StageKind, monotonic_ns},
};
use serde::Serialize;

use super::{
    operator::OperatorError,
    running::{machine_of, meant},
};
use crate::{
    arguments::load_bare,
    report::{
        events::{Event, Events},
        status::{Collected, StatusReport},
    },
};

/// Heartbeats that a rate is computed over.
const BEATS: usize = 11;
/// Time between two looks at the members of the group, which are files.
const MEMBERS_APART: Duration = Duration::from_secs(2);
/// Time in which a group says which machine it runs, and time between two looks for that.
const YOUTH: Duration = Duration::from_secs(10);
const LOOK: Duration = Duration::from_millis(450);
/// Events that are kept.
const MOST_EVENTS: usize = 200;
/// Time between two looks for a group.
const SEARCH: Duration = Duration::from_millis(250);

/// An event, with the time at which it was seen.
#[derive(Debug, Serialize)]
pub struct Told {
    /// Number of the event, from 1 on.
    pub number: u64,
    /// ms since 1970.
    pub unix_ms: u64,
    /// What happened.
    #[serde(flatten)]
    pub event: Event,
}

/// A group that is being watched.
pub struct Live {
    group: Group,
    health: Reader<StageHealth>,
    states: Reader<MachineState>,
    beats: [VecDeque<StageHealth>; 4],
    life: Life,
    /// The machine of the group, or why it is not known.
    machine: Result<Machine, String>,
    events: Option<Events>,
    told: VecDeque<Told>,
    numbered: u64,
    members: (Vec<Member>, Vec<Room>),
    times: Times,
}

/// When something was done last.
struct Times {
    joined: Instant,
    asked: Instant,
    members: Option<Instant>,
}

/// Now, ms since 1970.
pub fn unix_ms() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_millis() as u64
}

/// Looks for a group that is to be joined.
///
/// Trap: a client that joins before the supervisor does keeps the supervisor from starting, since the group then looks
/// like one that runs. A name that is claimed, or whose files are just being removed, is no group yet. So a group
/// counts only when it has a member in two looks in a row.
pub struct Search {
    /// The group that is meant; none for the only one that runs.
    prefix: Option<Prefix>,
    /// What the last look found.
    seen: Option<Prefix>,
    looked: Option<Instant>,
}

impl Search {
    /// For this group, or the only one that runs.
    pub fn new(prefix: Option<Prefix>) -> Self {
        Self { prefix, seen: None, looked: None }
    }

    /// The group, or why there is none; nothing before the next look is due, and where it has to look once more.
    pub fn look(&mut self) -> Option<Result<Prefix, String>> {
        if self.looked.is_some_and(|looked| looked.elapsed() < SEARCH) {
            return None;
        }
        self.looked = Some(Instant::now());
        let found = meant(self.prefix.as_ref()).map_err(|error| error.to_string()).and_then(|prefix| {
            if is_joined(&prefix) { Ok(prefix) } else { Err(OperatorError::NoGroup(prefix).to_string()) }
        });
        let before = std::mem::replace(&mut self.seen, found.as_ref().ok().cloned());
        (found.is_err() || self.seen == before).then_some(found)
    }
}

impl Live {
    /// Joins a group that runs, under a name that tells the other members who this is.
    ///
    /// # Errors
    /// Its channels cannot be opened.
    pub fn join(prefix: &Prefix, name: &str) -> Result<Self, ChannelError> {
        let group = Group::join(prefix, name)?;
        let (health, states) = (group.reader()?, group.reader()?);
        let now = Instant::now();
        let mut live = Self {
            health,
            states,
            beats: Default::default(),
            life: Life::begin(),
            machine: Err(String::new()),
            events: None,
            told: VecDeque::new(),
            numbered: 0,
            members: (Vec::new(), Vec::new()),
            times: Times { joined: now, asked: now, members: None },
            group,
        };
        live.ask();
        Ok(live)
    }

    /// Leaves the group, and removes its files if it was the last member.
    pub fn leave(self) {
        let prefix = self.group.prefix().clone();
        drop(self);
        // The group lives on where another member is left.
        let _ = remove_leftovers(&prefix);
    }

    /// Name of the group.
    pub fn prefix(&self) -> &Prefix {
        self.group.prefix()
    }

    /// The machine of the group, or why it is not known.
    pub fn machine(&self) -> &Result<Machine, String> {
        &self.machine
    }

    /// A reader of one more channel.
    ///
    /// # Errors
    /// The channel cannot be opened.
    pub fn reader<M: Message>(&self) -> Result<Reader<M>, ChannelError> {
        Ok(self.group.reader()?)
    }

    /// The newest state of the axes.
    pub fn state(&self) -> Option<&MachineState> {
        self.states.last()
    }

    /// The newest events, and the number of all events so far.
    pub fn told(&self) -> (&VecDeque<Told>, u64) {
        (&self.told, self.numbered)
    }

    /// Whether the group has ended: all stages say so, or none says anything.
    pub fn is_over(&mut self) -> bool {
        self.life.is_over(&self.group)
    }

    /// Asks again which machine the group runs; true when the answer is known now and was not before. A group that has
    /// only just begun has not said it yet.
    pub fn learn(&mut self) -> bool {
        let is_due = self.times.joined.elapsed() < YOUTH && self.times.asked.elapsed() > LOOK;
        if self.machine.is_ok() || !is_due {
            return false;
        }
        self.ask();
        self.machine.is_ok()
    }

    fn ask(&mut self) {
        self.times.asked = Instant::now();
        let bare = machine_of(self.group.prefix(), &[]).map_err(|error| error.to_string());
        self.machine = bare.and_then(|bare| load_bare(&bare, None).map_err(|error| error.to_string()));
        self.events = self.machine.as_ref().ok().map(|machine| Events::new(machine, self.group.prefix()));
    }

    /// Reads what has come. The states that are new, in order.
    ///
    /// # Errors
    /// A channel cannot be read.
    pub fn step(&mut self) -> Result<Vec<MachineState>, ChannelError> {
        while let Some(health) = self.health.read()?.if_new().copied() {
            self.life.hear(&health);
            self.beat(&health);
        }
        let mut new = Vec::new();
        while let Some(state) = self.states.read()?.if_new().copied() {
            if let Some(events) = &mut self.events {
                events.command(&command_of(&state), None);
            }
            new.push(state);
        }
        for event in self.events.as_mut().map(Events::drain).unwrap_or_default() {
            self.numbered += 1;
            if self.told.len() >= MOST_EVENTS {
                self.told.pop_front();
            }
            self.told.push_back(Told { number: self.numbered, unix_ms: unix_ms(), event });
        }
        Ok(new)
    }

    fn beat(&mut self, health: &StageHealth) {
        let Some(beats) = self.beats.get_mut(health.stage as usize) else { return };
        let before = beats.back().copied();
        if let Some(events) = &mut self.events {
            events.health(health);
            if let Some(before) = before.filter(|before| before.pid != health.pid) {
                let name = StageKind::ALL[health.stage as usize].name();
                events.restart(format!("{name}: process {} took the place of process {}", health.pid, before.pid));
            }
        }
        // Figures of the process before, or from before a reset, give no rate with those of now.
        if before.is_some_and(|before| before.pid != health.pid || before.since_ns != health.since_ns) {
            beats.clear();
        }
        if beats.len() >= BEATS {
            beats.pop_front();
        }
        beats.push_back(*health);
    }

    /// The figures now.
    pub fn report(&mut self) -> StatusReport {
        if self.times.members.is_none_or(|looked| looked.elapsed() > MEMBERS_APART) {
            self.times.members = Some(Instant::now());
            let own = std::process::id();
            let members = self.group.members().into_iter().filter(|member| member.pid != own).collect();
            self.members = (members, rooms(self.group.prefix()));
        }
        StatusReport::new(&Collected {
            prefix: self.group.prefix().clone(),
            stages: std::array::from_fn(|i| Some((*self.beats[i].front()?, *self.beats[i].back()?))),
            state: self.states.last().copied(),
            members: self.members.0.clone(),
            rooms: self.members.1.clone(),
            now_ns: monotonic_ns(),
        })
    }
}

/// The commands in a state of the machine.
fn command_of(state: &MachineState) -> ValveCommand {
    let mut command = ValveCommand { header: state.header, teeth: state.teeth, ..ValveCommand::default() };
    for (to, from) in command.axes.iter_mut().zip(&state.axes) {
        *to = from.command;
    }
    command
}
