//! The claim of `hydraxis run` on a name: of several starts at the same time exactly one goes on.
//!
//! The claim is an exclusive lock on the file `run` in the group's folder. It ends with its process, however that ends.
//! Nobody removes the folder while another process holds the lock.

use std::{
    fs::{File, OpenOptions},
    io::{ErrorKind, Read, Write},
    os::unix::fs::OpenOptionsExt,
    path::PathBuf,
    thread::sleep,
    time::{Duration, Instant, SystemTime},
};

use super::{
    error::{ClaimError, RemoveError},
    folder::{self, UnusableFolder},
    leftovers,
    members::{MEMBERS, RUN, is_still},
    prefix::Prefix,
};

/// How long the lock is tried. A process that removes leftovers holds it for a moment.
const PATIENCE: Duration = Duration::from_millis(200);
/// Pause between two tries.
const PAUSE: Duration = Duration::from_millis(2);

/// The right to run a group of a name.
#[derive(Debug)]
pub struct Claim {
    prefix: Prefix,
    /// Locked until it is dropped.
    _file: File,
}

impl Claim {
    /// Claims a name for this process.
    ///
    /// # Errors
    /// Another process has it, or the group's folder cannot be used.
    pub fn take(prefix: &Prefix) -> Result<Self, ClaimError> {
        let (folder, path) = (prefix.folder(), prefix.folder().join(RUN));
        let until = Instant::now() + PATIENCE;
        let unusable = |source| ClaimError::Folder { prefix: prefix.clone(), source };
        let refused = |error| unusable(UnusableFolder::refused(&folder)(error));
        loop {
            folder::make(&folder).map_err(unusable)?;
            let mut options = OpenOptions::new();
            options.create(true).truncate(false).read(true).write(true).mode(0o600);
            let mut file = match options.open(&path) {
                // The group before has just been removed with its folder.
                Err(error) if error.kind() == ErrorKind::NotFound => continue,
                opened => opened.map_err(refused)?,
            };
            let is_locked = file.try_lock().is_ok();
            if is_locked && is_still(&file, &path) {
                let since = humantime::format_rfc3339_seconds(SystemTime::now());
                let written =
                    file.set_len(0).and_then(|()| write!(file, "process {} since {since}", std::process::id()));
                written.map_err(refused)?;
                return Ok(Self { prefix: prefix.clone(), _file: file });
            }
            if !is_locked && Instant::now() > until {
                let mut holder = String::new();
                let _ = file.read_to_string(&mut holder);
                let holder = if holder.is_empty() { "another process".to_owned() } else { holder };
                return Err(ClaimError::Taken { prefix: prefix.clone(), holder });
            }
            sleep(PAUSE);
        }
    }

    /// The name.
    pub fn prefix(&self) -> &Prefix {
        &self.prefix
    }

    /// Removes what a dead group of this name has left; keeps the claim. Returns what was removed, sorted.
    ///
    /// # Errors
    /// The group is alive, or files of another user are in its place.
    pub fn remove_leftovers(&self) -> Result<Vec<PathBuf>, RemoveError> {
        leftovers::remove(&self.prefix, true)
    }
}

impl Drop for Claim {
    /// Removes the folder unless a group is in it.
    fn drop(&mut self) {
        let folder = self.prefix.folder();
        if !folder.join(MEMBERS).exists() {
            let _ = std::fs::remove_file(folder.join(RUN));
            let _ = std::fs::remove_dir(&folder);
        }
    }
}
