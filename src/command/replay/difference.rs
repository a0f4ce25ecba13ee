//! Two messages that should be equal, compared byte by byte, and the first field in which they are not.
//!
//! A time of a clock, such as `header.sent_ns`, is computed by no replay. Such a field, and all fields of a message
//! that is not computed, are compared with the [checksum] of the message.

use std::collections::VecDeque;

use pipeline::message::Message;
use serde::Serialize;

use crate::{
    failure::Failure,
    recording::{
        cdr, checksum,
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
    pub channel: String,
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
    /// Where that is from.
    pub by: By,
}

/// What says that a field is another one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum By {
    /// The message was computed.
    Replay,
    /// The checksum of the message, which is not computed.
    Checksum,
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
        checksum::seal(&mut self.bytes);
    }

    fn difference(&self, recorded: &Typed<M>, tick: u64, shared: &Shared) -> Option<Difference> {
        if self.bytes == recorded.bytes {
            return None;
        }
        let place = Place { channel: M::CHANNEL.to_owned(), tick, axes: &shared.axes };
        let found = first(&place, &self.columns, &recorded.bytes, &self.bytes, By::Replay);
        // Only a time of a clock has another value then.
        let by_checksum = if found.field == CHECKSUM { damage(&place, &self.columns, &recorded.bytes) } else { None };
        Some(by_checksum.unwrap_or(found))
    }
}

/// The field behind all others.
pub const CHECKSUM: &str = "checksum";

/// Where two messages differ.
pub struct Place<'a> {
    /// Channel of the message.
    pub channel: String,
    /// Its tick.
    pub tick: u64,
    /// Names of the axes.
    pub axes: &'a [String],
}

/// The field that a message does not have as it was sealed; none for a whole message.
pub fn damage(place: &Place<'_>, columns: &[Column], recorded: &[u8]) -> Option<Difference> {
    if checksum::is_whole(recorded) {
        return None;
    }
    if let Some(mended) = checksum::mended(recorded) {
        return Some(first(place, columns, recorded, &mended, By::Checksum));
    }
    let (field, more) = ("message".to_owned(), "another one, in more than one bit".to_owned());
    let recorded = format!("{} bytes", recorded.len());
    let (channel, tick) = (place.channel.clone(), place.tick);
    Some(Difference { channel, tick, axis: None, field, recorded, replayed: more, by: By::Checksum })
}

/// The first field in which two messages differ.
fn first(place: &Place<'_>, columns: &[Column], recorded: &[u8], other: &[u8], by: By) -> Difference {
    let value = |column: &Column, bytes: &[u8]| match column.value(bytes) {
        Some(value) if value.to_string() == "NaN" => format!("NaN ({:02x?})", &bytes[column.bytes()]),
        Some(value) => value.to_string(),
        None => "nothing".to_owned(),
    };
    let differs = |column: &&Column| recorded.get(column.bytes()) != other.get(column.bytes());
    match columns.iter().find(differs) {
        Some(column) => Difference {
            channel: place.channel.clone(),
            tick: place.tick,
            axis: axis(&column.name, place.axes),
            field: column.name.clone(),
            recorded: value(column, recorded),
            replayed: value(column, other),
            by,
        },
        None => padding(place, recorded, other, by),
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
fn padding(place: &Place<'_>, recorded: &[u8], replayed: &[u8], by: By) -> Difference {
    let at = recorded.iter().zip(replayed).position(|(recorded, replayed)| recorded != replayed);
    let byte = |bytes: &[u8]| match at {
        Some(at) => bytes[at].to_string(),
        None => format!("{} bytes", bytes.len()),
    };
    Difference {
        channel: place.channel.clone(),
        tick: place.tick,
        axis: None,
        field: at.map_or("length".to_owned(), |at| format!("byte {at} between the fields")),
        recorded: byte(recorded),
        replayed: byte(replayed),
        by,
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
    fn every_bit_makes_a_difference_that_is_named() {
        let mut message = EncoderSample::default();
        (message.header.axis_count, message.header.machine) = (4, 77);
        message.axes[1].piston_pressure = f64::NAN;
        let mut bytes = Vec::new();
        cdr::encode(&message, &mut bytes);
        checksum::seal(&mut bytes);
        let columns = columns::<EncoderSample>().unwrap();
        let first = VecDeque::from([Typed { message, bytes: bytes.clone() }]);
        let shared = Shared { axes: ["boom", "arm"].map(str::to_owned).into(), machine: 77 };
        let of = |byte: usize| columns.iter().find(|column| column.bytes().contains(&byte));
        for bit in 8 * cdr::ENCAPSULATION.len()..8 * bytes.len() {
            let mut channel = Channel::new(&first).unwrap();
            assert_eq!(channel.compare(message, &first[0], 0, &shared), None);
            let mut next = message;
            next.header.number = 1;
            let mut recorded = Vec::new();
            cdr::encode(&next, &mut recorded);
            checksum::seal(&mut recorded);
            recorded[bit / 8] ^= 1 << (bit % 8);
            let read = cdr::decode(&recorded).unwrap();
            let difference = channel.compare(message, &Typed { message: read, bytes: recorded }, 9, &shared);
            let difference = difference.unwrap_or_else(|| panic!("bit {bit}"));
            let field = of(bit / 8).unwrap().name.as_str();
            assert_eq!((difference.field.as_str(), difference.tick), (field, 9));
            assert_ne!(difference.recorded, difference.replayed, "{field}");
            let is_time = ["header.sent_ns", CHECKSUM].contains(&field);
            assert_eq!(difference.by, if is_time { By::Checksum } else { By::Replay }, "{field}");
            let axis = [("axes[0]", "boom"), ("axes[1]", "arm")].iter().find(|(array, _)| field.starts_with(array));
            assert_eq!(difference.axis.as_deref(), axis.map(|(_, name)| *name));
        }
    }
}
