//! Two messages that should be equal, compared byte by byte, and the first field in which they are not.
//!
//! `header.sent_ns` is the time of a clock at which a stage sent a message. It is the only field that is not compared.

use std::collections::VecDeque;

use pipeline::message::Message;
use serde::Serialize;

use crate::{
    failure::Failure,
    recording::{
        cdr,
        schema::Column,
        typed::{Typed, columns},
    },
};

/// Messages at the beginning that tell what all messages of a channel have in common.
pub const FIRST: usize = 3;

/// The first field that was not computed as it was recorded.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Channel of the message.
    pub channel: &'static str,
    /// Tick of the message.
    pub tick: u64,
    /// Axis of the field; none for a field of the whole message.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<String>,
    /// The field, as in the tables of `export --channel`.
    pub field: String,
    /// Its value in the recording.
    pub recorded: String,
    /// Its value now.
    pub replayed: String,
}

/// What all channels share.
#[derive(Debug)]
pub struct Shared {
    /// Names of the axes.
    pub axes: Vec<String>,
    /// Lower half of the fingerprint of the machine that the messages are about.
    pub machine: u32,
}

/// The messages of one channel, as they must be.
pub struct Channel<M: Message> {
    columns: Vec<Column>,
    /// Life of the publisher.
    session: u64,
    /// Number of the next message.
    number: u64,
    /// The message that was computed, as CDR.
    bytes: Vec<u8>,
    of: std::marker::PhantomData<M>,
}

impl<M: Message> Channel<M> {
    /// Before the first of the `waiting` messages. Most of the first few tell the life of their publisher: one of them
    /// may be wrong.
    ///
    /// # Errors
    /// None: the schema of today is sound.
    pub fn new(waiting: &VecDeque<Typed<M>>) -> Result<Self, Failure> {
        let columns = columns::<M>().map_err(Failure::run)?;
        let session = most(waiting.iter().take(FIRST).map(|typed| typed.message.header().session));
        Ok(Self { columns, session, number: 0, bytes: Vec::new(), of: std::marker::PhantomData })
    }

    /// Number of messages that were compared.
    pub fn count(&self) -> u64 {
        self.number
    }

    /// The first difference between a recorded message and the one that was computed. What the publisher fills in is
    /// completed here.
    pub fn compare(&mut self, mut replayed: M, recorded: &Typed<M>, tick: u64, shared: &Shared) -> Option<Difference> {
        self.complete(&mut replayed, recorded, shared);
        self.number += 1;
        self.difference(recorded, tick, shared)
    }

    /// As [`Self::compare`], where any of several messages may be the one: none if one of them is equal.
    pub fn compare_any(
        &mut self,
        candidates: impl IntoIterator<Item = M>,
        recorded: &Typed<M>,
        tick: u64,
        shared: &Shared,
    ) -> Option<Difference> {
        let mut first = None;
        for mut replayed in candidates {
            self.complete(&mut replayed, recorded, shared);
            let difference = self.difference(recorded, tick, shared);
            if difference.is_none() {
                first = None;
                break;
            }
            first = first.or(difference);
        }
        self.number += 1;
        first
    }

    fn complete(&mut self, replayed: &mut M, recorded: &Typed<M>, shared: &Shared) {
        let of_recorded = recorded.message.header();
        let header = replayed.header_mut();
        header.sent_ns = of_recorded.sent_ns;
        header.number = self.number;
        (header.session, header.machine) = (self.session, shared.machine);
        cdr::encode(replayed, &mut self.bytes);
    }

    fn difference(&self, recorded: &Typed<M>, tick: u64, shared: &Shared) -> Option<Difference> {
        if self.bytes == recorded.bytes {
            return None;
        }
        let value = |column: &Column, bytes: &[u8]| match column.value(bytes) {
            Some(value) if value.to_string() == "NaN" => format!("NaN ({:02x?})", &bytes[column.bytes()]),
            Some(value) => value.to_string(),
            None => "nothing".to_owned(),
        };
        let differs = |column: &&Column| recorded.bytes.get(column.bytes()) != self.bytes.get(column.bytes());
        let (channel, of_axis) = (M::CHANNEL, |field: &str| axis(field, &shared.axes));
        Some(match self.columns.iter().find(differs) {
            Some(column) => Difference {
                channel,
                tick,
                axis: of_axis(&column.name),
                field: column.name.clone(),
                recorded: value(column, &recorded.bytes),
                replayed: value(column, &self.bytes),
            },
            None => padding(channel, tick, &recorded.bytes, &self.bytes),
        })
    }
}

/// The value that most messages have; 0 without a message.
pub fn most<T: Copy + Ord + Default>(values: impl Iterator<Item = T>) -> T {
    let mut values: Vec<T> = values.collect();
    values.sort_unstable();
    let runs = values.chunk_by(T::eq);
    runs.max_by_key(|run| run.len()).and_then(|run| run.first().copied()).unwrap_or_default()
}

/// A difference in bytes that belong to no field.
fn padding(channel: &'static str, tick: u64, recorded: &[u8], replayed: &[u8]) -> Difference {
    let at = recorded.iter().zip(replayed).position(|(recorded, replayed)| recorded != replayed);
    let byte = |bytes: &[u8]| match at {
        Some(at) => bytes[at].to_string(),
        None => format!("{} bytes", bytes.len()),
    };
    Difference {
        channel,
        tick,
        axis: None,
        field: at.map_or("length".to_owned(), |at| format!("byte {at} between the fields")),
        recorded: byte(recorded),
        replayed: byte(replayed),
    }
}

/// Name of the axis that a field belongs to.
fn axis(field: &str, axes: &[String]) -> Option<String> {
    let (_, rest) = field.split_once('[')?;
    let (index, _) = rest.split_once(']')?;
    axes.get(index.parse::<usize>().ok()?).cloned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::message::EncoderSample;

    #[test]
    fn every_bit_but_those_of_the_time_of_sending_makes_a_difference_that_is_named() {
        let mut message = EncoderSample::default();
        (message.header.axis_count, message.header.machine) = (4, 77);
        message.axes[1].piston_pressure = f64::NAN;
        let mut bytes = Vec::new();
        cdr::encode(&message, &mut bytes);
        let columns = columns::<EncoderSample>().unwrap();
        let first = VecDeque::from([Typed { message, bytes: bytes.clone() }]);
        let shared = Shared { axes: ["boom", "arm"].map(str::to_owned).into(), machine: 77 };
        let of = |byte: usize| columns.iter().find(|column| column.bytes().contains(&byte));
        let mut named = 0;
        for bit in 0..8 * bytes.len() {
            let mut channel = Channel::new(&first).unwrap();
            assert_eq!(channel.compare(message, &first[0], 0, &shared), None);
            let mut next = message;
            next.header.number = 1;
            let mut recorded = Vec::new();
            cdr::encode(&next, &mut recorded);
            recorded[bit / 8] ^= 1 << (bit % 8);
            let Some(read) = cdr::decode(&recorded) else {
                assert!(bit / 8 < 4);
                continue;
            };
            let difference = channel.compare(message, &Typed { message: read, bytes: recorded }, 9, &shared);
            let field = of(bit / 8).map(|column| column.name.as_str());
            match (difference, field) {
                (None, Some("header.sent_ns")) => {}
                (Some(difference), Some(field)) => {
                    assert_eq!((difference.field.as_str(), difference.tick), (field, 9));
                    assert_ne!(difference.recorded, difference.replayed, "{field}");
                    assert_eq!(
                        difference.axis.as_deref(),
                        field
                            .starts_with("axes[1]")
                            .then_some("arm")
                            .or(field.starts_with("axes[0]").then_some("boom"))
                    );
                    named += 1;
                }
                other => panic!("bit {bit}: {other:?}"),
            }
        }
        assert_eq!(named, 8 * (bytes.len() - 4 - 8));
    }
}
