//! What was asked of a machine from elsewhere, and what it answered: a file of the machine, one JSON object a line.
//!
//! The file is opened for each line, so it can be moved away at any time. Of the lines that a station can cause as
//! often as it likes, [`BURST`] are written at once and then one in [`APART`]; those that were left out are counted in
//! the next line.

use std::{
    collections::BTreeMap,
    fs::OpenOptions,
    io::{self, Write},
    os::unix::fs::OpenOptionsExt,
    path::PathBuf,
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant, SystemTime},
};

use serde::Serialize;

use crate::say::say;

/// Time between two lines that a station can cause as often as it likes, once there were many.
const APART: Duration = Duration::from_millis(200);
/// Lines of this kind that may follow each other at once.
const BURST: u32 = 50;

/// One line.
#[derive(Debug, Default, Serialize)]
pub struct Entry<'a> {
    /// What happened: `listen`, `consent`, `arm`, `target`, `disarm`, `end`, `refused`.
    pub what: &'a str,
    /// Who asked; as it calls itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub station: Option<String>,
    /// Set points that were asked for, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub targets: Option<BTreeMap<String, f64>>,
    /// The answer, or why.
    pub text: String,
}

#[derive(Serialize)]
struct Line<'a> {
    time: String,
    #[serde(flatten)]
    entry: &'a Entry<'a>,
    #[serde(skip_serializing_if = "is_zero")]
    left_out: u64,
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// The file.
pub struct Journal {
    path: PathBuf,
    often: Mutex<Often>,
}

/// Lines that a station can cause as often as it likes.
struct Often {
    /// How many may be written, at this time.
    room: f64,
    at: Instant,
    left_out: u64,
}

impl Often {
    /// Whether one may be written now.
    fn admit(&mut self) -> bool {
        let passed = self.at.elapsed();
        self.at += passed;
        self.room = (self.room + passed.div_duration_f64(APART)).min(f64::from(BURST));
        let is_admitted = self.room >= 1.0;
        if is_admitted {
            self.room -= 1.0;
        } else {
            self.left_out += 1;
        }
        is_admitted
    }
}

impl Journal {
    /// In this file, which is made with the first line.
    pub fn new(path: PathBuf) -> Self {
        Self { path, often: Mutex::new(Often { room: f64::from(BURST), at: Instant::now(), left_out: 0 }) }
    }

    /// Adds a line, and prints it.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&self, entry: &Entry<'_>) -> io::Result<()> {
        let left_out = std::mem::take(&mut self.often().left_out);
        self.add(entry, left_out)
    }

    /// Adds a line that a station can cause as often as it likes, unless there were many right before.
    pub fn note(&self, entry: &Entry<'_>) {
        if self.often().admit() {
            self.tell(entry);
        }
    }

    /// Adds a line, and prints it; goes on where the file cannot be written.
    pub fn tell(&self, entry: &Entry<'_>) {
        if let Err(error) = self.write(entry) {
            say(&error.to_string());
        }
    }

    fn often(&self) -> MutexGuard<'_, Often> {
        self.often.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn add(&self, entry: &Entry<'_>, left_out: u64) -> io::Result<()> {
        let time = humantime::format_rfc3339_millis(SystemTime::now()).to_string();
        let line = serde_json::to_string(&Line { time, entry, left_out })?;
        say(&line);
        let written = OpenOptions::new().create(true).append(true).mode(0o600).open(&self.path);
        let written = written.and_then(|mut file| file.write_all(format!("{line}\n").as_bytes()));
        written.map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", self.path.display())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_without_end_are_few_and_counted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let journal = Journal::new(path.clone());
        (0..1000)
            .for_each(|_| journal.note(&Entry { what: "refused", text: "\u{7}\n".to_owned(), ..Entry::default() }));
        journal.write(&Entry { what: "arm", text: "done".to_owned(), ..Entry::default() }).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<serde_json::Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert!(lines.len() < 100, "{}", lines.len());
        let left_out: u64 = lines.iter().map(|line| line["left_out"].as_u64().unwrap_or_default()).sum();
        assert_eq!(left_out + lines.len() as u64, 1001);
        assert_eq!(lines.last().unwrap()["what"], "arm");
        let missing = Journal::new(folder.path().join("none/journal"));
        assert!(missing.write(&Entry::default()).unwrap_err().to_string().contains("none/journal"));
    }
}
