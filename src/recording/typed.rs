//! Messages of today's types out of a recording, also out of one that an older version has written.
//!
//! Fields are matched by their names. A field that the recording does not have is zero.

use std::{collections::HashMap, marker::PhantomData};

use pipeline::message::Message;

use super::{
    cdr, checksum,
    reading::ReadChannel,
    schema::{self, Column, SchemaError},
};

/// A message, and its bytes in the recording.
#[derive(Debug, Clone)]
pub struct Typed<M> {
    /// The message.
    pub message: M,
    /// As it was recorded.
    pub bytes: Vec<u8>,
}

/// Reads the messages of one channel.
pub struct Decoder<M> {
    /// Columns of today with those of the recording; none where the schemas are the same.
    pairs: Option<Vec<(Column, Column)>>,
    /// A message of today whose fields are all zero.
    zero: Vec<u8>,
    of: PhantomData<M>,
}

impl<M: Message> Decoder<M> {
    /// Of a channel of a recording.
    ///
    /// # Errors
    /// It has no field of today's messages, as JSON. Else none for a channel that was read: its schema is sound, and so
    /// is today's.
    pub fn new(channel: &ReadChannel) -> Result<Self, SchemaError> {
        let mut zero = Vec::new();
        cdr::encode(&M::default(), &mut zero);
        checksum::seal(&mut zero);
        let pairs = if channel.schema == checksum::schema(cdr::schema::<M>()) {
            None
        } else {
            let recorded: HashMap<&str, &Column> =
                channel.columns.iter().map(|column| (column.name.as_str(), column)).collect();
            let matched = |column: Column| {
                let recorded = recorded.get(column.name.as_str()).copied().filter(|other| column.is_same(other))?;
                Some((column, recorded.clone()))
            };
            let pairs: Vec<(Column, Column)> = columns::<M>()?.into_iter().filter_map(matched).collect();
            if pairs.is_empty() {
                return Err(SchemaError::Foreign);
            }
            Some(pairs)
        };
        Ok(Self { pairs, zero, of: PhantomData })
    }

    /// Whether the recording has the messages of today.
    pub fn is_exact(&self) -> bool {
        self.pairs.is_none()
    }

    /// A message; none where the bytes end before it does.
    pub fn decode(&self, bytes: Vec<u8>) -> Option<Typed<M>> {
        let Some(pairs) = &self.pairs else {
            return Some(Typed { message: cdr::decode(&bytes)?, bytes });
        };
        let mut today = self.zero.clone();
        for (column, recorded) in pairs {
            today[column.bytes()].copy_from_slice(bytes.get(recorded.bytes())?);
        }
        Some(Typed { message: cdr::decode(&today)?, bytes })
    }
}

/// The columns of the messages of today, as they are recorded.
///
/// # Errors
/// None: the schema is sound.
pub fn columns<M: Message>() -> Result<Vec<Column>, SchemaError> {
    schema::columns(&checksum::schema(cdr::schema::<M>()))
}

#[cfg(test)]
mod tests {
    use super::{super::reading::CDR, *};
    use pipeline::message::EncoderSample;

    #[test]
    fn a_message_of_an_older_version_keeps_the_fields_that_there_still_are() {
        let schema = cdr::schema::<EncoderSample>().replace("float64 velocity\n", "").replace("uint64 number\n", "");
        let columns = schema::columns(&schema).unwrap();
        let end = columns.iter().map(|column| column.bytes().end).max().unwrap();
        let mut bytes = vec![0; end];
        bytes[1] = 1;
        let place = |name: &str| columns.iter().find(|column| column.name == name).unwrap().bytes();
        bytes[place("axes[3].position")].copy_from_slice(&0.25f64.to_le_bytes());
        bytes[place("header.acquired_ns")].copy_from_slice(&7u64.to_le_bytes());
        let name = String::new();
        let channel = ReadChannel { name: name.clone(), encodings: CDR, type_name: name, schema, columns };
        let decoder = Decoder::<EncoderSample>::new(&channel).unwrap();
        assert!(!decoder.is_exact());
        let message = decoder.decode(bytes.clone()).unwrap().message;
        assert_eq!((message.axes[3].position, message.header.acquired_ns, message.header.number), (0.25, 7, 0));
        bytes.pop();
        assert!(decoder.decode(bytes).is_none());
    }

    #[test]
    fn a_message_without_any_field_of_today_is_none_of_this_channel() {
        for schema in ["", "float64 other\n"] {
            let columns = if schema.is_empty() { Vec::new() } else { schema::columns(schema).unwrap() };
            let name = EncoderSample::CHANNEL.to_owned();
            let (type_name, schema) = (name.clone(), schema.to_owned());
            let channel = ReadChannel { name, encodings: CDR, type_name, schema, columns };
            assert_eq!(Decoder::<EncoderSample>::new(&channel).err(), Some(SchemaError::Foreign));
        }
    }
}
