//! The reading end of a channel.

use iceoryx2::{
    port::subscriber::{Subscriber, SubscriberCreateError},
    service::port_factory::publish_subscribe::PortFactory,
};

use super::{error::ReceiveError, service::Service};
use crate::message::{CHANNELS, ChannelHealth, Message};

/// Result of a read. It tells a new message from an old one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Read<'a, M> {
    /// A message that has not been read before.
    New(&'a M),
    /// No new message; the last one again.
    Old(&'a M),
    /// No message has come yet.
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

/// Result of taking one message from the channel.
enum Taken {
    /// A message that has not been read before. It is the last one now.
    Message,
    /// A message about another machine, or one that was read before.
    Skipped,
    /// No message waits.
    Nothing,
}

/// Reads messages of one kind and counts lost ones. It never waits and allocates nothing.
pub struct Reader<M: Message> {
    channel: PortFactory<Service, M, ()>,
    port: Subscriber<Service, M, ()>,
    last: M,
    any: bool,
    /// The reader has attached anew, so the last message may come again.
    may_repeat: bool,
    /// The machine of the group; 0 where the reader does not know it.
    machine: u32,
    health: ChannelHealth,
}

impl<M: Message> Reader<M> {
    /// # Errors
    /// The channel has as many readers as it takes.
    pub(super) fn new(factory: PortFactory<Service, M, ()>, machine: u32) -> Result<Self, SubscriberCreateError> {
        let port = attach(&factory)?;
        let channel = CHANNELS.iter().position(|name| *name == M::CHANNEL).unwrap_or(CHANNELS.len()) as u32;
        let health = ChannelHealth { channel, ..ChannelHealth::default() };
        Ok(Self { channel: factory, port, last: M::default(), any: false, may_repeat: false, machine, health })
    }

    /// Attaches to the channel anew, so that all its publishers connect anew. The last message comes again if it was
    /// not read. This is for a reader that receives nothing although it should: iceoryx2 gives up a connection that it
    /// could not make at the first try, and reports this to nobody. A reader with a message that waits keeps its place.
    pub fn reattach(&mut self) {
        // A message that waits shows that the connection works. In a new place it would be lost.
        if matches!(self.port.has_samples(), Ok(true)) {
            return;
        }
        // Without a second place on the channel the reader keeps the one it has.
        if let Ok(port) = attach(&self.channel) {
            self.port = port;
            self.may_repeat = true;
        }
    }

    /// The next message in the order they were sent.
    ///
    /// # Errors
    /// iceoryx2 cannot connect to a publisher.
    pub fn read(&mut self) -> Result<Read<'_, M>, ReceiveError> {
        for _ in 0..kept::<M>() {
            match self.take()? {
                Taken::Message => return Ok(Read::New(&self.last)),
                Taken::Skipped => {}
                Taken::Nothing => break,
            }
        }
        Ok(if self.any { Read::Old(&self.last) } else { Read::None })
    }

    /// Takes one message from the channel.
    fn take(&mut self) -> Result<Taken, ReceiveError> {
        let received = self.port.receive().map_err(|source| ReceiveError { channel: M::CHANNEL, source })?;
        let Some(sample) = received else { return Ok(Taken::Nothing) };
        if std::mem::take(&mut self.may_repeat) && self.any && sample.payload().header() == self.last.header() {
            return Ok(Taken::Skipped);
        }
        let (before, after) = (self.last.header(), sample.payload().header());
        if self.is_foreign(after.machine) {
            self.health.foreign += 1;
            return Ok(Taken::Skipped);
        }
        if self.any && after.session == before.session && after.number > before.number {
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
        Ok(Taken::Message)
    }

    /// Whether a message is about another machine than the group's, or does not say about which although it must.
    fn is_foreign(&self, machine: u32) -> bool {
        self.machine != 0 && machine != self.machine && (machine != 0 || M::IS_FROM_CLIENTS)
    }

    /// Gives all messages that wait to `look`, in the order they were sent. It takes at most as many messages as the
    /// channel keeps, so that it ends also while writers never cease to send. The others wait for the next look.
    ///
    /// # Errors
    /// iceoryx2 cannot connect to a publisher.
    pub fn each(&mut self, mut look: impl FnMut(&M)) -> Result<(), ReceiveError> {
        for _ in 0..kept::<M>() {
            match self.take()? {
                Taken::Message => look(&self.last),
                Taken::Skipped => {}
                Taken::Nothing => break,
            }
        }
        Ok(())
    }

    /// The newest message; the messages before it count as read. It takes as many messages as [`Self::each`] does.
    ///
    /// # Errors
    /// iceoryx2 cannot connect to a publisher.
    pub fn newest(&mut self) -> Result<Read<'_, M>, ReceiveError> {
        let mut new = false;
        self.each(|_| new = true)?;
        Ok(match (self.any, new) {
            (true, true) => Read::New(&self.last),
            (true, false) => Read::Old(&self.last),
            (false, _) => Read::None,
        })
    }

    /// Reads on, in order, until the last message read is that of tick `sequence` or of a later one; false while it has
    /// not come.
    ///
    /// # Errors
    /// iceoryx2 cannot connect to a publisher.
    pub fn reach(&mut self, sequence: u64) -> Result<bool, ReceiveError> {
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

    /// Number of lost messages: sent and never read, by the gaps in their numbers.
    pub fn lost(&self) -> u64 {
        self.health.lost
    }

    /// Number of messages of another session, or whose number did not rise: the publisher started again.
    pub fn restarts(&self) -> u64 {
        self.health.restarts
    }

    /// State of the channel at a time, ns of `CLOCK_MONOTONIC`.
    pub fn health(&self, now_ns: u64) -> ChannelHealth {
        let age_ns = if self.any { now_ns.saturating_sub(self.last.header().acquired_ns) } else { 0 };
        ChannelHealth { any: u32::from(self.any), age_ns, ..self.health }
    }

    /// Sets all counts to zero.
    pub fn reset_health(&mut self) {
        self.health = ChannelHealth { channel: self.health.channel, ..ChannelHealth::default() };
    }
}

/// Largest number of messages that wait for one reader: each writer has a buffer of its own.
const fn kept<M: Message>() -> usize {
    M::MAX_PUBLISHERS * M::BUFFER
}

fn attach<M: Message>(
    factory: &PortFactory<Service, M, ()>,
) -> Result<Subscriber<Service, M, ()>, SubscriberCreateError> {
    factory.subscriber_builder().buffer_size(M::BUFFER).create()
}
