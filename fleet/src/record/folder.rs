//! The folder of the recordings of a site: names, the limit, and files that a killed recorder has left.
//!
//! ```text
//! quarry-ex-07-2026-01-31T10-20-30.125Z.mcap.part     open
//! quarry-ex-07-2026-01-31T10-20-30.125Z.mcap          closed, and never written again
//! ```
//!
//! Only files with such a name are counted and removed.
//!
//! Trap: on a small disk the limit may be more than there is. So recordings take at most half of the room that the disk
//! has for them.

use std::{
    fs::{self, File},
    io,
    path::{Path, PathBuf},
    time::{Duration, UNIX_EPOCH},
};

use rustix::fs::statvfs;

use crate::key::Place;

/// Ending of a closed file, and what an open one has behind it.
const CLOSED: &str = ".mcap";
const OPEN: &str = ".part";
/// Form of the time in a name; 0 stands for a digit.
const TIME: &str = "0000-00-00T00-00-00.000Z";
/// Time between two names of one machine, ns.
const STEP_NS: u64 = 1_000_000;

/// A recording in the folder.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Found {
    /// Time in its name, so that the oldest comes first.
    time: String,
    path: PathBuf,
    bytes: u64,
    is_open: bool,
}

/// A folder that one recorder at a time writes to.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    limit: u64,
    /// The folder itself, locked for as long as this lives.
    _lock: File,
}

impl Folder {
    /// Makes and locks a folder for recordings of at most so many bytes, and closes the files that were left open.
    /// Their names.
    ///
    /// # Errors
    /// It cannot be made or written, or another recorder writes to it.
    pub fn open(path: &Path, limit: u64) -> io::Result<(Self, Vec<PathBuf>)> {
        fs::create_dir_all(path)?;
        let lock = File::open(path)?;
        lock.try_lock().map_err(|_| io::Error::new(io::ErrorKind::WouldBlock, "another recorder writes to it"))?;
        // A folder that cannot be written says so now and not with the first message.
        tempfile::tempfile_in(path)?;
        let folder = Self { path: path.to_owned(), limit, _lock: lock };
        let left: Vec<Found> = folder.recordings()?.into_iter().filter(|found| found.is_open).collect();
        let closed = left.iter().map(|found| close(&found.path)).collect::<io::Result<_>>()?;
        Ok((folder, closed))
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Path of a new open file. A clock that was set back leads to a name that is there already; then a later one.
    pub fn name(&self, place: &Place, utc_ns: i64) -> PathBuf {
        let first = utc_ns.max(0) as u64;
        let path = |i: u64| {
            let time = UNIX_EPOCH + Duration::from_nanos(first.saturating_add(i * STEP_NS));
            let time = humantime::format_rfc3339_millis(time).to_string().replace(':', "-");
            self.path.join(format!("{}-{}-{time}{CLOSED}{OPEN}", place.site, place.machine))
        };
        let is_free = |path: &PathBuf| !path.exists() && !path.with_extension("").exists();
        (0..1000).map(path).find(is_free).unwrap_or_else(|| path(0))
    }

    /// Removes the oldest closed files, until all files together are within the limit. How many.
    ///
    /// # Errors
    /// The folder cannot be read, or a file cannot be removed.
    pub fn make_room(&self) -> io::Result<u64> {
        let found = self.recordings()?;
        let mut all: u64 = found.iter().map(|found| found.bytes).sum();
        let free = statvfs(&self.path).map_or(u64::MAX, |disk| disk.f_bavail.saturating_mul(disk.f_frsize));
        let most = self.limit.min(all.saturating_add(free) / 2);
        let mut removed = 0;
        for old in found.iter().filter(|found| !found.is_open) {
            if all <= most {
                break;
            }
            match fs::remove_file(&old.path) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
                _ => (all, removed) = (all - old.bytes, removed + 1),
            }
        }
        Ok(removed)
    }

    /// The recordings, the oldest first.
    fn recordings(&self) -> io::Result<Vec<Found>> {
        let mut all = Vec::new();
        for entry in fs::read_dir(&self.path)? {
            let entry = entry?;
            let name = entry.file_name();
            let Some((time, is_open)) = name.to_str().and_then(time_of) else { continue };
            // Somebody may have removed it.
            let about = entry.metadata().ok().filter(fs::Metadata::is_file);
            all.extend(about.map(|about| Found { time, path: entry.path(), bytes: about.len(), is_open }));
        }
        all.sort();
        Ok(all)
    }
}

/// Gives an open file the name of a closed one. The new path.
///
/// # Errors
/// It cannot be renamed.
pub fn close(open: &Path) -> io::Result<PathBuf> {
    let closed = open.with_extension("");
    fs::rename(open, &closed)?;
    Ok(closed)
}

/// The time in the name of a recording, and whether the file is open; none for another name.
fn time_of(name: &str) -> Option<(String, bool)> {
    let closed = name.strip_suffix(OPEN);
    let (begin, time) = {
        let stem = closed.unwrap_or(name).strip_suffix(CLOSED)?;
        stem.split_at_checked(stem.len().checked_sub(TIME.len())?)?
    };
    let fits = |(found, form): (u8, u8)| if form == b'0' { found.is_ascii_digit() } else { found == form };
    let is_time = time.bytes().zip(TIME.bytes()).all(fits);
    (begin.ends_with('-') && is_time).then(|| (time.to_owned(), closed.is_some()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place() -> Place {
        Place { site: "quarry".parse().unwrap(), machine: "ex-07".parse().unwrap() }
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name());
        let mut names: Vec<String> = entries.map(|name| name.into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_name_holds_place_and_time_whatever_the_clock_says() {
        let path = tempfile::tempdir().unwrap();
        let (folder, _) = Folder::open(path.path(), u64::MAX).unwrap();
        let name = |utc_ns: i64| folder.name(&place(), utc_ns).file_name().unwrap().to_str().unwrap().to_owned();
        let at = 1_769_854_830_125_000_000;
        assert_eq!(name(at), "quarry-ex-07-2026-01-31T10-20-30.125Z.mcap.part");
        assert_eq!(time_of(&name(at)), Some(("2026-01-31T10-20-30.125Z".to_owned(), true)));
        assert_eq!(name(i64::MIN), "quarry-ex-07-1970-01-01T00-00-00.000Z.mcap.part");
        assert!(time_of(&name(i64::MAX)).is_some());
        fs::write(path.path().join("quarry-ex-07-2026-01-31T10-20-30.125Z.mcap"), "").unwrap();
        assert_eq!(name(at), "quarry-ex-07-2026-01-31T10-20-30.126Z.mcap.part");
    }

    #[test]
    fn the_oldest_closed_recordings_make_room_and_nothing_else_does() {
        let path = tempfile::tempdir().unwrap();
        let write = |name: &str| fs::write(path.path().join(name), [0; 1000]).unwrap();
        let (folder, _) = Folder::open(path.path(), 2500).unwrap();
        let kept = [
            "a-z-2026-01-31T10-00-02.000Z.mcap",
            "a-z-2026-01-31T10-00-00.000Z.mcap.part",
            "record-2026-01-31T10-00-00.000Z-demo.mcap",
            "2026-01-31T10-00-00.000Z.mcap",
            "notes.txt",
        ];
        kept.iter().for_each(|name| write(name));
        write("b-a-2026-01-31T10-00-00.000Z.mcap");
        write("a-b-2026-01-31T10-00-01.000Z.mcap");
        assert_eq!(folder.make_room().unwrap(), 2);
        let mut expected = kept.map(str::to_owned).to_vec();
        expected.sort();
        assert_eq!(names(path.path()), expected);
        assert_eq!(folder.make_room().unwrap(), 0);
    }

    #[test]
    fn what_was_left_open_is_closed_and_a_folder_has_one_recorder() {
        let path = tempfile::tempdir().unwrap();
        fs::write(path.path().join("a-b-2026-01-31T10-00-00.000Z.mcap.part"), "").unwrap();
        let (folder, closed) = Folder::open(path.path(), 1).unwrap();
        assert_eq!(closed, [path.path().join("a-b-2026-01-31T10-00-00.000Z.mcap")]);
        let error = Folder::open(path.path(), 1).unwrap_err();
        assert_eq!(error.to_string(), "another recorder writes to it");
        drop(folder);
        assert!(Folder::open(path.path(), 1).unwrap().1.is_empty());
        assert!(Folder::open(&path.path().join("a-b-2026-01-31T10-00-00.000Z.mcap"), 1).is_err());
    }
}
