//! The messages of one group, as frames.

use std::{
    collections::VecDeque,
    time::{Duration, Instant},
};

use pipeline::{
    channel::{ChannelError, Group, Member, Prefix, Reader, Room, rooms},
    machine::Machine,
    message::{MachineState, StageHealth, StageState, ValveCommand},
    stage::{StageKind, monotonic_ns},
};

use super::{
    frame::{AxesFrame, EventFrame, Hello, StagesFrame, line, unix_ms},
    published::{Kind, Published},
};
use crate::{
    arguments::load_bare,
    group::running::machine_of,
    report::{
        events::Events,
        motion::side::Side,
        status::{Collected, StatusReport},
    },
};

/// Heartbeats that a rate is computed over.
const BEATS: usize = 11;
/// Time between two frames at most; there is one with each heartbeat of the controller.
const LONGEST: Duration = Duration::from_millis(400);
/// Time between two frames about the stages.
const STAGES_APART: Duration = Duration::from_millis(450);
/// Time between two looks at the members of the group, which are files.
const MEMBERS_APART: Duration = Duration::from_secs(2);
/// Time in which a group says which machine it runs.
const YOUTH: Duration = Duration::from_secs(10);
/// Events that a browser gets.
const MOST_EVENTS: usize = 200;
/// A group without a heartbeat for so long has ended.
const SILENCE: Duration = Duration::from_secs(3);

/// A group that is being read.
pub struct Attached {
    /// Number of the attachment.
    attachment: u64,
    group: Group,
    health: Reader<StageHealth>,
    states: Reader<MachineState>,
    beats: [VecDeque<StageHealth>; 4],
    side: Option<Side>,
    events: Option<Events>,
    told: VecDeque<EventFrame>,
    numbered: u64,
    members: (Vec<Member>, Vec<Room>),
    heard: Instant,
    due: Due,
}

/// When something was done last.
struct Due {
    joined: Instant,
    frame: Instant,
    stages: Instant,
    members: Option<Instant>,
}

impl Attached {
    /// Joins a group that runs, and publishes who it is.
    ///
    /// # Errors
    /// Its channels cannot be opened.
    pub fn join(prefix: &Prefix, attachment: u64, published: &Published) -> Result<Self, ChannelError> {
        let group = Group::join(prefix, "monitor")?;
        let (health, states) = (group.reader()?, group.reader()?);
        published.history().clear();
        published.put(Kind::Events, "[]".to_owned());
        let now = Instant::now();
        let mut attached = Self {
            attachment,
            health,
            states,
            beats: Default::default(),
            side: None,
            events: None,
            told: VecDeque::new(),
            numbered: 0,
            members: (Vec::new(), Vec::new()),
            heard: now,
            due: Due { joined: now, frame: now, stages: now, members: None },
            group,
        };
        attached.know(published);
        Ok(attached)
    }

    /// Finds out which machine the group runs, and publishes it.
    fn know(&mut self, published: &Published) {
        let prefix = self.group.prefix();
        let machine = machine_of(prefix, &[]).map_err(|error| error.to_string());
        let machine: Result<Machine, String> =
            machine.and_then(|bare| load_bare(&bare, None).map_err(|error| error.to_string()));
        published.put(Kind::Hello, line(&Hello::of(self.attachment, prefix, &machine)));
        if let Ok(machine) = machine {
            self.side = machine.mechanism.as_ref().map(Side::new);
            self.events = Some(Events::new(&machine, prefix));
        }
    }

    /// Whether the group has ended: all stages say so, or none says anything.
    pub fn is_over(&self) -> bool {
        let mut last = self.beats.iter().filter_map(VecDeque::back).peekable();
        let all_stopped = last.peek().is_some() && last.all(|health| health.state == StageState::Stopped as u32);
        all_stopped || self.heard.elapsed() > SILENCE
    }

    /// Reads what has come and publishes it.
    ///
    /// # Errors
    /// A channel cannot be read.
    pub fn step(&mut self, published: &Published) -> Result<(), ChannelError> {
        while let Some(health) = self.health.read()?.if_new().copied() {
            self.heard = Instant::now();
            self.beat(&health);
        }
        let mut is_new = false;
        while let Some(state) = self.states.read()?.if_new().copied() {
            is_new = true;
            published.history().push(unix_ms(), &state);
            if let Some(events) = &mut self.events {
                events.command(&command_of(&state), None);
            }
        }
        self.tell(published);
        if is_new || self.due.frame.elapsed() > LONGEST {
            self.due.frame = Instant::now();
            self.frame(published);
        }
        Ok(())
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

    /// Publishes new events.
    fn tell(&mut self, published: &Published) {
        let new = self.events.as_mut().map(Events::drain).unwrap_or_default();
        if new.is_empty() {
            return;
        }
        for event in new {
            self.numbered += 1;
            if self.told.len() >= MOST_EVENTS {
                self.told.pop_front();
            }
            self.told.push_back(EventFrame { number: self.numbered, unix_ms: unix_ms(), event });
        }
        published.put(Kind::Events, line(&self.told));
    }

    fn frame(&mut self, published: &Published) {
        // A group that has only just begun has not said yet which machine it runs.
        let is_young = self.due.joined.elapsed() < YOUTH && self.due.stages.elapsed() > STAGES_APART;
        if self.events.is_none() && is_young {
            self.know(published);
        }
        if self.due.members.is_none_or(|looked| looked.elapsed() > MEMBERS_APART) {
            self.due.members = Some(Instant::now());
            let own = std::process::id();
            let members = self.group.members().into_iter().filter(|member| member.pid != own).collect();
            self.members = (members, rooms(self.group.prefix()));
        }
        let state = self.states.last();
        let collected = Collected {
            prefix: self.group.prefix().clone(),
            stages: std::array::from_fn(|i| Some((*self.beats[i].front()?, *self.beats[i].back()?))),
            state: state.copied(),
            members: self.members.0.clone(),
            rooms: self.members.1.clone(),
            now_ns: monotonic_ns(),
        };
        let report = StatusReport::new(&collected);
        published.put(Kind::Axes, line(&AxesFrame::new(&report, state, collected.now_ns, self.side.as_ref())));
        if self.due.stages.elapsed() > STAGES_APART {
            self.due.stages = Instant::now();
            published.put(Kind::Stages, line(&StagesFrame::new(&report)));
        }
        *published.report() = Some(report);
    }
}

/// The commands in a state of the machine.
fn command_of(state: &MachineState) -> ValveCommand {
    let mut command = ValveCommand { header: state.header, ..ValveCommand::default() };
    for (to, from) in command.axes.iter_mut().zip(&state.axes) {
        *to = from.command;
    }
    command
}
