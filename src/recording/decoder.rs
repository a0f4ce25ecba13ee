//! Messages of a recording as structs of this version.
//!
//! Numbers are found by their names, so that another version may have more or fewer of them. A number that the
//! recording does not have, or has in another type, stays as it is in a default message.

use std::{collections::BTreeMap, marker::PhantomData, rc::Rc};

use pipeline::{layout::Source, message::Message};

use super::{
    cdr,
    reading::{ReadChannel, ReadMessage},
    schema::{self, Column},
};

/// Decodes the messages of one channel.
pub struct Decoder<M> {
    /// Numbers of `M`, in the order of its fields.
    own: Vec<Column>,
    /// The channel of the last message, for which the numbers were looked up.
    channel: Option<Rc<ReadChannel>>,
    /// Where each number of `M` is in a message of that channel.
    found: Vec<Option<Column>>,
    message: PhantomData<M>,
}

impl<M: Message> Decoder<M> {
    /// A decoder for any recording.
    pub fn new() -> Self {
        // The schema of a message of this version can be read; a test reads all of them.
        let own = schema::columns(&cdr::schema::<M>()).unwrap_or_default();
        Self { own, channel: None, found: Vec::new(), message: PhantomData }
    }

    /// The message, if it is one of this channel.
    pub fn decode(&mut self, read: &ReadMessage) -> Option<M> {
        if read.channel.name != M::CHANNEL {
            return None;
        }
        if !self.channel.as_ref().is_some_and(|channel| Rc::ptr_eq(channel, &read.channel)) {
            let there: BTreeMap<&str, &Column> =
                read.channel.columns.iter().map(|column| (column.name.as_str(), column)).collect();
            let find = |own: &Column| there.get(own.name.as_str()).filter(|found| found.is_like(own)).copied().cloned();
            self.found = self.own.iter().map(find).collect();
            self.channel = Some(Rc::clone(&read.channel));
        }
        let mut message = M::default();
        message.fill(&mut Numbers { columns: self.found.iter(), bytes: &read.bytes });
        Some(message)
    }
}

/// The numbers of a message, one after the other.
struct Numbers<'a> {
    columns: std::slice::Iter<'a, Option<Column>>,
    bytes: &'a [u8],
}

impl Source for Numbers<'_> {
    fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.columns.next()?.as_ref()?.bytes(self.bytes)
    }
}

#[cfg(test)]
mod tests {
    use pipeline::{
        layout::Layout,
        message::{
            CoefficientSnapshot, EncoderReading, EncoderSample, MachineState, Reference, Request, StageHealth,
            ValveCommand,
        },
    };

    use super::*;

    fn read<M: Message>(message: &M, schema: &str) -> ReadMessage {
        let mut bytes = Vec::new();
        cdr::encode(message, &mut bytes);
        let channel = ReadChannel {
            name: M::CHANNEL.to_owned(),
            type_name: cdr::type_name::<M>(),
            schema: schema.to_owned(),
            columns: schema::columns(schema).unwrap(),
        };
        ReadMessage { channel: Rc::new(channel), log_ns: 0, sent_ns: 0, sequence: 0, bytes }
    }

    /// A message without a zero: the bytes of all its numbers are counted up.
    struct Counter(u8);

    impl Source for Counter {
        fn number<const N: usize>(&mut self) -> Option<[u8; N]> {
            self.0 = self.0 % 100 + 1;
            Some([self.0; N])
        }
    }

    fn expect_whole<M: Message + PartialEq>() {
        let mut message = M::default();
        message.fill(&mut Counter(0));
        let decoded = Decoder::<M>::new().decode(&read(&message, &cdr::schema::<M>()));
        assert!(decoded == Some(message), "{}", M::CHANNEL);
        assert!(message != M::default());
    }

    #[test]
    fn every_message_comes_back_whole() {
        expect_whole::<EncoderReading>();
        expect_whole::<EncoderSample>();
        expect_whole::<ValveCommand>();
        expect_whole::<CoefficientSnapshot>();
        expect_whole::<Reference>();
        expect_whole::<Request>();
        expect_whole::<StageHealth>();
        expect_whole::<MachineState>();
    }

    #[test]
    fn a_number_under_another_name_or_of_another_type_is_not_taken() {
        let mut sample = EncoderSample::default();
        sample.fill(&mut Counter(0));
        let schema = cdr::schema::<EncoderSample>().replacen("float64 position", "float64 place", 1);
        let decoded = Decoder::<EncoderSample>::new().decode(&read(&sample, &schema)).unwrap();
        assert_eq!((decoded.axes[3].position, decoded.axes[3].velocity), (0.0, sample.axes[3].velocity));
        let schema = cdr::schema::<EncoderSample>().replacen("float64 position", "int64 position", 1);
        let decoded = Decoder::<EncoderSample>::new().decode(&read(&sample, &schema)).unwrap();
        assert_eq!((decoded.axes[3].position, decoded.axes[3].faults), (0.0, sample.axes[3].faults));
        assert!(Decoder::<ValveCommand>::new().decode(&read(&sample, &schema)).is_none());
    }
}
