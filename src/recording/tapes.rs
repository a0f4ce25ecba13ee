//! All channels of a group on tapes: what the supervisor reads and a black box writes.

use std::{io, time::Duration};

use mcap::McapResult;
use pipeline::{
    channel::{ChannelError, Group},
    message::{
        CoefficientSnapshot, EncoderReading, EncoderSample, MachineState, Message, Reference, Request, StageHealth,
        ValveCommand,
    },
};

use super::{
    controller_state::{self, ControllerStates},
    file::{Encoded, RecordingFile},
    kept::{KeptFile, LeftFile},
    tape::{Strip, Tape},
};

/// What a black box holds.
pub const SPAN: Duration = Duration::from_secs(10);
/// Least time between two snapshots: a snapshot is by far the largest message.
const SNAPSHOTS_APART: Duration = Duration::from_millis(50);

/// All channels of a group, read by one reader each.
pub struct Tapes {
    pub readings: Tape<EncoderReading>,
    pub samples: Tape<EncoderSample>,
    pub commands: Tape<ValveCommand>,
    pub snapshots: Tape<CoefficientSnapshot>,
    pub references: Tape<Reference>,
    pub requests: Tape<Request>,
    pub health: Tape<StageHealth>,
    pub states: Tape<MachineState>,
}

impl Tapes {
    /// Attaches to the channels of `group`, and keeps nothing.
    ///
    /// # Errors
    /// A channel cannot be opened.
    pub fn new(group: &Group) -> Result<Self, ChannelError> {
        Ok(Self {
            readings: Tape::new(group)?,
            samples: Tape::new(group)?,
            commands: Tape::new(group)?,
            snapshots: Tape::new(group)?,
            references: Tape::new(group)?,
            requests: Tape::new(group)?,
            health: Tape::new(group)?,
            states: Tape::new(group)?,
        })
    }

    /// Keeps what is read in this file for [`SPAN`], in the order in which [`Strips::left`] reads it.
    ///
    /// # Errors
    /// Shared memory has no room.
    pub fn keep(&mut self, file: &mut KeptFile) -> io::Result<()> {
        self.readings.keep(file, SPAN, 0)?;
        self.samples.keep(file, SPAN, 0)?;
        self.commands.keep(file, SPAN, 0)?;
        self.snapshots.keep(file, SPAN, SNAPSHOTS_APART.as_nanos() as u64)?;
        self.references.keep(file, SPAN, 0)?;
        self.requests.keep(file, SPAN, 0)?;
        self.health.keep(file, SPAN, 0)?;
        self.states.keep(file, SPAN, 0)
    }

    /// Takes all that is kept.
    ///
    /// # Errors
    /// What is kept cannot be read.
    pub fn take(&mut self) -> io::Result<Strips> {
        Ok(Strips {
            readings: self.readings.take()?,
            samples: self.samples.take()?,
            commands: self.commands.take()?,
            snapshots: self.snapshots.take()?,
            references: self.references.take()?,
            requests: self.requests.take()?,
            health: self.health.take()?,
            states: self.states.take()?,
        })
    }
}

/// What was kept of all channels.
pub struct Strips {
    readings: Strip<EncoderReading>,
    samples: Strip<EncoderSample>,
    commands: Strip<ValveCommand>,
    snapshots: Strip<CoefficientSnapshot>,
    references: Strip<Reference>,
    requests: Strip<Request>,
    pub health: Strip<StageHealth>,
    states: Strip<MachineState>,
}

impl Strips {
    /// What a dead supervisor has left.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn left(file: &mut LeftFile) -> io::Result<Self> {
        fn next<M: Message>(file: &mut LeftFile, apart_ns: u64) -> io::Result<Strip<M>> {
            Ok(Strip { messages: file.next(SPAN, apart_ns)?, lost: 0 })
        }
        Ok(Self {
            readings: next(file, 0)?,
            samples: next(file, 0)?,
            commands: next(file, 0)?,
            snapshots: next(file, SNAPSHOTS_APART.as_nanos() as u64)?,
            references: next(file, 0)?,
            requests: next(file, 0)?,
            health: next(file, 0)?,
            states: next(file, 0)?,
        })
    }

    /// All channels, and the states of the controllers, of these axes.
    pub fn channels(self, axes: &[String]) -> Vec<Box<dyn Messages>> {
        let states = StatesStrip::new(axes, &self.samples, &self.commands);
        vec![
            Box::new(self.readings),
            Box::new(self.samples),
            Box::new(self.commands),
            Box::new(states),
            Box::new(self.snapshots),
            Box::new(self.references),
            Box::new(self.requests),
            Box::new(self.health),
            Box::new(self.states),
        ]
    }
}

/// The messages of one channel, of any type.
pub trait Messages: Send {
    /// Adds the channel to a file.
    fn add_to(&self, file: &mut RecordingFile) -> McapResult<()>;
    /// All messages, the oldest first.
    fn encoded(&self) -> Vec<Encoded>;
    /// Name of the channel, and messages that were lost before they came here.
    fn lost(&self) -> (&'static str, u64);
}

impl<M: Message + Send> Messages for Strip<M> {
    fn add_to(&self, file: &mut RecordingFile) -> McapResult<()> {
        file.add_channel::<M>()
    }

    fn encoded(&self) -> Vec<Encoded> {
        self.messages.iter().map(|(read_ns, message)| Encoded::new(*read_ns, message)).collect()
    }

    fn lost(&self) -> (&'static str, u64) {
        (M::CHANNEL, self.lost)
    }
}

/// The states of the controllers.
struct StatesStrip {
    axes: Vec<String>,
    states: Vec<Encoded>,
    lost: u64,
}

impl StatesStrip {
    fn new(axes: &[String], samples: &Strip<EncoderSample>, commands: &Strip<ValveCommand>) -> Self {
        let mut states = ControllerStates::new(axes.len());
        let mut samples = samples.messages.iter().peekable();
        let state = |(read_ns, command): &(u64, ValveCommand)| {
            let tick = command.header.sequence;
            while let Some((_, sample)) = samples.next_if(|(_, sample)| sample.header.sequence <= tick) {
                states.sample(sample);
            }
            states.state(*read_ns, command)
        };
        Self { axes: axes.to_vec(), states: commands.messages.iter().map(state).collect(), lost: commands.lost }
    }
}

impl Messages for StatesStrip {
    fn add_to(&self, file: &mut RecordingFile) -> McapResult<()> {
        controller_state::add_to(file, &self.axes)
    }

    fn encoded(&self) -> Vec<Encoded> {
        self.states.clone()
    }

    fn lost(&self) -> (&'static str, u64) {
        (controller_state::CHANNEL, self.lost)
    }
}
