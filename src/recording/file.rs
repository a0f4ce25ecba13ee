//! A file of messages: MCAP, with CDR and ROS 2 schemas, compressed by zstd.
//!
//! A file begins with the facts that are known then and with the files that are needed to understand it. Messages are
//! in chunks; a chunk that was flushed can be read although the file has no end. Facts that are known at the end only
//! are in a record of their own.

use std::{
    collections::BTreeMap,
    fs::{File, OpenOptions},
    io::{self, BufWriter, Write},
    os::unix::fs::{MetadataExt, OpenOptionsExt},
    path::Path,
};

use mcap::{
    Attachment, Compression, McapError, McapResult, WriteOptions, Writer,
    records::{MessageHeader, Metadata},
};
use pipeline::message::{Header, Message};

use super::{
    END_FACTS, FACTS, Facts, cdr, checksum,
    reading::{ReadChannel, ReadMessage},
};

/// A message as it is in a file.
#[derive(Clone)]
pub struct Encoded {
    /// Name of the channel.
    pub channel: &'static str,
    /// Time at which it was read, ns of `CLOCK_MONOTONIC`.
    pub read_ns: u64,
    /// Its header.
    pub header: Header,
    /// The message as CDR, with its checksum.
    pub bytes: Vec<u8>,
}

impl Encoded {
    /// A message that was read at this time.
    pub fn new<M: Message>(read_ns: u64, message: &M) -> Self {
        let mut bytes = Vec::new();
        cdr::encode(message, &mut bytes);
        checksum::seal(&mut bytes);
        Self { channel: M::CHANNEL, read_ns, header: *message.header(), bytes }
    }
}

/// Why a file cannot be written, without what the library says of every error of the system.
pub fn cause(error: &McapError) -> String {
    if let McapError::Io(error) = error { error.to_string() } else { error.to_string() }
}

/// The error of a file that cannot be created, with what is allowed where there is one already.
fn only_new(error: io::Error) -> io::Error {
    match error.kind() {
        kind @ io::ErrorKind::AlreadyExists => io::Error::new(kind, "found a file; allowed: a new one"),
        _ => error,
    }
}

/// A file that is being written.
pub struct RecordingFile {
    writer: Writer<BufWriter<File>>,
    /// The file once more, for its length.
    file: File,
    /// Its length when it was flushed, bytes.
    length: u64,
    channels: BTreeMap<&'static str, u16>,
    /// What is to be added to `CLOCK_MONOTONIC` for the time since 1970, ns.
    clock_ns: i64,
}

impl RecordingFile {
    /// Creates a new file that only its owner can read. `attached`: names and contents of files.
    ///
    /// # Errors
    /// The file exists, or it cannot be written.
    pub fn create(path: &Path, facts: &Facts, attached: &[(String, Vec<u8>)], clock_ns: i64) -> McapResult<Self> {
        let file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path).map_err(only_new)?;
        // Threads of the compressor would run on the cores of the stages.
        let options = WriteOptions::new().profile("ros2").compression(Some(Compression::Zstd)).compression_threads(0);
        let options = options.library(concat!("hydraxis ", env!("CARGO_PKG_VERSION")));
        let same = file.try_clone()?;
        let writer = options.create(BufWriter::new(file))?;
        let mut file = Self { writer, file: same, length: 0, channels: BTreeMap::new(), clock_ns };
        file.facts(FACTS, facts)?;
        attached.iter().try_for_each(|(name, content)| file.attach(name, content))?;
        Ok(file)
    }

    /// Adds a file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn attach(&mut self, name: &str, content: &[u8]) -> McapResult<()> {
        let media_type = "text/plain".to_owned();
        let (name, data) = (name.to_owned(), content.into());
        self.writer.attach(&Attachment { log_time: 0, create_time: 0, name, media_type, data })
    }

    /// Adds a channel of another recording. Its number in this file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn add_read_channel(&mut self, channel: &ReadChannel) -> McapResult<u16> {
        let [of_schema, of_message] = channel.encodings;
        let schema = self.writer.add_schema(&channel.type_name, of_schema, channel.schema.as_bytes())?;
        self.writer.add_channel(schema, &channel.name, of_message, &BTreeMap::new())
    }

    /// Adds a message of another recording, whose channel has the number `channel_id` in this file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_read(&mut self, channel_id: u16, message: &ReadMessage) -> McapResult<()> {
        let ReadMessage { log_ns, sent_ns, sequence, bytes, .. } = message;
        let header = MessageHeader { channel_id, sequence: *sequence, log_time: *log_ns, publish_time: *sent_ns };
        self.writer.write_to_known_channel(&header, bytes)
    }

    /// Adds a channel, whose messages may follow.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn add_channel<M: Message>(&mut self) -> McapResult<()> {
        self.add(M::CHANNEL, &cdr::type_name::<M>(), &checksum::schema(cdr::schema::<M>()))
    }

    /// Adds a channel with this schema, whose messages may follow.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn add(&mut self, name: &'static str, type_name: &str, schema: &str) -> McapResult<()> {
        let schema = self.writer.add_schema(type_name, "ros2msg", schema.as_bytes())?;
        let channel = self.writer.add_channel(schema, name, "cdr", &BTreeMap::new())?;
        self.channels.insert(name, channel);
        Ok(())
    }

    /// Adds a message of a channel that was added.
    ///
    /// # Errors
    /// The file cannot be written, or its channel was not added.
    pub fn write(&mut self, message: &Encoded) -> McapResult<()> {
        let Some(channel_id) = self.channels.get(message.channel).copied() else {
            return Err(McapError::UnknownChannel(message.header.number as u32, 0));
        };
        let header = MessageHeader {
            channel_id,
            // Messages are numbered with more bits on their channels.
            sequence: message.header.number as u32,
            log_time: message.read_ns.saturating_add_signed(self.clock_ns),
            publish_time: message.header.sent_ns.saturating_add_signed(self.clock_ns),
        };
        self.writer.write_to_known_channel(&header, &message.bytes)
    }

    /// Ends the chunk, so that a reader of the file finds all messages so far. The length of the file, bytes.
    ///
    /// # Errors
    /// The file cannot be written, or somebody has removed it.
    pub fn flush(&mut self) -> McapResult<u64> {
        self.writer.flush()?;
        let data = self.file.metadata()?;
        if data.nlink() == 0 {
            return Err(io::Error::new(io::ErrorKind::NotFound, "the file was removed").into());
        }
        self.length = data.len();
        Ok(self.length)
    }

    /// Ends a file that cannot be written any more: it keeps what was flushed, and no part of what came later, so that
    /// what counts as lost is lost.
    pub fn cut(self) {
        let Self { writer, file, length, .. } = self;
        // It tries to write its end.
        drop(writer);
        // A file that cannot be cut either has some messages more.
        let _ = file.set_len(length);
    }

    /// Writes facts that are known at the end, ends the file and waits for the disk.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self, facts: &Facts) -> McapResult<()> {
        if !facts.is_empty() {
            self.facts(END_FACTS, facts)?;
        }
        self.writer.finish()?;
        self.writer.into_inner().flush()?;
        Ok(self.file.sync_all()?)
    }

    fn facts(&mut self, name: &str, facts: &Facts) -> McapResult<()> {
        self.writer.write_metadata(&Metadata { name: name.to_owned(), metadata: facts.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::message::EncoderSample;

    #[test]
    fn a_file_that_somebody_removes_is_an_error_with_the_next_flush() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let mut file = RecordingFile::create(&path, &Facts::new(), &[], 0).unwrap();
        file.add_channel::<EncoderSample>().unwrap();
        assert!(file.flush().unwrap() > 0);
        std::fs::remove_file(&path).unwrap();
        file.write(&Encoded::new(0, &EncoderSample::default())).unwrap();
        assert!(matches!(file.flush(), Err(McapError::Io(error)) if error.kind() == io::ErrorKind::NotFound));
    }

    #[test]
    fn a_file_that_is_cut_has_what_was_flushed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let mut file = RecordingFile::create(&path, &Facts::new(), &[], 0).unwrap();
        file.add_channel::<EncoderSample>().unwrap();
        let write = |file: &mut RecordingFile, count: usize| {
            (0..count).for_each(|_| file.write(&Encoded::new(0, &EncoderSample::default())).unwrap());
        };
        write(&mut file, 10);
        let length = file.flush().unwrap();
        write(&mut file, 10_000);
        file.cut();
        assert_eq!(std::fs::metadata(&path).unwrap().len(), length);
    }
}
