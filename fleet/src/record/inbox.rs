//! Messages on their way from Zenoh's callbacks to the files.
//!
//! A callback never waits: the disk may stop for seconds, and a callback that waits stops all messages. What a machine
//! sends is bounded for each machine on its own, so a machine that sends too much loses its own messages only.

use std::{
    collections::BTreeMap,
    sync::{Mutex, MutexGuard, PoisonError},
};

use zenoh::sample::Sample;

use crate::key::Place;

/// Most machines: many times those of a site.
pub const MOST_MACHINES: usize = 256;
/// Longest payload with its attachment, bytes: models have 9 kB.
const LONGEST: usize = 64 << 10;
/// Most bytes that wait of one machine, a minute of its messages, and of all machines.
const ROOM_OF_ONE: usize = 4 << 20;
const ROOM: usize = 256 << 20;

/// A message as it came.
#[derive(Debug)]
pub struct Received {
    /// Its whole key.
    pub key: String,
    /// Its encoding.
    pub encoding: String,
    /// Its bytes.
    pub payload: Vec<u8>,
    /// Its stamp, as far as it is one.
    pub attachment: Vec<u8>,
    /// When it came, ns since 1970.
    pub at_ns: i64,
}

impl Received {
    /// A message that comes now. One that is too long comes without its bytes, so that it counts as malformed.
    pub fn of(sample: &Sample, at_ns: i64) -> Self {
        let attached = sample.attachment();
        let length = sample.payload().len().saturating_add(attached.map_or(0, |bytes| bytes.len()));
        let (payload, attachment) = if length > LONGEST {
            (Vec::new(), Vec::new())
        } else {
            let attachment = attached.map(|bytes| bytes.to_bytes().into_owned());
            (sample.payload().to_bytes().into_owned(), attachment.unwrap_or_default())
        };
        let (key, encoding) = (sample.key_expr().as_str().to_owned(), sample.encoding().to_string());
        Self { key, encoding, payload, attachment, at_ns }
    }

    /// Memory that it takes, bytes.
    fn length(&self) -> usize {
        size_of::<Self>() + self.key.len() + self.encoding.len() + self.payload.len() + self.attachment.len()
    }
}

/// What waits of a machine.
#[derive(Debug, Default)]
pub struct Post {
    /// Messages in the order in which they came.
    pub messages: Vec<Received>,
    /// Messages that found no room; all of them came later than those above.
    pub dropped: u64,
    bytes: usize,
}

/// What waits of all machines.
#[derive(Debug, Default)]
pub struct Waiting {
    /// By machine.
    pub machines: BTreeMap<Place, Post>,
    /// Messages of no machine, or of one too many.
    pub strangers: u64,
    bytes: usize,
}

impl Waiting {
    /// Adds a message, or counts it where there is no room.
    pub fn push(&mut self, received: Received) {
        let place = Place::of(&received.key).map(|(place, _)| place);
        let has_place = |place: &Place| self.machines.len() < MOST_MACHINES || self.machines.contains_key(place);
        let Some(place) = place.filter(has_place) else {
            self.strangers += 1;
            return;
        };
        let (post, length) = (self.machines.entry(place).or_default(), received.length());
        // After the first one that finds no room all others are dropped as well: one gap, not many.
        if post.dropped > 0 || post.bytes + length > ROOM_OF_ONE || self.bytes + length > ROOM {
            post.dropped += 1;
            return;
        }
        post.bytes += length;
        self.bytes += length;
        post.messages.push(received);
    }
}

/// What waits, between two threads.
#[derive(Debug, Default)]
pub struct Inbox(Mutex<Waiting>);

impl Inbox {
    /// Adds a message that comes now.
    pub fn push(&self, received: Received) {
        self.waiting().push(received);
    }

    /// Takes everything.
    pub fn take(&self) -> Waiting {
        std::mem::take(&mut *self.waiting())
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        // A callback that has panicked leaves counts that may be one less.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(machine: &str, length: usize) -> Received {
        let key = format!("hydraxis/v1/quarry/{machine}/status");
        Received { key, encoding: String::new(), payload: vec![0; length], attachment: Vec::new(), at_ns: 0 }
    }

    #[test]
    fn a_machine_that_sends_too_much_loses_its_own_messages_only() {
        let inbox = Inbox::default();
        (0..1000).for_each(|_| inbox.push(message("loud", LONGEST)));
        inbox.push(message("loud", 0));
        inbox.push(message("ex-07", 100));
        let waiting = inbox.take();
        let of = |machine: &str| {
            let post = waiting.machines.iter().find(|(place, _)| place.machine.to_string() == machine).unwrap().1;
            (post.messages.len(), post.dropped)
        };
        let kept = ROOM_OF_ONE / LONGEST - 1;
        assert_eq!((of("loud"), of("ex-07")), ((kept, 1001 - kept as u64), (1, 0)));
        // What was taken leaves room.
        inbox.push(message("loud", LONGEST));
        assert_eq!(inbox.take().machines.values().next().unwrap().dropped, 0);
    }

    #[test]
    fn machines_and_bytes_are_bounded() {
        let inbox = Inbox::default();
        (0..MOST_MACHINES + 10).for_each(|i| inbox.push(message(&format!("m-{i}"), 0)));
        inbox.push(Received { key: "hydraxis/v1/quarry".to_owned(), ..message("none", 0) });
        let waiting = inbox.take();
        assert_eq!((waiting.machines.len(), waiting.strangers), (MOST_MACHINES, 11));
        for i in 0..MOST_MACHINES {
            (0..80).for_each(|_| inbox.push(message(&format!("m-{i}"), LONGEST)));
        }
        let waiting = inbox.take();
        assert!(waiting.bytes <= ROOM, "{}", waiting.bytes);
        assert!(waiting.machines.values().map(|post| post.dropped).sum::<u64>() > 0);
    }
}
