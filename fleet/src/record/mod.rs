//! `hydraxis-fleet record`: everything that the machines of a site publish, into files, one for each machine and hour.
//!
//! ```text
//! callbacks of Zenoh --inbox, bounded--> once a second: judged like in `top` --> files --> closed ones
//!                          |                                |                      |
//!                       dropped                          refused               unwritten
//! ```
//!
//! | file | what |
//! |---|---|
//! | `inbox` | what waits between the callbacks and the files |
//! | `track` | one machine: what is judged, and what no file has |
//! | `file` | one file |
//! | `folder` | names, the limit, and what a killed recorder has left |
//!
//! What is not in a file is counted, and the next file that can be written says so. A disk that is full, slow or gone
//! is said once, and once more when files can be written again.

pub mod file;
pub mod folder;
pub mod inbox;
pub mod track;

use std::{
    collections::BTreeMap,
    io,
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::sleep,
    time::{Duration, Instant},
};

use mcap::McapError;
use thiserror::Error;
use zenoh::{Session, sample::Sample};

use crate::{
    fleet::{Counts, Fleet, Machine},
    kernel::utc_ns,
    key::{Name, Place},
    listen::subscribe,
    say::say,
};
use file::{Facts, RecordingFile};
use folder::Folder;
use inbox::{Inbox, MOST_MACHINES, Received, Waiting};
use track::Track;

/// Time between two writes: what a kill of the recorder loses.
const APART: Duration = Duration::from_secs(1);
/// Time between two looks for a signal.
const LOOK: Duration = Duration::from_millis(50);
/// Time between two tries to write again.
const AGAIN: Duration = Duration::from_secs(5);
/// Time between two looks at the size of the folder.
const ROOM_APART: Duration = Duration::from_secs(10);
/// Time between two lines about what was recorded; less when a count of what is missing has changed.
const LINES_APART: Duration = Duration::from_secs(60);
const CHANGES_APART: Duration = Duration::from_secs(10);
/// Parts of the limit that open files may have together, and the least length at which a file is closed, bytes.
const PARTS: u64 = 16;
const LEAST_LENGTH: u64 = 100_000;

/// What is recorded, and where.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Folder for the files.
    pub folder: PathBuf,
    /// Most bytes of all files.
    pub limit: u64,
    /// Longest time of a file.
    pub every: Duration,
    /// Age from which a message is late.
    pub stale_after: Duration,
    /// Only this site.
    pub site: Option<Name>,
}

/// Why nothing is recorded.
#[derive(Debug, Error)]
pub enum RecordError {
    /// The folder cannot be used.
    #[error("{}: {source}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What is wrong.
        source: io::Error,
    },
    /// Zenoh refuses a key.
    #[error("Zenoh: {0}")]
    Zenoh(#[from] zenoh::Error),
}

/// What was recorded so far, and what was not.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct Totals {
    /// Messages in files.
    pub messages: u64,
    /// Bytes of the files.
    pub bytes: u64,
    /// Messages that found no room on their way to the files.
    pub dropped: u64,
    /// Messages that the disk has not taken.
    pub unwritten: u64,
    /// Messages of no machine, or of one too many.
    pub strangers: u64,
}

/// Records until it is told to stop, and closes all files.
///
/// # Errors
/// Zenoh refuses a key.
pub fn run(session: &Session, mut recorder: Recorder, stop: &AtomicBool) -> Result<(), RecordError> {
    let inbox = Arc::new(Inbox::default());
    let filled = Arc::clone(&inbox);
    let take = move |sample: Sample| filled.push(Received::of(&sample, utc_ns()));
    let subscribers = subscribe(session, recorder.settings.site.as_ref(), take)?;
    say(&format!("records to {}", recorder.folder.path().display()));
    let mut due = Instant::now() + APART;
    while !stop.load(Ordering::Relaxed) {
        sleep(LOOK);
        let now = Instant::now();
        if now >= due {
            due = now + APART;
            recorder.step(inbox.take(), now);
        }
    }
    drop(subscribers);
    recorder.finish(inbox.take());
    Ok(())
}

/// Records the machines that it is given messages of.
pub struct Recorder {
    settings: Settings,
    folder: Folder,
    fleet: Fleet,
    tracks: BTreeMap<Place, Track>,
    totals: Totals,
    /// When a file was tried for the last time, while none can be written.
    broken: Option<Instant>,
    looked_at_room: Option<Instant>,
    /// When the last line was said, and what was missing then.
    said: (Instant, String),
}

impl Recorder {
    /// A recorder with a folder of its own. Says which files a recorder before it has left open.
    ///
    /// # Errors
    /// The folder cannot be made or written, or another recorder writes to it.
    pub fn new(settings: Settings) -> Result<Self, RecordError> {
        let opened = Folder::open(&settings.folder, settings.limit);
        let failed = |source| RecordError::Folder { path: settings.folder.clone(), source };
        let (folder, left) = opened.map_err(failed)?;
        left.iter().for_each(|path| say(&format!("{}: was left open, and has no end", path.display())));
        Ok(Self {
            fleet: Fleet::new(settings.stale_after),
            settings,
            folder,
            tracks: BTreeMap::new(),
            totals: Totals::default(),
            broken: None,
            looked_at_room: None,
            said: (Instant::now(), String::new()),
        })
    }

    /// Judges and writes what has come.
    pub fn step(&mut self, waiting: Waiting, now: Instant) {
        self.take(waiting);
        self.write_all(now, false);
        if self.looked_at_room.is_none_or(|looked| now - looked >= ROOM_APART) {
            self.looked_at_room = Some(now);
            self.make_room();
        }
        let (said, missing) = (now - self.said.0, self.missing());
        if said >= LINES_APART || said >= CHANGES_APART && missing != self.said.1 {
            self.tell(missing, now);
        }
    }

    /// Writes what has come last, and closes all files.
    pub fn finish(mut self, waiting: Waiting) -> Totals {
        let now = Instant::now();
        self.take(waiting);
        self.write_all(now, true);
        self.make_room();
        self.tell(self.missing(), now);
        self.totals
    }

    fn make_room(&self) {
        if let Err(error) = self.folder.make_room() {
            say(&format!("warning: {}: {error}", self.folder.path().display()));
        }
    }

    fn take(&mut self, waiting: Waiting) {
        self.totals.strangers += waiting.strangers;
        for (place, post) in waiting.machines {
            let machines = self.fleet.machines();
            if machines.len() >= MOST_MACHINES && !machines.contains_key(&place) {
                self.totals.strangers += post.messages.len() as u64 + post.dropped;
                continue;
            }
            self.totals.dropped += post.dropped;
            let mut track = self.tracks.remove(&place).unwrap_or_default();
            track.take(&mut self.fleet, &place, post);
            // A machine of which nothing was a message of Hydraxis is none.
            if self.fleet.machines().contains_key(&place) {
                self.tracks.insert(place, track);
            }
        }
    }

    fn write_all(&mut self, now: Instant, is_over: bool) {
        let open = self.tracks.values().filter(|track| track.file.is_some()).count().max(1) as u64;
        let longest = (self.settings.limit / PARTS / open).max(LEAST_LENGTH);
        let mut tracks = std::mem::take(&mut self.tracks);
        for (place, track) in &mut tracks {
            self.write(place, track, now, is_over);
            let is_full = |file: &RecordingFile| {
                file.length() >= longest || now.saturating_duration_since(file.begun()) >= self.settings.every
            };
            if is_over || track.file.as_ref().is_some_and(is_full) {
                close(track);
            }
        }
        self.tracks = tracks;
    }

    /// Writes what waits of a machine, as far as the disk takes it.
    fn write(&mut self, place: &Place, track: &mut Track, now: Instant, is_over: bool) {
        let nothing = Machine::default();
        let machine = self.fleet.machines().get(place).unwrap_or(&nothing);
        if track.entries.is_empty() || !track.is_due(machine, now) && !is_over {
            return;
        }
        let is_new = track.file.is_none();
        let path = track.file.as_ref().map_or_else(|| self.folder.name(place, utc_ns()), |file| file.path().to_owned());
        if is_new && self.broken.is_some_and(|since| now - since < AGAIN) {
            self.totals.unwritten += track.give_up();
            return;
        }
        let begun =
            if is_new { RecordingFile::create(&path, facts(place)).map(|file| track.begin(file)) } else { Ok(()) };
        match begun.and_then(|()| track.write(machine)) {
            Ok((messages, bytes)) => {
                self.totals.messages += messages;
                self.totals.bytes += bytes;
                if is_new && self.broken.take().is_some() {
                    say(&format!("recording goes on: {}", path.display()));
                }
            }
            Err(error) => {
                self.totals.unwritten += track.give_up();
                if let Some(file) = track.file.take() {
                    file.cut();
                    // One without a message is of no use. Somebody may have removed it.
                    let _ = if is_new { std::fs::remove_file(&path) } else { folder::close(&path).map(|_| ()) };
                }
                if self.broken.replace(now).is_none() {
                    let (path, error) = (path.display(), cause(&error));
                    say(&format!("warning: {path}: {error}; nothing is recorded until it can be written again"));
                }
            }
        }
    }

    /// What is missing, as text.
    fn missing(&self) -> String {
        let Counts { lost, late, unknown, malformed, repeated, .. } = self.fleet.counts();
        let Totals { dropped, unwritten, strangers, .. } = self.totals;
        let strangers = strangers + self.fleet.strangers;
        let refused = unknown + malformed + repeated;
        format!(
            "{lost} lost, {late} late, {refused} refused, {dropped} dropped, {unwritten} unwritten, \
             {strangers} of no machine"
        )
    }

    fn tell(&mut self, missing: String, now: Instant) {
        let (machines, Totals { messages, bytes, .. }) = (self.fleet.machines().len(), self.totals);
        say(&format!("{machines} machines, {messages} messages, {:.1} MB; {missing}", bytes as f64 * 1e-6));
        self.said = (now, missing);
    }
}

/// Ends the file of a machine, if it has one.
fn close(track: &mut Track) {
    let facts = track.end_facts();
    let Some(file) = track.file.take() else { return };
    let path = file.path().to_owned();
    if let Err(error) = file.finish(facts) {
        say(&format!("warning: {}: {}; it has no end", path.display(), cause(&error)));
    }
    if let Err(error) = folder::close(&path) {
        say(&format!("warning: {}: {error}", path.display()));
    }
}

/// What the system says, which the error of a file leaves out.
fn cause(error: &McapError) -> String {
    if let McapError::Io(error) = error { error.to_string() } else { error.to_string() }
}

fn facts(place: &Place) -> Facts {
    let all = [
        ("site", place.site.to_string()),
        ("machine", place.machine.to_string()),
        ("version", env!("CARGO_PKG_VERSION").to_owned()),
    ];
    all.map(|(name, fact)| (name.to_owned(), fact)).into()
}

#[cfg(test)]
mod tests;
