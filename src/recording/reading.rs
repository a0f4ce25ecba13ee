//! Reads recordings and black boxes, whole or damaged, from the first byte to the last one.
//!
//! A file that was cut by a kill, a loss of power or a full disk has no end: all chunks that were flushed are there.
//! What comes behind a damaged place is not read, because nothing says where the next record begins.
//!
//! Everything that is kept of a file is bounded, since a small compressed file can hold any amount.
//!
//! Trap: the index at the end of a file is not used, since a cut file has none. So a file is read from its beginning.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, Read},
    path::{Path, PathBuf},
    rc::Rc,
};

use mcap::{
    McapError,
    records::{Record, op},
    sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions},
};
use pipeline::message::{CoefficientSnapshot, Message};
use thiserror::Error;

use super::{
    END_FACTS, FACTS, Facts, axes_in,
    schema::{self, Column, SchemaError, Value},
};

/// Longest record and chunk, bytes: a file could ask for any length.
const LONGEST: usize = 64 << 20;
/// Most schemas and most channels of a file: many times those of a recording.
const MOST_CHANNELS: usize = 256;
/// Most bytes of all schemas, facts and attached files together, and most columns of all channels.
const MOST_BYTES: usize = 64 << 20;
const MOST_COLUMNS: usize = 300_000;
/// Bytes that are read at once.
const PIECE: usize = 1 << 20;

/// Why a file is no recording.
#[derive(Debug, Error)]
pub enum ReadingError {
    /// The system does not read it.
    #[error("{}: cannot be read: {source}", .path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// It is something else.
    #[error("{}: found no MCAP file; allowed: one that `hydraxis record` or `hydraxis run` has written", .0.display())]
    Foreign(PathBuf),
    /// A channel has another encoding, or a schema that no message has.
    #[error("{}: byte {byte}: channel \"{channel}\": {what}", .path.display())]
    Channel {
        /// The file.
        path: PathBuf,
        /// Bytes of the file that had been read.
        byte: u64,
        /// Name of the channel.
        channel: String,
        /// What is wrong.
        what: ChannelProblem,
    },
}

/// Why the messages of a channel cannot be read.
#[derive(Debug, Error)]
pub enum ChannelProblem {
    /// It is neither CDR with a schema of ROS 2 nor JSON with one of JSON.
    #[error("found the encoding \"{found}\"; allowed: cdr with a schema in ros2msg, json with one in jsonschema")]
    Encoding {
        /// Encoding of message or schema.
        found: String,
    },
    /// The schema is no text.
    #[error("found a schema that is no UTF-8")]
    NoText,
    /// The schema is of no message.
    #[error("schema: {0}")]
    Schema(#[from] SchemaError),
}

/// Why a file ends before its end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Bytes of the file that had been read.
    pub byte: u64,
    /// What was found there.
    pub what: String,
    /// Nothing is wrong but that the rest is missing, as after a kill.
    pub is_cut: bool,
}

/// Encodings of the schema and of a message.
type Encodings = [&'static str; 2];
/// Messages of a group.
pub const CDR: Encodings = ["ros2msg", "cdr"];
/// What a recorder at a site writes beside them.
const JSON: Encodings = ["jsonschema", "json"];

/// A channel of a recording.
#[derive(Debug)]
pub struct ReadChannel {
    /// Its name.
    pub name: String,
    /// Encodings of its schema and of its messages.
    pub encodings: Encodings,
    /// Name of the type of its messages.
    pub type_name: String,
    /// Its schema as text.
    pub schema: String,
    /// What a message has; nothing where it is JSON.
    pub columns: Vec<Column>,
}

impl ReadChannel {
    /// Whether it has the messages of a channel of the group, under its name or under the key of the network.
    pub fn carries(&self, channel: &str) -> bool {
        match self.name.as_str() {
            "model" => channel == CoefficientSnapshot::CHANNEL,
            name => name.strip_prefix("telemetry/").unwrap_or(name) == channel,
        }
    }

    /// The column of this name.
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }
}

/// A message of a recording.
#[derive(Debug)]
pub struct ReadMessage {
    /// Its channel.
    pub channel: Rc<ReadChannel>,
    /// When it was read from the channel, ns since 1970.
    pub log_ns: u64,
    /// When it was sent, ns since 1970.
    pub sent_ns: u64,
    /// Lower half of its number.
    pub sequence: u32,
    /// The message as CDR.
    pub bytes: Vec<u8>,
}

/// Some numbers of the messages of one channel, by the names of their columns.
#[derive(Debug, Default)]
pub struct Picked {
    names: Vec<String>,
    /// The channel of the last message, for which the columns were looked up.
    channel: Option<Rc<ReadChannel>>,
    columns: Vec<Option<Column>>,
}

impl Picked {
    /// The numbers with these names.
    pub fn new(names: impl IntoIterator<Item = String>) -> Self {
        Self { names: names.into_iter().collect(), channel: None, columns: Vec::new() }
    }

    /// Their values in a message, in the order of the names; none where the message has no such number.
    pub fn values(&mut self, message: &ReadMessage) -> impl Iterator<Item = Option<Value>> {
        if !self.channel.as_ref().is_some_and(|channel| Rc::ptr_eq(channel, &message.channel)) {
            self.columns = self.names.iter().map(|name| message.channel.column(name).cloned()).collect();
            self.channel = Some(Rc::clone(&message.channel));
        }
        self.columns.iter().map(|column| column.as_ref()?.value(&message.bytes))
    }
}

/// A recording that is read from its beginning.
pub struct Reading {
    path: PathBuf,
    source: Box<dyn Read>,
    reader: LinearReader,
    /// Bytes that were read.
    bytes: u64,
    /// Bytes of schemas, facts and attached files that are kept.
    kept: usize,
    schemas: BTreeMap<u16, (String, String, Vec<u8>)>,
    channels: BTreeMap<u16, Rc<ReadChannel>>,
    /// Facts of the beginning and of the end.
    facts: Facts,
    attached: Vec<(String, Vec<u8>)>,
    damage: Option<Damage>,
    is_over: bool,
}

impl Reading {
    /// Opens a file.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn open(path: &Path) -> Result<Self, ReadingError> {
        let file = File::open(path).map_err(|source| ReadingError::Io { path: path.to_owned(), source })?;
        Ok(Self::of(path, file))
    }

    /// Reads from any source; `path` stands in the messages.
    pub fn of(path: &Path, source: impl Read + 'static) -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LONGEST);
        Self {
            path: path.to_owned(),
            source: Box::new(source),
            reader: LinearReader::new_with_options(options),
            bytes: 0,
            kept: 0,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            facts: Facts::new(),
            attached: Vec::new(),
            damage: None,
            is_over: false,
        }
    }

    /// The next message; none at the end, or at a damaged place.
    ///
    /// # Errors
    /// The system does not read the file, it is no recording, or a channel has messages that Hydraxis cannot read.
    pub fn next(&mut self) -> Result<Option<ReadMessage>, ReadingError> {
        while !self.is_over {
            if let Some(message) = self.step()? {
                return Ok(Some(message));
            }
        }
        Ok(None)
    }

    /// Facts that were read so far.
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Names and contents of the attached files that were read so far.
    pub fn attached(&self) -> &[(String, Vec<u8>)] {
        &self.attached
    }

    /// The channels that were read so far.
    pub fn channels(&self) -> impl Iterator<Item = &Rc<ReadChannel>> {
        self.channels.values()
    }

    /// Why the file ends before its end; none for a whole one.
    pub fn damage(&self) -> Option<&Damage> {
        self.damage.as_ref()
    }

    /// Names of the axes, as far as the file says them.
    pub fn axes(&self) -> Vec<String> {
        axes_in(&self.facts)
    }

    /// One event of the reader.
    fn step(&mut self) -> Result<Option<ReadMessage>, ReadingError> {
        let (opcode, data) = match self.reader.next_event() {
            None => {
                self.end("the file has no end".to_owned(), true);
                return Ok(None);
            }
            Some(Err(error)) => return self.broken(&error).map(|()| None),
            Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                let wanted = wanted.clamp(1, PIECE);
                let read = self.source.read(self.reader.insert(wanted));
                let read = read.map_err(|source| ReadingError::Io { path: self.path.clone(), source })?;
                self.reader.notify_read(read);
                self.bytes += read as u64;
                return Ok(None);
            }
            Some(Ok(LinearReadEvent::Record { opcode, data })) => (opcode, data),
        };
        // The library takes the checksum of an attachment to be there.
        let parsed = match opcode {
            op::ATTACHMENT if !has_checksum(data) => Err(McapError::UnexpectedEof),
            _ => mcap::parse_record(opcode, data).map(Record::into_owned),
        };
        match parsed {
            Ok(record) => self.record(record),
            Err(error) => self.broken(&error).map(|()| None),
        }
    }

    fn record(&mut self, record: Record<'static>) -> Result<Option<ReadMessage>, ReadingError> {
        if !self.keep(&record) {
            return Ok(None);
        }
        match record {
            Record::Schema { header, data } => {
                self.schemas.insert(header.id, (header.name, header.encoding, data.into_owned()));
            }
            Record::Channel(channel) => {
                let encoding = channel.message_encoding;
                let read = self.channel(&channel.topic, &encoding, channel.schema_id);
                let read = read.map_err(|what| ReadingError::Channel {
                    path: self.path.clone(),
                    byte: self.bytes,
                    channel: channel.topic.clone(),
                    what,
                })?;
                self.channels.entry(channel.id).or_insert_with(|| Rc::new(read));
            }
            Record::Message { header, data } => match self.channels.get(&header.channel_id) {
                Some(channel) => {
                    let channel = Rc::clone(channel);
                    let (log_ns, sent_ns, sequence) = (header.log_time, header.publish_time, header.sequence);
                    return Ok(Some(ReadMessage { channel, log_ns, sent_ns, sequence, bytes: data.into_owned() }));
                }
                None => self.end(format!("a message of channel {}, which is not defined", header.channel_id), false),
            },
            Record::Metadata(metadata) if [FACTS, END_FACTS].contains(&metadata.name.as_str()) => {
                self.facts.extend(metadata.metadata);
            }
            Record::Attachment { header, data, .. } => self.attached.push((header.name, data.into_owned())),
            // Behind it is the index, which repeats what was before.
            Record::DataEnd(_) => self.is_over = true,
            _ => {}
        }
        Ok(None)
    }

    /// Whether what is to be kept of a record is within the bounds. A file beyond them ends here.
    fn keep(&mut self, record: &Record<'_>) -> bool {
        self.kept += match record {
            Record::Schema { data, .. } => data.len(),
            Record::Channel(channel) => channel.topic.len(),
            Record::Attachment { header, data, .. } => header.name.len() + data.len(),
            Record::Metadata(metadata) => metadata.metadata.iter().map(|(name, fact)| name.len() + fact.len()).sum(),
            _ => return true,
        };
        let columns: usize = self.channels.values().map(|channel| channel.columns.len()).sum();
        let is_full = self.schemas.len() > MOST_CHANNELS || self.channels.len() > MOST_CHANNELS;
        if is_full || self.kept > MOST_BYTES || columns > MOST_COLUMNS {
            self.end(
                format!(
                    "more than {MOST_CHANNELS} channels, {MOST_COLUMNS} columns, or {MOST_BYTES} bytes of schemas and \
                 attached files"
                ),
                false,
            );
        }
        !self.is_over
    }

    fn channel(&self, name: &str, encoding: &str, schema: u16) -> Result<ReadChannel, ChannelProblem> {
        let unknown = |found: &str| ChannelProblem::Encoding { found: found.to_owned() };
        let encodings = [CDR, JSON].into_iter().find(|[_, message]| *message == encoding);
        let encodings = encodings.ok_or_else(|| unknown(encoding))?;
        let none = (String::new(), String::new(), Vec::new());
        let (type_name, encoding, text) = self.schemas.get(&schema).unwrap_or(&none);
        if encoding != encodings[0] {
            return Err(unknown(encoding));
        }
        let text = std::str::from_utf8(text).map_err(|_| ChannelProblem::NoText)?;
        let columns = if encodings == CDR { schema::columns(text)? } else { Vec::new() };
        let (name, type_name, schema) = (name.to_owned(), type_name.clone(), text.to_owned());
        Ok(ReadChannel { name, encodings, type_name, schema, columns })
    }

    /// Takes in what the reader says: another kind of file is an error, a damaged one ends here.
    fn broken(&mut self, error: &McapError) -> Result<(), ReadingError> {
        if matches!(error, McapError::BadMagic) && self.schemas.is_empty() && self.facts.is_empty() {
            return Err(ReadingError::Foreign(self.path.clone()));
        }
        match error {
            McapError::UnexpectedEof | McapError::UnexpectedEoc => {
                self.end("the file ends within a record".to_owned(), true);
            }
            other => self.end(other.to_string(), false),
        }
        Ok(())
    }

    fn end(&mut self, what: String, is_cut: bool) {
        self.is_over = true;
        self.damage = Some(Damage { byte: self.bytes, what, is_cut });
    }
}

/// Whether an attached file, `record`, is long enough for its times, its name, its kind, its length and a checksum.
fn has_checksum(record: &[u8]) -> bool {
    let text = |at: usize| {
        let length = record.get(at..at + 4)?.try_into().map(u32::from_le_bytes).ok()?;
        Some(at + 4 + length as usize)
    };
    text(16).and_then(text).is_some_and(|end| end + 8 + 4 <= record.len())
}
