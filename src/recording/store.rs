//! Writes recordings to a file, or to a folder in which the oldest ones make room for new ones.
//!
//! ```text
//! writing --the disk refuses--> broken: messages are counted, a new file is tried every few seconds --> writing
//! ```
//!
//! The disk can be full, slow or gone. That is said once, and once more when files can be written again. A file that
//! the disk has refused stays as it is: it can be read up to there.

use std::{
    fs, io,
    path::{Path, PathBuf},
    time::{Duration, Instant, SystemTime},
};

use mcap::McapResult;
use pipeline::message::{
    CoefficientSnapshot, EncoderReading, EncoderSample, MachineState, Reference, Request, StageHealth, ValveCommand,
};

use super::{
    Counts, Facts, clock_ns,
    file::{Encoded, RecordingFile},
};

/// Beginning and end of the names of recordings in a folder.
const NAME: (&str, &str) = ("record-", ".mcap");
/// Files that a full folder holds: the oldest one goes when there is no more room, so a file is a part of the past that
/// is lost at once.
const PARTS: u64 = 16;
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

/// A file that is being written.
struct Open {
    file: RecordingFile,
    path: PathBuf,
}

/// Writes messages to files.
pub struct Store {
    place: Place,
    contents: Contents,
    say: Box<dyn Fn(String) + Send>,
    open: Option<Open>,
    /// When a file was tried for the last time, while none can be written.
    broken: Option<Instant>,
    /// Number of files so far.
    files: u64,
    /// Messages that the disk has not taken.
    refused: Counts,
    /// Messages that did not come here.
    lost: Counts,
}

impl Store {
    /// A store whose first file is there.
    ///
    /// # Errors
    /// The folder or the file cannot be made.
    pub fn new(place: Place, contents: Contents, say: impl Fn(String) + Send + 'static) -> McapResult<Self> {
        if let Place::Folder(folder, _) = &place {
            fs::create_dir_all(folder)?;
        }
        let mut store = Self {
            place,
            contents,
            say: Box::new(say),
            open: None,
            broken: None,
            files: 0,
            refused: Counts::new(),
            lost: Counts::new(),
        };
        store.open = Some(store.create()?);
        Ok(store)
    }

    /// The file that is being written, or would be.
    pub fn path(&self) -> Option<&Path> {
        self.open.as_ref().map(|open| open.path.as_path())
    }

    /// Writes messages. `lost`: those that did not come here, counted since the beginning.
    pub fn take(&mut self, messages: &[Encoded], lost: Counts) {
        self.lost = lost;
        self.open_again();
        if let Err(error) = self.write(messages) {
            if let Some(Open { path, .. }) = self.open.take() {
                self.broken = Some(Instant::now());
                (self.say)(format!(
                    "warning: recording: {}: {error}; nothing is recorded until it can be written again",
                    path.display()
                ));
            }
            for message in messages {
                *self.refused.entry(message.channel).or_default() += 1;
            }
        }
    }

    /// Ends the last file. The messages that the disk has not taken.
    pub fn finish(mut self) -> Counts {
        self.close();
        self.refused
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
        messages.iter().try_for_each(|message| open.file.write(message))?;
        let length = open.file.flush()?;
        if let Place::Folder(_, limit) = self.place
            && length > limit / PARTS
        {
            self.close();
            self.open = Some(self.create()?);
        }
        Ok(())
    }

    fn close(&mut self) {
        let Some(Open { file, path }) = self.open.take() else { return };
        if let Err(error) = file.finish(&self.counts()) {
            (self.say)(format!("warning: recording: {}: {error}; it has no end", path.display()));
        }
    }

    /// The counts as facts.
    fn counts(&self) -> Facts {
        let mut all = self.lost.clone();
        for (channel, count) in &self.refused {
            *all.entry(channel).or_default() += count;
        }
        all.into_iter().map(|(channel, count)| (format!("{channel} lost"), count.to_string())).collect()
    }

    fn create(&mut self) -> McapResult<Open> {
        let path = match &self.place {
            Place::File(path) if self.files == 0 => path.clone(),
            Place::File(path) => numbered(path, self.files),
            Place::Folder(folder, limit) => {
                remove_oldest(folder, limit - limit / PARTS)?;
                folder.join(self.file_name(SystemTime::now()))
            }
        };
        self.files += 1;
        let clock = clock_ns();
        let mut facts = self.contents.facts.clone();
        facts.insert("realtime_minus_monotonic_ns".to_owned(), clock.to_string());
        let mut file = RecordingFile::create(&path, &facts, &self.contents.attached, clock)?;
        file.add_channel::<EncoderReading>()?;
        file.add_channel::<EncoderSample>()?;
        file.add_channel::<ValveCommand>()?;
        file.add_channel::<CoefficientSnapshot>()?;
        file.add_channel::<Reference>()?;
        file.add_channel::<Request>()?;
        file.add_channel::<StageHealth>()?;
        file.add_channel::<MachineState>()?;
        file.flush()?;
        Ok(Open { file, path })
    }

    fn file_name(&self, now: SystemTime) -> String {
        let now = humantime::format_rfc3339_millis(now).to_string().replace(':', "-");
        let group = self.contents.facts.get("group").map(String::as_str).unwrap_or_default();
        format!("{}{now}-{group}{}", NAME.0, NAME.1)
    }
}

/// The name of the file that goes on after a break: `run.mcap`, `run-1.mcap`.
fn numbered(path: &Path, number: u64) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().map(|ending| format!(".{}", ending.to_string_lossy())).unwrap_or_default();
    path.with_file_name(format!("{stem}-{number}{ending}"))
}

/// Removes the oldest recordings of a folder until the others have at most `most` bytes. Their names begin with the
/// time.
fn remove_oldest(folder: &Path, most: u64) -> io::Result<()> {
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
