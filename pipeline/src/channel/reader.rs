//! The reading end of a channel.

use iceoryx2::{port::subscriber::Subscriber, service::port_factory::publish_subscribe::PortFactory};

use super::{ChannelError, service::Service};
use crate::message::{CHANNELS, ChannelHealth, Message};

/// What a read found. Nobody can mistake an old message for a new one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Read<'a, M> {
    /// A message that has not been read before.
    New(&'a M),
    /// Nothing new: the last message again.
    Old(&'a M),
    /// There never was a message.
    None,
}

impl<'a, M> Read<'a, M> {
    /// The message if it is new.
    pub fn if_new(self) -> Option<&'a M> {
        match self {
            Self::New(message) => Some(message),
            Self::Old(_) | Self::None => None,
        }
    }
}

/// Reads messages of one kind and counts the ones it missed; never waits, allocates nothing.
pub struct Reader<M: Message> {
    channel: PortFactory<Service, M, ()>,
    port: Subscriber<Service, M, ()>,
    last: M,
    any: bool,
    /// It has attached anew: what was sent last may come again.
    may_repeat: bool,
    health: ChannelHealth,
}

impl<M: Message> Reader<M> {
    /// # Errors
    /// The channel has its readers already.
    pub(super) fn new(factory: PortFactory<Service, M, ()>) -> Result<Self, String> {
        let port = attach(&factory)?;
        let channel = CHANNELS.iter().position(|name| *name == M::CHANNEL).unwrap_or(CHANNELS.len()) as u32;
        let health = ChannelHealth { channel, ..ChannelHealth::default() };
        Ok(Self { channel: factory, port, last: M::default(), any: false, may_repeat: false, health })
    }

    /// Takes another place on the channel, which makes all its writers connect anew; what was sent last comes again if it
    /// was not read. For a reader that hears nothing where it should: the library gives a connection up that could not be
    /// made at the first try, and nobody is told.
    pub fn reattach(&mut self) {
        // Without another place it keeps the one it has.
        if let Ok(port) = attach(&self.channel) {
            self.port = port;
            self.may_repeat = true;
        }
    }

    /// The next message in the order they were sent.
    ///
    /// # Errors
    /// The library cannot connect to a writer.
    pub fn read(&mut self) -> Result<Read<'_, M>, ChannelError> {
        let refuse = |reason| ChannelError::Receive { channel: M::CHANNEL, reason };
        loop {
            let received = self.port.receive().map_err(|error| refuse(format!("{error:?}")))?;
            let Some(sample) = received else {
                return Ok(if self.any { Read::Old(&self.last) } else { Read::None });
            };
            if std::mem::take(&mut self.may_repeat) && self.any && sample.payload().header() == self.last.header() {
                continue;
            }
            let (before, after) = (self.last.header(), sample.payload().header());
            if self.any && after.number > before.number {
                self.health.lost += after.number - before.number - 1;
            } else if self.any {
                self.health.restarts += 1;
            }
            if self.any {
                let gap = after.acquired_ns.saturating_sub(before.acquired_ns);
                self.health.longest_gap_ns = self.health.longest_gap_ns.max(gap);
            }
            self.health.received += 1;
            self.last = *sample;
            self.any = true;
            return Ok(Read::New(&self.last));
        }
    }

    /// The newest message; the ones before it count as read.
    ///
    /// # Errors
    /// The library cannot connect to a writer.
    pub fn newest(&mut self) -> Result<Read<'_, M>, ChannelError> {
        let mut new = false;
        while self.read()?.if_new().is_some() {
            new = true;
        }
        Ok(match (self.any, new) {
            (true, true) => Read::New(&self.last),
            (true, false) => Read::Old(&self.last),
            (false, _) => Read::None,
        })
    }

    /// Reads on, in order, until the message of tick `sequence` or a later one is the last that was read; false while
    /// it has not come.
    ///
    /// # Errors
    /// The library cannot connect to a writer.
    pub fn reach(&mut self, sequence: u64) -> Result<bool, ChannelError> {
        loop {
            if self.last().is_some_and(|message| message.header().sequence >= sequence) {
                return Ok(true);
            }
            if self.read()?.if_new().is_none() {
                return Ok(false);
            }
        }
    }

    /// The last message that was read, if any.
    pub fn last(&self) -> Option<&M> {
        self.any.then_some(&self.last)
    }

    /// Messages that were sent and never read, by the gaps in their numbers.
    pub fn lost(&self) -> u64 {
        self.health.lost
    }

    /// Messages whose number did not rise: the writer started again.
    pub fn restarts(&self) -> u64 {
        self.health.restarts
    }

    /// How the channel is doing at a time, ns of `CLOCK_MONOTONIC`.
    pub fn health(&self, now_ns: u64) -> ChannelHealth {
        let age_ns = if self.any { now_ns.saturating_sub(self.last.header().acquired_ns) } else { 0 };
        ChannelHealth { any: u32::from(self.any), age_ns, ..self.health }
    }

    /// Counts from zero again.
    pub fn reset_health(&mut self) {
        self.health = ChannelHealth { channel: self.health.channel, ..ChannelHealth::default() };
    }
}

fn attach<M: Message>(factory: &PortFactory<Service, M, ()>) -> Result<Subscriber<Service, M, ()>, String> {
    factory.subscriber_builder().buffer_size(M::BUFFER).create().map_err(|error| format!("{error:?}"))
}
