//! The reading end of a channel.

use iceoryx2::port::subscriber::Subscriber;

use super::{ChannelError, service::Service};
use crate::message::Message;

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
    port: Subscriber<Service, M, ()>,
    last: M,
    any: bool,
    lost: u64,
    restarts: u64,
}

impl<M: Message> Reader<M> {
    pub(super) fn new(port: Subscriber<Service, M, ()>) -> Self {
        Self { port, last: M::default(), any: false, lost: 0, restarts: 0 }
    }

    /// The next message in the order they were sent.
    ///
    /// # Errors
    /// The library cannot connect to a writer.
    pub fn read(&mut self) -> Result<Read<'_, M>, ChannelError> {
        let received =
            self.port.receive().map_err(|e| ChannelError::Receive { channel: M::CHANNEL, reason: format!("{e:?}") })?;
        match received {
            Some(sample) => {
                let (before, after) = (self.last.header().number, sample.payload().header().number);
                if self.any && after > before {
                    self.lost += after - before - 1;
                } else if self.any {
                    self.restarts += 1;
                }
                self.last = *sample;
                self.any = true;
                Ok(Read::New(&self.last))
            }
            None if self.any => Ok(Read::Old(&self.last)),
            None => Ok(Read::None),
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
        self.lost
    }

    /// Messages whose number did not rise: the writer started again.
    pub fn restarts(&self) -> u64 {
        self.restarts
    }
}
