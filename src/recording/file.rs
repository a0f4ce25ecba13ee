//! A file of messages: MCAP, with CDR and ROS 2 schemas, compressed by zstd.

use std::{
    collections::BTreeMap,
    fs::{File, OpenOptions},
    io::{BufWriter, Seek, Write},
    os::unix::fs::OpenOptionsExt,
    path::Path,
};

use mcap::{
    Compression, McapResult, WriteOptions, Writer,
    records::{MessageHeader, Metadata},
};
use pipeline::message::Message;

use super::{cdr, tape::Strip};

/// Facts about a recording, by name.
pub type Facts = BTreeMap<String, String>;

/// The messages of one channel, of any type.
pub trait Messages: Send {
    /// Writes them all. `clock_ns` is what is to be added to `CLOCK_MONOTONIC` for the time since 1970, ns.
    fn write(&self, writer: &mut McapWriter, clock_ns: i64) -> McapResult<()>;
    /// Name of the channel, messages in it, and messages that were lost before they came here.
    fn counts(&self) -> (&'static str, usize, u64);
}

type McapWriter = Writer<BufWriter<File>>;

impl<M: Message + Send> Messages for Strip<M> {
    fn write(&self, writer: &mut McapWriter, clock_ns: i64) -> McapResult<()> {
        let schema = writer.add_schema(&cdr::type_name::<M>(), "ros2msg", cdr::schema::<M>().as_bytes())?;
        let channel_id = writer.add_channel(schema, M::CHANNEL, "cdr", &BTreeMap::new())?;
        let mut bytes = Vec::new();
        for (read_ns, message) in &self.messages {
            cdr::encode(message, &mut bytes);
            let header = message.header();
            let header = MessageHeader {
                channel_id,
                // Messages are numbered with more bits on their channels.
                sequence: header.number as u32,
                log_time: read_ns.saturating_add_signed(clock_ns),
                publish_time: header.sent_ns.saturating_add_signed(clock_ns),
            };
            writer.write_to_known_channel(&header, &bytes)?;
        }
        Ok(())
    }

    fn counts(&self) -> (&'static str, usize, u64) {
        (M::CHANNEL, self.messages.len(), self.lost)
    }
}

/// Writes a new file that only its owner can read.
///
/// # Errors
/// The file exists, or it cannot be written.
pub fn write(path: &Path, facts: Facts, clock_ns: i64, channels: &[Box<dyn Messages>]) -> McapResult<()> {
    let file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?;
    let written = fill(BufWriter::new(file), facts, clock_ns, channels);
    if written.is_err() {
        // Half a file explains nothing; the disk may be full.
        let _ = std::fs::remove_file(path);
    }
    written
}

fn fill(file: BufWriter<File>, mut facts: Facts, clock_ns: i64, channels: &[Box<dyn Messages>]) -> McapResult<()> {
    // Threads of the compressor would run on the cores of the stages.
    let options = WriteOptions::new().profile("ros2").compression(Some(Compression::Zstd)).compression_threads(0);
    let mut writer = options.library(concat!("hydraxis ", env!("CARGO_PKG_VERSION"))).create(file)?;
    for channel in channels {
        channel.write(&mut writer, clock_ns)?;
        let (name, _, lost) = channel.counts();
        facts.insert(format!("{name} lost"), lost.to_string());
    }
    writer.write_metadata(&Metadata { name: "hydraxis".to_owned(), metadata: facts })?;
    writer.finish()?;
    let mut file = writer.into_inner();
    file.flush()?;
    file.rewind()?;
    Ok(file.get_ref().sync_all()?)
}
