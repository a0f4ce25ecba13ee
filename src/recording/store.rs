//! Writes recordings to a file, or to a folder in which the oldest ones make room for new ones.
//!
//! ```text
//! writing --the disk refuses--> broken: messages are counted, a new file is tried every few seconds --> writing
//! ```
//!
//! The disk can be full, slow or gone. That is said once, and once more when files can be written again. A file that
//! the disk has refused stays as it is: it can be read up to there.
//!
//! Trap: on a small disk the limit of a folder may be more than there is. So recordings take at most half of the room
//! that the disk has for them.

use std::{
    fs, io,
    path::{Path, PathBuf},
    time::{Duration, Instant, SystemTime},
};

use mcap::{McapError, McapResult};
use pipeline::message::{
    CoefficientSnapshot, EncoderReading, EncoderSample, MachineState, Reference, Request, StageHealth, ValveCommand,
};

use rustix::fs::statvfs;

use super::{
    Counts, Facts, axes_in, clock_ns, controller_state,
    file::{Encoded, RecordingFile, cause},
    latency::LatencyLog,
};

/// Beginning and end of the names of recordings in a folder.
const NAME: (&str, &str) = ("record-", ".mcap");
/// Files that a full folder holds: the oldest one goes when there is no more room, so a file is a part of the past that
/// is lost at once.
const PARTS: u64 = 16;
/// Least bytes of a file in a folder, unless the recording ends.
const LEAST_PART: u64 = 100_000;
/// Name of the attached file with the ages of the samples.
const LATENCY: &str = "latency.hlog";
/// Time between two tries to write again.
const AGAIN: Duration = Duration::from_secs(5);

/// Where recordings go.
#[derive(Debug, Clone)]
pub enum Place {
    /// One file.
    File(PathBuf),
    /// A folder with files of at most so many bytes together.
    Folder(PathBuf, u64),
}

/// What stands in every file.
#[derive(Debug, Clone, Default)]
pub struct Contents {
    /// Facts about the run.
    pub facts: Facts,
    /// Names and contents of files.
    pub attached: Vec<(String, Vec<u8>)>,
}

impl Contents {
    /// Names of the axes.
    pub fn axes(&self) -> Vec<String> {
        axes_in(&self.facts)
    }
}

/// A file that is being written.
struct Open {
    file: RecordingFile,
    path: PathBuf,
    /// Length at which the next file begins, bytes.
    longest: u64,
    /// What is to be added to `CLOCK_MONOTONIC` for the time since 1970, ns.
    clock_ns: i64,
    latency: LatencyLog,
}

/// What a store has written.
#[derive(Debug, Default)]
pub struct Stored {
    /// The last file.
    pub path: Option<PathBuf>,
    /// Number of files.
    pub files: u64,
    /// Messages that were written.
    pub messages: u64,
    /// Messages that the disk has not taken.
    pub refused: Counts,
}

/// Writes messages to files.
pub struct Store {
    place: Place,
    contents: Contents,
    say: Box<dyn Fn(String) + Send>,
    open: Option<Open>,
    /// When a file was tried for the last time, while none can be written.
    broken: Option<Instant>,
    /// The last file.
    last: Option<PathBuf>,
    /// Number of files so far.
    files: u64,
    /// Messages that were written.
    written: u64,
    /// Messages that the disk has not taken.
    refused: Counts,
    /// Messages that did not come here.
    lost: Counts,
}

impl Store {
    /// A store whose first file is there. `is_patient`: a file that cannot be made is a warning, and is tried again.
    ///
    /// # Errors
    /// The folder or the file cannot be made.
    pub fn new(
        place: Place,
        contents: Contents,
        is_patient: bool,
        say: impl Fn(String) + Send + 'static,
    ) -> McapResult<Self> {
        let mut store = Self {
            place,
            contents,
            say: Box::new(say),
            open: None,
            broken: None,
            last: None,
            files: 0,
            written: 0,
            refused: Counts::new(),
            lost: Counts::new(),
        };
        match store.create() {
            Ok(open) => store.open = Some(open),
            Err(error) if is_patient => store.fail(&store.place(), &error),
            Err(error) => return Err(error),
        }
        Ok(store)
    }

    /// The file that was written last; else where files are to go.
    pub fn place(&self) -> PathBuf {
        match (&self.last, &self.place) {
            (Some(path), _) | (None, Place::File(path) | Place::Folder(path, _)) => path.clone(),
        }
    }

    /// Writes messages. `lost`: those that did not come here, counted since the beginning.
    pub fn take(&mut self, messages: &[Encoded], lost: Counts) {
        self.lost = lost;
        self.open_again();
        let Err(error) = self.write(messages) else {
            self.written += messages.len() as u64;
            return;
        };
        if let Some(Open { path, file, .. }) = self.open.take() {
            file.cut();
            self.fail(&path, &error);
        }
        for message in messages {
            *self.refused.entry(message.channel).or_default() += 1;
        }
    }

    /// Ends the last file.
    pub fn finish(mut self) -> Stored {
        self.close();
        Stored { path: self.last, files: self.files, messages: self.written, refused: self.refused }
    }

    /// Says once that nothing can be written.
    fn fail(&mut self, path: &Path, error: &McapError) {
        self.broken = Some(Instant::now());
        let (path, error) = (path.display(), cause(error));
        (self.say)(format!("warning: recording: {path}: {error}; nothing is recorded until it can be written again"));
    }

    /// Tries a new file after a while, where none can be written.
    fn open_again(&mut self) {
        if self.open.is_some() || self.broken.is_some_and(|since| since.elapsed() < AGAIN) {
            return;
        }
        match self.create() {
            Ok(open) => {
                (self.say)(format!("recording goes on: {}", open.path.display()));
                (self.open, self.broken) = (Some(open), None);
            }
            Err(_) => self.broken = Some(Instant::now()),
        }
    }

    fn write(&mut self, messages: &[Encoded]) -> McapResult<()> {
        let Some(open) = &mut self.open else { return Err(io::Error::from(io::ErrorKind::StorageFull).into()) };
        for message in messages {
            open.file.write(message)?;
            open.latency.take(message, message.read_ns.saturating_add_signed(open.clock_ns));
        }
        if open.file.flush()? > open.longest {
            self.close();
            self.open = Some(self.create()?);
        }
        Ok(())
    }

    fn close(&mut self) {
        let Some(Open { mut file, path, latency, .. }) = self.open.take() else { return };
        let attached = latency.finish().map_or(Ok(()), |log| file.attach(LATENCY, &log));
        if let Err(error) = attached.and_then(|()| file.finish(&self.end_facts())) {
            (self.say)(format!("warning: recording: {}: {}; it has no end", path.display(), cause(&error)));
        }
    }

    /// What is known at the end: the counts, and the relation of the clocks, which somebody may have set meanwhile.
    fn end_facts(&self) -> Facts {
        let mut all = self.lost.clone();
        for (channel, count) in &self.refused {
            *all.entry(channel).or_default() += count;
        }
        let lost = all.into_iter().map(|(channel, count)| (format!("{channel} lost"), count.to_string()));
        let clock = ("realtime_minus_monotonic_ns at the end".to_owned(), clock_ns().to_string());
        lost.chain([clock]).collect()
    }

    fn create(&mut self) -> McapResult<Open> {
        let (path, longest) = match &self.place {
            Place::File(path) if self.files == 0 => (path.clone(), u64::MAX),
            Place::File(path) => (free_name(path), u64::MAX),
            Place::Folder(folder, limit) => {
                fs::create_dir_all(folder)?;
                let limit = *limit.min(&room(folder)?);
                remove_oldest(folder, limit - limit / PARTS)?;
                (folder.join(self.file_name(SystemTime::now())), (limit / PARTS).max(LEAST_PART))
            }
        };
        let clock = clock_ns();
        let mut facts = self.contents.facts.clone();
        facts.insert("realtime_minus_monotonic_ns".to_owned(), clock.to_string());
        let mut file = RecordingFile::create(&path, &facts, &self.contents.attached, clock)?;
        file.add_channel::<EncoderReading>()?;
        file.add_channel::<EncoderSample>()?;
        file.add_channel::<ValveCommand>()?;
        controller_state::add_to(&mut file, &self.contents.axes())?;
        file.add_channel::<CoefficientSnapshot>()?;
        file.add_channel::<Reference>()?;
        file.add_channel::<Request>()?;
        file.add_channel::<StageHealth>()?;
        file.add_channel::<MachineState>()?;
        file.flush()?;
        self.files += 1;
        self.last = Some(path.clone());
        Ok(Open { file, path, longest, clock_ns: clock, latency: LatencyLog::new() })
    }

    fn file_name(&self, now: SystemTime) -> String {
        let now = humantime::format_rfc3339_millis(now).to_string().replace(':', "-");
        let group = self.contents.facts.get("group").map(String::as_str).unwrap_or_default();
        format!("{}{now}-{group}{}", NAME.0, NAME.1)
    }
}

/// The name of the file that goes on after a break, which no file has yet: `run-1.mcap` after `run.mcap`.
pub fn free_name(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().map(|ending| format!(".{}", ending.to_string_lossy())).unwrap_or_default();
    let mut names = (1u64..).map(|number| path.with_file_name(format!("{stem}-{number}{ending}")));
    names.find(|path| !path.exists()).unwrap_or_else(|| path.to_owned())
}

/// Half of the room that the disk of a folder has for recordings: that of those in it, and what is free. Bytes.
fn room(folder: &Path) -> io::Result<u64> {
    let recorded: u64 = recordings(folder)?.iter().map(|(_, length)| length).sum();
    let free = statvfs(folder).map_or(u64::MAX, |found| found.f_bavail.saturating_mul(found.f_frsize));
    Ok(recorded.saturating_add(free) / 2)
}

/// Removes the oldest recordings of a folder until the others have at most `most` bytes. Their names begin with the
/// time.
fn remove_oldest(folder: &Path, most: u64) -> io::Result<()> {
    let files = recordings(folder)?;
    let mut all: u64 = files.iter().map(|(_, length)| length).sum();
    for (path, length) in files {
        if all <= most {
            break;
        }
        match fs::remove_file(path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => all -= length,
        }
    }
    Ok(())
}

/// The recordings of a folder with their lengths, the oldest first.
fn recordings(folder: &Path) -> io::Result<Vec<(PathBuf, u64)>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name();
        if name.to_str().is_some_and(|name| name.starts_with(NAME.0) && name.ends_with(NAME.1)) {
            // Another recorder may have removed it.
            files.extend(entry.metadata().map(|data| (entry.path(), data.len())));
        }
    }
    files.sort();
    Ok(files)
}
