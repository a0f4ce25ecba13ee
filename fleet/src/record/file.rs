//! A recording of one machine: MCAP, compressed by zstd.
//!
//! | topic | holds |
//! |---|---|
//! | a key behind the machine, such as `telemetry/encoder-sample` | messages that were fresh when they came |
//! | `late/` and the key | messages that were older than the limit, or still to come, by the clocks |
//! | `recorder` | what is missing and why, and the runs of the bridge, as JSON |
//!
//! The log time is when a message came to the site, the publish time that of its stamp, by the clock of the machine;
//! the sequence is the lower half of its number. The run of a message is that of the last `run` before it.

use std::{
    collections::BTreeMap,
    fs::{self, File, OpenOptions},
    io::BufWriter,
    os::unix::fs::OpenOptionsExt,
    path::{Path, PathBuf},
    time::Instant,
};

use mcap::{
    Compression, McapError, McapResult, WriteOptions, Writer,
    records::{MessageHeader, Metadata},
};
use serde::Serialize;

use crate::{content::Schema, stamp::Stamp};

/// Begin of the topics of late messages.
pub const LATE: &str = "late/";
/// Topic of what the recorder itself says, and the name of its schema.
pub const RECORDER: &str = "recorder";
const NOTE: &str = "hydraxis/recorder/1";
/// Names of the records of facts at the beginning and at the end, as in all recordings of Hydraxis.
const FACTS: &str = "hydraxis";
const END_FACTS: &str = "hydraxis.end";
/// Level of zstd: the first one takes the least memory for each open file.
const LEVEL: u32 = 1;

/// Facts by name.
pub type Facts = BTreeMap<String, String>;

/// A message as it will be in a file.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Its topic.
    pub topic: String,
    /// Its stamp.
    pub stamp: Stamp,
    /// When it came, ns since 1970.
    pub at_ns: i64,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// What the recorder says in a file.
#[derive(Debug, Serialize)]
#[serde(tag = "what", rename_all = "kebab-case")]
pub enum Note<'a> {
    /// The messages from here on are of this life of the bridge.
    Run {
        /// Its number.
        run: u64,
    },
    /// Numbers of a key that were never received, from the first to the last.
    Gap {
        /// The key.
        key: &'a str,
        /// Life of the bridge.
        run: u64,
        /// The first missing number.
        first: u64,
        /// The last one.
        last: u64,
    },
    /// Messages that the recorder had no room for. They are among the gaps.
    Dropped {
        /// How many.
        count: u64,
    },
    /// Messages that the disk did not take, since the file before.
    Unwritten {
        /// How many.
        count: u64,
    },
    /// Messages that were refused since the last such note, by cause.
    Refused {
        /// For their encoding.
        unknown: u64,
        /// For their length.
        malformed: u64,
        /// They were there before, or are of a run that is over.
        repeated: u64,
    },
}

impl Note<'_> {
    /// As a message of this time.
    pub fn entry(&self, at_ns: i64) -> Entry {
        // It is numbers and a text, which JSON always takes.
        let bytes = serde_json::to_vec(self).unwrap_or_default();
        let stamp = Stamp { run: 0, number: 0, utc_ns: at_ns, clock_error_ns: 0 };
        Entry { topic: RECORDER.to_owned(), stamp, at_ns, bytes }
    }
}

/// A file that is being written.
pub struct RecordingFile {
    writer: Writer<BufWriter<File>>,
    path: PathBuf,
    /// Its length when it was flushed, bytes.
    length: u64,
    begun: Instant,
    channels: BTreeMap<String, u16>,
    /// Run of the last message.
    run: Option<u64>,
    /// Names of the axes that it holds already.
    axes: Vec<String>,
}

impl RecordingFile {
    /// Creates a new file that only its owner can read.
    ///
    /// # Errors
    /// The file exists, or it cannot be written.
    pub fn create(path: &Path, facts: Facts) -> McapResult<Self> {
        let file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?;
        // On a full disk a file can be made, and not be written.
        Self::begin(file, path, facts).inspect_err(|_| _ = fs::remove_file(path))
    }

    fn begin(file: File, path: &Path, facts: Facts) -> McapResult<Self> {
        // The profile of ROS 2 allows no JSON, so there is none.
        let options = WriteOptions::new().compression(Some(Compression::Zstd)).compression_level(LEVEL);
        let options = options.compression_threads(0).library(concat!("hydraxis-fleet ", env!("CARGO_PKG_VERSION")));
        let mut file = Self {
            writer: options.create(BufWriter::new(file))?,
            path: path.to_owned(),
            length: 0,
            begun: Instant::now(),
            channels: BTreeMap::new(),
            run: None,
            axes: Vec::new(),
        };
        file.facts(FACTS, facts)?;
        Ok(file)
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Its length when it was flushed, bytes.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// When it was created.
    pub fn begun(&self) -> Instant {
        self.begun
    }

    /// Topics that it has messages of.
    pub fn topics(&self) -> impl Iterator<Item = &str> {
        self.channels.keys().map(String::as_str)
    }

    /// Writes messages, and flushes them, so that a reader of the file finds them whatever comes.
    ///
    /// # Errors
    /// The file cannot be written, or somebody has removed it.
    pub fn write(&mut self, axes: &[String], entries: &[Entry]) -> McapResult<()> {
        if !axes.is_empty() && axes != self.axes {
            self.axes = axes.to_vec();
            self.facts(FACTS, [("axes".to_owned(), axes.join(" "))].into())?;
        }
        for entry in entries {
            if entry.topic != RECORDER && self.run != Some(entry.stamp.run) {
                let run = entry.stamp.run;
                self.put(&Note::Run { run }.entry(entry.at_ns))?;
                self.run = Some(run);
            }
            self.put(entry)?;
        }
        self.writer.flush()?;
        self.length = fs::metadata(&self.path)?.len();
        Ok(())
    }

    fn put(&mut self, entry: &Entry) -> McapResult<()> {
        let channel_id = match self.channels.get(&entry.topic) {
            Some(channel) => *channel,
            None => self.add(&entry.topic)?,
        };
        let Entry { stamp, at_ns, bytes, .. } = entry;
        let header = MessageHeader {
            channel_id,
            sequence: stamp.number as u32,
            log_time: u64::try_from(*at_ns).unwrap_or(0),
            publish_time: u64::try_from(stamp.utc_ns).unwrap_or(0),
        };
        self.writer.write_to_known_channel(&header, bytes)
    }

    fn add(&mut self, topic: &str) -> McapResult<u16> {
        // Only messages whose key has a schema are recorded, and notes.
        let schema = Schema::of(topic.strip_prefix(LATE).unwrap_or(topic)).unwrap_or_else(|| Schema::of_json(NOTE));
        let id = self.writer.add_schema(&schema.name, schema.encoding, schema.text.as_bytes())?;
        let channel = self.writer.add_channel(id, topic, schema.message_encoding, &BTreeMap::new())?;
        self.channels.insert(topic.to_owned(), channel);
        Ok(channel)
    }

    /// Ends a file that cannot be written any more: it keeps what was flushed, and no part of what came later, so that
    /// what counts as unwritten is not in it.
    pub fn cut(self) {
        let Self { writer, path, length, .. } = self;
        // It tries to write its end.
        drop(writer);
        // A file that cannot be cut either has some messages more.
        let _ = OpenOptions::new().write(true).open(path).and_then(|file| file.set_len(length));
    }

    /// Writes facts that are known at the end, ends the file and waits for the disk.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self, facts: Facts) -> McapResult<()> {
        self.facts(END_FACTS, facts)?;
        self.writer.finish()?;
        let file = self.writer.into_inner().into_inner().map_err(|error| McapError::Io(error.into_error()))?;
        Ok(file.sync_all()?)
    }

    fn facts(&mut self, name: &str, metadata: Facts) -> McapResult<()> {
        self.writer.write_metadata(&Metadata { name: name.to_owned(), metadata })
    }
}
