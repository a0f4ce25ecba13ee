//! The group on this machine, read only: found, joined, watched, left.
//!
//! The bridge is one more reader of the channels. It opens no publisher and asks nothing of an axis.
//!
//! Trap: a client that joins before the supervisor does keeps the supervisor from starting, since the group then looks
//! like one that runs, and one that stays in a dead group does the same. So a group counts only when it has a member in
//! two looks in a row, and is left as soon as no stage and no supervisor is in it.

use std::time::{Duration, Instant};

use pipeline::{
    channel::{ChannelError, Group, GroupState, Prefix, Reader, groups, is_joined, remove_leftovers},
    message::{CoefficientSnapshot, EncoderSample, MachineState, Message, StageHealth, ValveCommand},
    stage::Life,
};

/// Name under which the bridge joins a group.
const NAME: &str = "fleet";
/// Time between two looks for a group.
const SEARCH: Duration = Duration::from_millis(250);
/// A channel that brings nothing for so long, while stages are heard, is attached to once more.
const DEAF: Duration = Duration::from_secs(2);

/// Looks for a group.
pub struct Search {
    /// The group that is meant; none for the only one that runs.
    named: Option<Prefix>,
    seen: Option<Prefix>,
    looked: Option<Instant>,
}

impl Search {
    /// For this group, or for the only one that runs.
    pub fn new(named: Option<Prefix>) -> Self {
        Self { named, seen: None, looked: None }
    }

    /// The group, once two looks in a row have found it.
    pub fn look(&mut self) -> Option<Prefix> {
        if self.looked.is_some_and(|looked| looked.elapsed() < SEARCH) {
            return None;
        }
        self.looked = Some(Instant::now());
        let found = self.named.clone().or_else(only_one).filter(is_joined);
        let before = std::mem::replace(&mut self.seen, found.clone());
        found.filter(|_| before == self.seen)
    }
}

/// The only group that runs; none where several do.
pub fn only_one() -> Option<Prefix> {
    let mut living = groups().into_iter().filter(|group| group.state == GroupState::Alive);
    let one = living.next()?;
    living.next().is_none().then_some(one.prefix)
}

/// A channel, and when it last brought something.
struct Channel<M: Message> {
    reader: Reader<M>,
    heard: Instant,
}

impl<M: Message> Channel<M> {
    fn open(group: &Group) -> Result<Self, ChannelError> {
        Ok(Self { reader: group.reader()?, heard: Instant::now() })
    }

    fn each(&mut self, mut look: impl FnMut(&M)) -> Result<(), ChannelError> {
        let heard = &mut self.heard;
        self.reader.each(|message| {
            *heard = Instant::now();
            look(message);
        })?;
        Ok(())
    }

    fn listen_again(&mut self) {
        if self.heard.elapsed() > DEAF {
            self.heard = Instant::now();
            self.reader.reattach();
        }
    }
}

/// Takes what the channels of a group bring.
pub trait Look {
    /// A new sample.
    fn sample(&mut self, sample: &EncoderSample);
    /// A new command.
    fn command(&mut self, command: &ValveCommand);
    /// A new snapshot.
    fn snapshot(&mut self, snapshot: &CoefficientSnapshot);
    /// A new state of the axes.
    fn state(&mut self, state: &MachineState);
    /// A heartbeat.
    fn health(&mut self, health: &StageHealth);
}

/// A group that is read.
pub struct Watched {
    group: Group,
    samples: Channel<EncoderSample>,
    commands: Channel<ValveCommand>,
    snapshots: Channel<CoefficientSnapshot>,
    states: Channel<MachineState>,
    health: Channel<StageHealth>,
    life: Life,
}

impl Watched {
    /// Joins a group that runs.
    ///
    /// # Errors
    /// Its channels cannot be opened.
    pub fn join(prefix: &Prefix) -> Result<Self, ChannelError> {
        let group = Group::join(prefix, NAME)?;
        Ok(Self {
            samples: Channel::open(&group)?,
            commands: Channel::open(&group)?,
            snapshots: Channel::open(&group)?,
            states: Channel::open(&group)?,
            health: Channel::open(&group)?,
            life: Life::begin(),
            group,
        })
    }

    /// Name of the group.
    pub fn prefix(&self) -> &Prefix {
        self.group.prefix()
    }

    /// Gives all that is new to `look`.
    ///
    /// # Errors
    /// A channel cannot be read.
    pub fn step(&mut self, look: &mut impl Look) -> Result<(), ChannelError> {
        let life = &mut self.life;
        self.health.each(|health| {
            life.hear(health);
            look.health(health);
        })?;
        self.states.each(|state| look.state(state))?;
        self.snapshots.each(|snapshot| look.snapshot(snapshot))?;
        self.samples.each(|sample| look.sample(sample))?;
        self.commands.each(|command| look.command(command))?;
        if self.life.silence() < DEAF {
            self.samples.listen_again();
            self.commands.listen_again();
            self.snapshots.listen_again();
            self.states.listen_again();
        }
        Ok(())
    }

    /// Messages that were sent and never read here, by channel.
    pub fn lost(&self) -> [(&'static str, u64); 5] {
        [
            (EncoderSample::CHANNEL, self.samples.reader.lost()),
            (ValveCommand::CHANNEL, self.commands.reader.lost()),
            (CoefficientSnapshot::CHANNEL, self.snapshots.reader.lost()),
            (MachineState::CHANNEL, self.states.reader.lost()),
            (StageHealth::CHANNEL, self.health.reader.lost()),
        ]
    }

    /// Whether the group has ended: all stages say so, or none says anything.
    pub fn is_over(&mut self) -> bool {
        self.life.is_over(&self.group)
    }

    /// Leaves the group, and removes its files if the bridge was the last member.
    pub fn leave(self) {
        let prefix = self.group.prefix().clone();
        drop(self);
        // The group lives on where another member is left.
        let _ = remove_leftovers(&prefix);
    }
}
