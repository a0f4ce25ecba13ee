//! The messages of a recording, channel by channel, a few hundred ticks ahead of the replay.
//!
//! The recorder reads one channel after the other. So the messages of one tick stand in a file apart from each other,
//! but not farther than a channel keeps messages.

use std::{collections::VecDeque, rc::Rc};

use pipeline::message::{
    CoefficientSnapshot, EncoderReading, EncoderSample, MachineState, Message, Reference, Request, ValveCommand,
};

use super::difference::{self, Difference, Place};
use crate::{
    failure::Failure,
    recording::{
        cdr, checksum,
        reading::{Damage, ReadChannel, ReadMessage, Reading},
        schema::Value,
        typed::{Decoder, Typed},
    },
};

/// Samples that are read ahead: twice those that a channel keeps, so that all other messages of a tick have been read.
const AHEAD: usize = 512;
/// Most messages of a channel that are kept. A run has about as many on each channel that a replay uses as samples;
/// others are refused, so that no file asks for all memory.
const MOST: usize = 16_384;

/// The messages of one channel that have been read and not been used yet.
pub struct Queue<M> {
    channel: Option<(Rc<ReadChannel>, Decoder<M>)>,
    messages: VecDeque<Typed<M>>,
}

impl<M> Default for Queue<M> {
    fn default() -> Self {
        Self { channel: None, messages: VecDeque::new() }
    }
}

impl<M: Message> Queue<M> {
    /// Takes in a message of this channel, of which it keeps at most so many.
    ///
    /// # Errors
    /// The message cannot be read, or there are too many.
    pub fn push(&mut self, message: ReadMessage, most: usize) -> Result<(), Failure> {
        if !self.channel.as_ref().is_some_and(|(channel, _)| Rc::ptr_eq(channel, &message.channel)) {
            let decoder = Decoder::new(&message.channel).map_err(|error| Failure::usage(error).about(M::CHANNEL))?;
            self.channel = Some((Rc::clone(&message.channel), decoder));
        }
        let decoded = self.channel.as_ref().and_then(|(_, decoder)| decoder.decode(message.bytes));
        let decoded = decoded.ok_or_else(|| {
            let (channel, number) = (M::CHANNEL, message.sequence);
            Failure::run(format!("{channel}: message {number}: found bytes that are no message of this channel"))
        })?;
        self.messages.push_back(decoded);
        if self.messages.len() > most {
            let channel = M::CHANNEL;
            return Err(Failure::usage(format!(
                "{channel}: found more than {most} messages; allowed: no more at once"
            )));
        }
        Ok(())
    }

    /// Whether the recording has the messages of today.
    pub fn is_exact(&self) -> bool {
        self.channel.as_ref().is_none_or(|(_, decoder)| decoder.is_exact())
    }

    /// The next message, which stays.
    pub fn peek(&self) -> Option<&M> {
        self.messages.front().map(|typed| &typed.message)
    }

    /// The next message.
    pub fn pop(&mut self) -> Option<Typed<M>> {
        self.messages.pop_front()
    }

    /// The messages that wait.
    pub fn waiting(&self) -> &VecDeque<Typed<M>> {
        &self.messages
    }

    /// The next message of this tick; those of ticks before it are dropped.
    pub fn of_tick(&mut self, tick: u64) -> Option<Typed<M>> {
        while self.peek().is_some_and(|message| message.header().sequence < tick) {
            self.pop();
        }
        self.peek().is_some_and(|message| message.header().sequence == tick).then(|| self.pop()).flatten()
    }
}

/// All messages that a replay needs.
pub struct Feed {
    reading: Reading,
    /// Where messages are compared with their checksums: the channels that need no comparison, as they are computed.
    computed: Option<Vec<&'static str>>,
    /// The channels whose messages are not kept.
    unused: Vec<&'static str>,
    /// The first message that is not as it was recorded.
    changed: Option<Difference>,
    is_over: bool,
    /// Of channel `encoder-reading`.
    pub readings: Queue<EncoderReading>,
    /// Of channel `encoder-sample`.
    pub samples: Queue<EncoderSample>,
    /// Of channel `coefficient-snapshot`.
    pub snapshots: Queue<CoefficientSnapshot>,
    /// Of channel `valve-command`.
    pub commands: Queue<ValveCommand>,
    /// Of channel `reference`.
    pub references: Queue<Reference>,
    /// Of channel `request`.
    pub requests: Queue<Request>,
    /// Of channel `machine-state`.
    pub states: Queue<MachineState>,
}

impl Feed {
    /// From the beginning of a recording.
    pub fn new(reading: Reading) -> Self {
        Self {
            reading,
            computed: None,
            unused: Vec::new(),
            changed: None,
            is_over: false,
            readings: Queue::default(),
            samples: Queue::default(),
            snapshots: Queue::default(),
            commands: Queue::default(),
            references: Queue::default(),
            requests: Queue::default(),
            states: Queue::default(),
        }
    }

    /// Reads ahead, so that all messages of the next tick are there.
    ///
    /// # Errors
    /// The file cannot be read, or a message is too short.
    pub fn fill(&mut self) -> Result<(), Failure> {
        while !self.is_over && self.samples.messages.len() < AHEAD {
            match self.reading.next()? {
                Some(message) => self.sort(message)?,
                None => self.is_over = true,
            }
        }
        Ok(())
    }

    /// From now on keeps no messages of `channels`: nobody takes them.
    pub fn leave_out(&mut self, channels: &[&'static str]) {
        self.unused.extend(channels);
    }

    /// Compares all messages with their checksums, but for those on `computed` channels.
    pub fn check_all_but(&mut self, computed: Vec<&'static str>) {
        self.computed = Some(computed);
    }

    /// The first message that is not as it was recorded, among those that are compared with their checksums.
    pub fn changed(&mut self) -> Option<Difference> {
        self.changed.take()
    }

    /// Why the recording ends before its end.
    pub fn damage(&self) -> Option<&Damage> {
        self.reading.damage()
    }

    /// A fact of the recording; those of the end are known at the end.
    pub fn fact(&self, name: &str) -> Option<&str> {
        self.reading.facts().get(name).map(String::as_str)
    }

    /// Compares a message with its checksum. Whether it can be read.
    fn check(&mut self, message: &ReadMessage) -> bool {
        let ReadMessage { channel, bytes, .. } = message;
        let Some(computed) = &self.computed else { return true };
        let has_one = channel.columns.last().is_some_and(|column| column.name == difference::CHECKSUM);
        let is_readable = bytes.starts_with(&cdr::ENCAPSULATION);
        if !has_one || is_readable && computed.contains(&channel.name.as_str()) || checksum::is_whole(bytes) {
            return true;
        }
        let tick = channel.column("header.sequence").and_then(|column| column.value(bytes)).map_or(0, Value::as_u64);
        let axes = self.reading.axes();
        let place = Place { channel: channel.name.clone(), tick, axes: &axes };
        let damage = difference::damage(&place, &channel.columns, bytes);
        self.changed = self.changed.take().or(damage);
        is_readable
    }

    fn sort(&mut self, message: ReadMessage) -> Result<(), Failure> {
        if !self.check(&message) {
            return Ok(());
        }
        match message.channel.name.as_str() {
            unused if self.unused.contains(&unused) => Ok(()),
            EncoderReading::CHANNEL => self.readings.push(message, MOST),
            EncoderSample::CHANNEL => self.samples.push(message, MOST),
            CoefficientSnapshot::CHANNEL => self.snapshots.push(message, MOST),
            ValveCommand::CHANNEL => self.commands.push(message, MOST),
            Reference::CHANNEL => self.references.push(message, MOST),
            Request::CHANNEL => self.requests.push(message, MOST),
            MachineState::CHANNEL => self.states.push(message, MOST),
            _ => Ok(()),
        }
    }
}
