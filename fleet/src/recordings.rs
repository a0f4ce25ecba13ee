//! The list of the recordings of a machine: name, size and SHA-256 of every closed file.
//!
//! The recordings themselves do not travel through Zenoh. A program for files copies them (rclone), and the hash shows
//! that a copy is whole.

use std::{
    collections::BTreeMap,
    fs::{self, File},
    io::{self, Read},
    path::{Path, PathBuf},
    time::{Duration, SystemTime},
};

use serde::Serialize;
use sha2::{Digest, Sha256};

/// A file that nothing was written to for so long is closed.
const CLOSED_AFTER: Duration = Duration::from_secs(30);
/// Ending of recordings and black boxes.
const ENDING: &str = "mcap";
/// Bytes that are read at once.
const PIECE: usize = 1 << 20;

/// A recording.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Recording {
    /// Name of the file in its folder.
    pub name: String,
    /// Length, bytes.
    pub bytes: u64,
    /// Time of the last write, ns since 1970.
    pub modified_ns: u64,
    /// SHA-256 in hexadecimal; none while the file is open, or not read yet.
    pub sha256: Option<String>,
}

/// The recordings in a folder.
pub struct Recordings {
    folder: PathBuf,
    known: BTreeMap<String, Recording>,
}

impl Recordings {
    /// In this folder.
    pub fn new(folder: PathBuf) -> Self {
        Self { folder, known: BTreeMap::new() }
    }

    /// Looks at the folder again, and reads files that have closed since; `is_over` ends it between two pieces.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn look(&mut self, now: SystemTime, is_over: impl Fn() -> bool) -> io::Result<Vec<Recording>> {
        let mut found = BTreeMap::new();
        for entry in fs::read_dir(&self.folder)? {
            let path = entry?.path();
            if path.extension().is_none_or(|ending| ending != ENDING) {
                continue;
            }
            // A file may go at any time: the recorder removes the oldest ones.
            let Some(mut recording) = describe(&path) else { continue };
            let same =
                |known: &&Recording| (known.bytes, known.modified_ns) == (recording.bytes, recording.modified_ns);
            recording.sha256 = self.known.get(&recording.name).filter(same).and_then(|known| known.sha256.clone());
            let age = now.duration_since(SystemTime::UNIX_EPOCH + Duration::from_nanos(recording.modified_ns));
            let is_closed = age.is_ok_and(|age| age >= CLOSED_AFTER);
            if is_closed && recording.sha256.is_none() {
                recording.sha256 = hash(&path, &is_over).ok();
            }
            found.insert(recording.name.clone(), recording);
        }
        self.known = found;
        Ok(self.known.values().cloned().collect())
    }
}

fn describe(path: &Path) -> Option<Recording> {
    let about = path.symlink_metadata().ok().filter(fs::Metadata::is_file)?;
    let modified = about.modified().ok()?.duration_since(SystemTime::UNIX_EPOCH).ok()?;
    let name = path.file_name()?.to_str()?.to_owned();
    Some(Recording { name, bytes: about.len(), modified_ns: modified.as_nanos() as u64, sha256: None })
}

fn hash(path: &Path, is_over: &impl Fn() -> bool) -> io::Result<String> {
    let (mut file, mut hash, mut piece) = (File::open(path)?, Sha256::new(), vec![0; PIECE]);
    loop {
        let length = file.read(&mut piece)?;
        if length == 0 {
            return Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect());
        }
        if is_over() {
            return Err(io::ErrorKind::Interrupted.into());
        }
        hash.update(&piece[..length]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closed_files_have_a_hash_and_open_ones_have_none_yet() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.mcap"), "abc").unwrap();
        fs::write(folder.path().join("notes.txt"), "abc").unwrap();
        let mut recordings = Recordings::new(folder.path().to_owned());
        let open = recordings.look(SystemTime::now(), || false).unwrap();
        assert_eq!((open.len(), &*open[0].name, open[0].bytes, &open[0].sha256), (1, "a.mcap", 3, &None));
        let later = SystemTime::now() + CLOSED_AFTER;
        assert_eq!(recordings.look(later, || true).unwrap()[0].sha256, None);
        let closed = recordings.look(later, || false).unwrap();
        // The first example of FIPS 180-2.
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(closed[0].sha256.as_deref(), Some(expected));
        fs::remove_file(folder.path().join("a.mcap")).unwrap();
        assert_eq!(recordings.look(later, || false).unwrap(), []);
        assert!(Recordings::new(folder.path().join("none")).look(later, || false).is_err());
    }
}
