//! The last messages of a channel.

use std::{io, time::Duration};

use pipeline::{
    channel::{ChannelError, Group, Reader},
    message::{ChannelHealth, Message},
    stage::monotonic_ns,
};

use super::kept::{KeptFile, Ring};

/// A reader that keeps what it has read for a while.
pub struct Tape<M: Message> {
    reader: Reader<M>,
    /// None keeps nothing.
    kept: Option<Ring>,
    apart: Apart,
    /// Messages that could not be kept.
    unkept: u64,
}

/// Messages taken from a tape, with the times at which they were read, ns of `CLOCK_MONOTONIC`.
pub struct Strip<M> {
    /// Time and message, the oldest first.
    pub messages: Vec<(u64, M)>,
    /// Messages of the channel that the tape has missed since it was made.
    pub lost: u64,
}

impl<M: Message> Tape<M> {
    /// Of a channel of `group` that keeps nothing.
    ///
    /// # Errors
    /// The channel cannot be read.
    pub fn new(group: &Group) -> Result<Self, ChannelError> {
        Ok(Self { reader: group.reader()?, kept: None, apart: Apart::default(), unkept: 0 })
    }

    /// Keeps messages in `file` for `span` from now on, those closer together than `apart_ns` left out.
    ///
    /// # Errors
    /// Shared memory has no room.
    pub fn keep(&mut self, file: &mut KeptFile, span: Duration, apart_ns: u64) -> io::Result<()> {
        self.kept = Some(file.add::<M>(span, apart_ns)?);
        self.apart = Apart { apart_ns, last_ns: None };
        Ok(())
    }

    /// The next message in order, if one has come; kept with the time at which it was read.
    ///
    /// # Errors
    /// The channel cannot be read.
    pub fn read(&mut self) -> Result<Option<M>, ChannelError> {
        let Some(message) = self.reader.read()?.if_new().copied() else { return Ok(None) };
        let now = monotonic_ns();
        if let Some(ring) = self.kept.as_mut().filter(|_| self.apart.takes(now)) {
            self.unkept += u64::from(ring.write(now, &message).is_err());
        }
        Ok(Some(message))
    }

    /// Reads all that have come. The newest one if there is any.
    ///
    /// # Errors
    /// The channel cannot be read.
    pub fn newest(&mut self) -> Result<Option<M>, ChannelError> {
        let mut newest = None;
        while let Some(message) = self.read()? {
            newest = Some(message);
        }
        Ok(newest)
    }

    /// The last message that was read.
    pub fn last(&self) -> Option<&M> {
        self.reader.last()
    }

    /// Counts of the channel.
    pub fn health(&self) -> ChannelHealth {
        self.reader.health(monotonic_ns())
    }

    /// Takes all that is kept.
    ///
    /// # Errors
    /// The file of what is kept cannot be read.
    pub fn take(&mut self) -> io::Result<Strip<M>> {
        let messages = self.kept.as_mut().map(Ring::take).transpose()?.unwrap_or_default();
        Ok(Strip { messages, lost: self.reader.lost() + self.unkept })
    }
}

/// Leaves out messages that come too soon after the last one that was kept.
#[derive(Default)]
struct Apart {
    apart_ns: u64,
    last_ns: Option<u64>,
}

impl Apart {
    fn takes(&mut self, now: u64) -> bool {
        let is_apart = self.last_ns.is_none_or(|last| now.saturating_sub(last) >= self.apart_ns);
        if is_apart {
            self.last_ns = Some(now);
        }
        is_apart
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_that_are_apart_are_kept() {
        let kept = |apart_ns: u64| {
            let mut apart = Apart { apart_ns, last_ns: None };
            [0, 1, 5, 8, 9].into_iter().filter(|now| apart.takes(*now)).collect::<Vec<u64>>()
        };
        assert_eq!((kept(0), kept(4)), (vec![0, 1, 5, 8, 9], vec![0, 5, 9]));
    }
}
