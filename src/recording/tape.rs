//! The last messages of a channel.

use std::collections::VecDeque;

use pipeline::{
    channel::{ChannelError, Group, Reader},
    message::{ChannelHealth, Message},
    stage::monotonic_ns,
};

/// Most messages that a tape holds: twice those of 1 kHz in the longest span.
const MOST: usize = 20_000;

/// A reader that keeps what it has read for a while.
pub struct Tape<M: Message> {
    reader: Reader<M>,
    /// Time for which messages are kept, ns; 0 keeps none.
    span_ns: u64,
    /// Least time between two messages that are kept, ns.
    apart_ns: u64,
    kept: VecDeque<(u64, M)>,
}

/// Messages taken from a tape, with the times at which they were read, ns of `CLOCK_MONOTONIC`.
pub struct Strip<M> {
    /// Time and message, the oldest first.
    pub messages: VecDeque<(u64, M)>,
    /// Messages of the channel that the tape has missed since it was made.
    pub lost: u64,
}

impl<M: Message> Tape<M> {
    /// Of a channel of `group`. It keeps messages for `span_ns`, those closer together than `apart_ns` left out.
    ///
    /// # Errors
    /// The channel cannot be read.
    pub fn new(group: &Group, span_ns: u64, apart_ns: u64) -> Result<Self, ChannelError> {
        Ok(Self { reader: group.reader()?, span_ns, apart_ns, kept: VecDeque::new() })
    }

    /// The next message in order, if one has come; kept with the time at which it was read.
    ///
    /// # Errors
    /// The channel cannot be read.
    pub fn read(&mut self) -> Result<Option<M>, ChannelError> {
        let Some(message) = self.reader.read()?.if_new().copied() else { return Ok(None) };
        keep(&mut self.kept, (monotonic_ns(), message), self.span_ns, self.apart_ns);
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
    pub fn take(&mut self) -> Strip<M> {
        Strip { messages: std::mem::take(&mut self.kept), lost: self.reader.lost() }
    }
}

/// Adds a message with its time, and drops those that are too old or too many.
fn keep<M>(kept: &mut VecDeque<(u64, M)>, message: (u64, M), span_ns: u64, apart_ns: u64) {
    let now = message.0;
    if span_ns == 0 || kept.back().is_some_and(|(before, _)| now.saturating_sub(*before) < apart_ns) {
        return;
    }
    while kept.len() >= MOST || kept.front().is_some_and(|(time, _)| now.saturating_sub(*time) > span_ns) {
        kept.pop_front();
    }
    kept.push_back(message);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(span_ns: u64, apart_ns: u64, times: impl IntoIterator<Item = u64>) -> Vec<u64> {
        let mut kept = VecDeque::new();
        times.into_iter().for_each(|time| keep(&mut kept, (time, ()), span_ns, apart_ns));
        kept.iter().map(|(time, ())| *time).collect()
    }

    #[test]
    fn messages_of_the_span_are_kept() {
        assert_eq!(times(10, 0, [1, 1, 5, 11, 12]), [5, 11, 12]);
        assert_eq!(times(10, 4, [0, 1, 5, 8, 9]), [0, 5, 9]);
        assert!(times(0, 0, [1, 2]).is_empty());
        assert_eq!(times(u64::MAX, 0, 0..MOST as u64 + 3)[0], 3);
    }
}
