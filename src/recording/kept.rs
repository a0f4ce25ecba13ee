//! The last messages of all channels of a group in a file in shared memory, which outlives the supervisor.
//!
//! ```text
//! header, 4 KiB: facts about the run, as JSON
//! for each channel a ring of slots, and in each slot:
//!   CRC-32 of the rest | length of the message | its number | time at which it was read, ns | the message as CDR
//! ```
//!
//! The supervisor alone writes, one slot at a time, and holds a lock on the file until its end. A process that gets
//! the lock knows that the supervisor is dead, and reads what it has left. A slot that was cut by the end of the
//! supervisor has a wrong checksum and is left out.
//!
//! All room is taken when the file is made, so that memory which is full later on changes nothing.
//!
//! Trap: the file cannot lie in the group's folder. The last stage removes that folder, also after the supervisor has
//! died.

use std::{
    fs::{self, File, OpenOptions},
    io,
    os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt},
    path::{Path, PathBuf},
    sync::Arc,
    time::Duration,
};

use pipeline::{channel::Prefix, message::Message};
use rustix::{
    fs::{FallocateFlags, OFlags, fallocate},
    process::geteuid,
};
use serde::{Deserialize, Serialize};

use super::{Facts, cdr};

/// Where the files lie, and the first part of their names.
const PLACE: &str = "/dev/shm";
const NAME: &str = "hydraxis-black-box.";
/// Room for the facts, bytes.
const HEADER: u64 = 4096;
/// Age up to which a file may still be without its first bytes.
const BEING_MADE: Duration = Duration::from_secs(10);
/// Bytes of a slot before the message: checksum, length, number, time.
const BEFORE: usize = 4 + 4 + 8 + 8;
/// Least and most messages that a channel keeps. The most are those of 1 kHz, with a fifth to spare.
const MESSAGES: (u64, u64) = (100, 12_000);
/// Messages that a channel keeps for each period of the span: two programs may send requests.
const PER_PERIOD: f64 = 1.2;

/// What the header says.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// Folder for the black boxes of this run.
    pub folder: PathBuf,
    /// Facts about the run.
    pub facts: Facts,
    /// Least time between two messages of most channels, ns.
    pub period_ns: u64,
}

/// The file of a group whose supervisor lives.
pub struct KeptFile {
    file: Arc<File>,
    path: PathBuf,
    /// Where the next channel begins, bytes.
    end: u64,
    period_ns: u64,
}

impl KeptFile {
    /// Makes the file of this group.
    ///
    /// # Errors
    /// It is there, or shared memory has no room.
    pub fn create(prefix: &Prefix, about: &About) -> io::Result<Self> {
        let path = path(prefix);
        let mut header = serde_json::to_vec(about)?;
        if header.len() as u64 > HEADER {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "the facts about the run need more than 4 KiB"));
        }
        header.resize(HEADER as usize, 0);
        let nofollow = OFlags::NOFOLLOW.bits() as i32;
        let mut options = OpenOptions::new();
        options.read(true).write(true).create_new(true).mode(0o600).custom_flags(nofollow);
        let file = options.open(&path)?;
        let kept = Self { file: Arc::new(file), path, end: HEADER, period_ns: about.period_ns };
        kept.file.lock()?;
        fallocate(&kept.file, FallocateFlags::empty(), 0, HEADER)?;
        kept.file.write_all_at(&header, 0)?;
        Ok(kept)
    }

    /// Adds a channel, whose messages of the last `span` are kept where they are `apart_ns` apart.
    ///
    /// # Errors
    /// Shared memory has no room.
    pub fn add<M: Message>(&mut self, span: Duration, apart_ns: u64) -> io::Result<Ring> {
        let ring = Ring::new::<M>(self.file.clone(), self.end, self.period_ns.max(apart_ns), span);
        fallocate(&self.file, FallocateFlags::empty(), ring.begin, ring.slot * ring.slots)?;
        self.end = ring.begin + ring.slot * ring.slots;
        Ok(ring)
    }
}

impl Drop for KeptFile {
    /// A run that ends has written all of its faults. One that panics has not.
    fn drop(&mut self) {
        if !std::thread::panicking() {
            let _ = fs::remove_file(&self.path);
        }
    }
}

/// A file whose supervisor is dead.
pub struct LeftFile {
    file: Arc<File>,
    path: PathBuf,
    /// What its header says.
    pub about: About,
    end: u64,
}

impl LeftFile {
    /// Opens a file, if its supervisor is dead; then this process has the lock.
    ///
    /// # Errors
    /// It cannot be read, or is not the file of a group.
    pub fn open(path: &Path) -> io::Result<Option<Self>> {
        // Trap: opening a FIFO waits for its writer, and a link leads elsewhere.
        let options = (OFlags::NONBLOCK | OFlags::NOFOLLOW).bits() as i32;
        let file = OpenOptions::new().read(true).custom_flags(options).open(path)?;
        let found = file.metadata()?;
        let foreign = || io::Error::new(io::ErrorKind::PermissionDenied, "the file of another user, or no file");
        if !found.is_file() || found.uid() != geteuid().as_raw() {
            return Err(foreign());
        }
        // Another process may have written it and removed it meanwhile.
        let is_still = || fs::symlink_metadata(path).is_ok_and(|seen| seen.ino() == found.ino());
        if file.try_lock().is_err() || !is_still() {
            return Ok(None);
        }
        let mut header = vec![0; HEADER as usize];
        file.read_exact_at(&mut header, 0)?;
        let end = header.iter().position(|byte| *byte == 0).unwrap_or(header.len());
        let about = serde_json::from_slice(&header[..end])?;
        Ok(Some(Self { file: Arc::new(file), path: path.to_owned(), about, end: HEADER }))
    }

    /// The messages of the next channel, in the order in which [`KeptFile::add`] was called.
    ///
    /// # Errors
    /// The file ends before the channel does.
    pub fn next<M: Message>(&mut self, span: Duration, apart_ns: u64) -> io::Result<Vec<(u64, M)>> {
        let ring = Ring::new::<M>(self.file.clone(), self.end, self.about.period_ns.max(apart_ns), span);
        self.end = ring.begin + ring.slot * ring.slots;
        ring.messages()
    }

    /// Removes the file.
    ///
    /// # Errors
    /// The file cannot be removed.
    pub fn remove(self) -> io::Result<()> {
        fs::remove_file(&self.path)
    }
}

/// Removes what stands in the place of a file and is none. Whether it was removed: not where it belongs to somebody
/// else, and not where a supervisor may be about to write its first bytes.
pub fn remove_unreadable(path: &Path) -> bool {
    let is_old =
        |found: &fs::Metadata| found.modified().is_ok_and(|time| time.elapsed().is_ok_and(|age| age > BEING_MADE));
    fs::symlink_metadata(path).is_ok_and(|found| found.uid() == geteuid().as_raw() && !found.is_dir() && is_old(&found))
        && fs::remove_file(path).is_ok()
}

/// The last messages of one channel.
pub struct Ring {
    file: Arc<File>,
    begin: u64,
    /// Bytes of a slot.
    slot: u64,
    slots: u64,
    /// Number of the next message, from 1 on; an empty slot has 0.
    next: u64,
    /// Messages before this one were taken.
    first: u64,
    span_ns: u64,
    bytes: Vec<u8>,
}

impl Ring {
    fn new<M: Message>(file: Arc<File>, begin: u64, apart_ns: u64, span: Duration) -> Self {
        let mut bytes = Vec::new();
        cdr::encode(&M::default(), &mut bytes);
        let span_ns = span.as_nanos() as u64;
        let slots = (PER_PERIOD * span_ns as f64 / apart_ns.max(1) as f64) as u64;
        let slot = ((BEFORE + bytes.len()) as u64).next_multiple_of(8);
        Self { file, begin, slot, slots: slots.clamp(MESSAGES.0, MESSAGES.1), next: 1, first: 1, span_ns, bytes }
    }

    /// Keeps a message that was read at this time.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write<M: Message>(&mut self, read_ns: u64, message: &M) -> io::Result<()> {
        cdr::encode(message, &mut self.bytes);
        let length = self.bytes.len() as u32;
        let mut slot = Vec::with_capacity(BEFORE + self.bytes.len());
        slot.extend([0; 4]);
        slot.extend(length.to_le_bytes());
        slot.extend(self.next.to_le_bytes());
        slot.extend(read_ns.to_le_bytes());
        slot.extend(&self.bytes);
        let sum = crc32fast::hash(&slot[4..]);
        slot[..4].copy_from_slice(&sum.to_le_bytes());
        self.file.write_all_at(&slot, self.begin + self.slot * (self.next % self.slots))?;
        self.next += 1;
        Ok(())
    }

    /// All whole messages of the span before the last one, the oldest first, with the times at which they were read.
    ///
    /// # Errors
    /// The file cannot be read.
    fn messages<M: Message>(&self) -> io::Result<Vec<(u64, M)>> {
        let mut bytes = vec![0; (self.slot * self.slots) as usize];
        self.file.read_exact_at(&mut bytes, self.begin)?;
        let mut found: Vec<(u64, u64, M)> = bytes.chunks(self.slot as usize).filter_map(read).collect();
        found.retain(|(number, ..)| *number >= self.first);
        found.sort_unstable_by_key(|(number, ..)| *number);
        let last = found.last().map_or(0, |(_, read_ns, _)| *read_ns);
        let is_kept = |read_ns: u64| last.saturating_sub(read_ns) <= self.span_ns;
        Ok(found.into_iter().filter(|one| is_kept(one.1)).map(|(_, read_ns, message)| (read_ns, message)).collect())
    }

    /// Takes all messages of the span; they are not taken again.
    ///
    /// # Errors
    /// The file cannot be read.
    pub fn take<M: Message>(&mut self) -> io::Result<Vec<(u64, M)>> {
        let messages = self.messages()?;
        self.first = self.next;
        Ok(messages)
    }
}

/// Number, time and message of a slot; none where the slot is empty or was cut.
fn read<M: Message>(slot: &[u8]) -> Option<(u64, u64, M)> {
    let (sum, rest) = slot.split_first_chunk::<4>()?;
    let (length, _) = rest.split_first_chunk::<4>()?;
    let rest = rest.get(..BEFORE - 4 + u32::from_le_bytes(*length) as usize)?;
    let (number, after) = rest[4..].split_first_chunk::<8>()?;
    let (read_ns, message) = after.split_first_chunk::<8>()?;
    let [number, read_ns] = [number, read_ns].map(|bytes| u64::from_le_bytes(*bytes));
    let is_whole = number > 0 && crc32fast::hash(rest).to_le_bytes() == *sum;
    is_whole.then(|| cdr::decode(message).map(|message| (number, read_ns, message))).flatten()
}

/// The file of a group.
pub fn path(prefix: &Prefix) -> PathBuf {
    Path::new(PLACE).join(format!("{NAME}{prefix}"))
}

/// The files of all groups of this computer, sorted.
pub fn paths() -> Vec<PathBuf> {
    let is_it = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(NAME));
    let found = fs::read_dir(PLACE).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut found: Vec<PathBuf> = found.filter(is_it).collect();
    found.sort();
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::message::{EncoderSample, ValveCommand};

    const SPAN: Duration = Duration::from_secs(1);

    fn about() -> About {
        About { folder: "/nowhere".into(), facts: Facts::new(), period_ns: 5_000_000 }
    }

    fn sample(number: u64) -> EncoderSample {
        let mut sample = EncoderSample::default();
        (sample.header.number, sample.axes[1].position) = (number, 0.25 * number as f64);
        sample
    }

    fn prefix(name: &str) -> Prefix {
        format!("t{}-{name}", std::process::id()).parse().unwrap()
    }

    #[test]
    fn what_a_dead_supervisor_has_kept_is_read_again_and_only_then() {
        let prefix = prefix("kept");
        let mut kept = KeptFile::create(&prefix, &about()).unwrap();
        let mut samples = kept.add::<EncoderSample>(SPAN, 0).unwrap();
        let mut commands = kept.add::<ValveCommand>(SPAN, 0).unwrap();
        assert!(LeftFile::open(&path(&prefix)).unwrap().is_none(), "its supervisor lives");
        // More than the ring holds, 10 ms apart.
        for number in 1..=600 {
            samples.write(number * 10_000_000, &sample(number)).unwrap();
        }
        commands.write(5, &ValveCommand::default()).unwrap();
        let expected: Vec<(u64, EncoderSample)> = (500..=600).map(|n| (n * 10_000_000, sample(n))).collect();
        assert_eq!(samples.messages::<EncoderSample>().unwrap(), expected);
        // A write that was cut.
        let cut = samples.begin + samples.slot * (600 % samples.slots) + 100;
        kept.file.write_all_at(&[0xff; 16], cut).unwrap();
        // As a process that is killed: its lock ends, and its file stays.
        kept.file.unlock().unwrap();
        let mut left = LeftFile::open(&path(&prefix)).unwrap().unwrap();
        assert_eq!(left.about, about());
        let found: Vec<(u64, EncoderSample)> = left.next(SPAN, 0).unwrap();
        assert_eq!(found, (499..600).map(|n| (n * 10_000_000, sample(n))).collect::<Vec<_>>());
        assert_eq!(left.next::<ValveCommand>(SPAN, 0).unwrap(), [(5, ValveCommand::default())]);
        left.remove().unwrap();
        assert!(!path(&prefix).exists());
    }

    #[test]
    fn what_was_written_to_a_file_is_not_written_again() {
        let prefix = prefix("kept-once");
        let mut kept = KeptFile::create(&prefix, &about()).unwrap();
        let mut ring = kept.add::<EncoderSample>(SPAN, 0).unwrap();
        (1..4).for_each(|number| ring.write(number, &sample(number)).unwrap());
        assert_eq!(ring.take::<EncoderSample>().unwrap().len(), 3);
        assert!(ring.messages::<EncoderSample>().unwrap().is_empty());
        ring.write(9, &sample(9)).unwrap();
        assert_eq!(ring.messages::<EncoderSample>().unwrap(), [(9, sample(9))]);
        drop(kept);
        assert!(!path(&prefix).exists());
    }

    #[test]
    fn a_file_that_is_there_and_a_link_are_refused() {
        let prefix = prefix("kept-foreign");
        std::os::unix::fs::symlink("/etc/hostname", path(&prefix)).unwrap();
        assert!(KeptFile::create(&prefix, &about()).is_err());
        assert!(LeftFile::open(&path(&prefix)).is_err());
        fs::remove_file(path(&prefix)).unwrap();
        fs::write(path(&prefix), "no header").unwrap();
        assert!(LeftFile::open(&path(&prefix)).is_err());
        fs::remove_file(path(&prefix)).unwrap();
    }
}
