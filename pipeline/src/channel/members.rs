//! The file that tells that a group has members: every member keeps it locked.

use std::{
    fs::{File, OpenOptions},
    io::ErrorKind,
    os::unix::fs::{MetadataExt, OpenOptionsExt},
    path::Path,
};

use super::folder::{self, UnusableFolder};

/// Name of the file in the group's folder.
pub(super) const MEMBERS: &str = "members";
/// Name of the file that `hydraxis run` keeps locked.
pub(super) const RUN: &str = "run";

/// Opens and locks the file; makes the folder if it is not there.
pub(super) fn join(folder: &Path) -> Result<File, UnusableFolder> {
    loop {
        folder::make(folder)?;
        let path = folder.join(MEMBERS);
        let file = match OpenOptions::new().create(true).truncate(false).write(true).mode(0o600).open(&path) {
            // The last member is leaving and has removed the folder.
            Err(error) if error.kind() == ErrorKind::NotFound => continue,
            opened => opened.map_err(UnusableFolder::refused(folder))?,
        };
        file.lock_shared().map_err(UnusableFolder::refused(folder))?;
        // The file may have been removed between opening and locking: then no other process sees the lock.
        if is_still(&file, &path) {
            return Ok(file);
        }
    }
}

/// Whether an open file is the one that now has this name.
pub(super) fn is_still(file: &File, path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|seen| file.metadata().is_ok_and(|own| own.ino() == seen.ino()))
}
