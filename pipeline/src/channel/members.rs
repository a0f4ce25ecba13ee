//! The file that tells that a group has members: every member keeps it locked.

use std::{
    fs::{File, OpenOptions},
    io::{Error, ErrorKind},
    os::unix::fs::MetadataExt,
    path::Path,
};

/// Name of the file in the group's folder.
pub(super) const MEMBERS: &str = "members";

/// Opens and locks the file; makes the folder if it is not there.
pub(super) fn join(folder: &Path) -> Result<File, Error> {
    loop {
        std::fs::create_dir_all(folder)?;
        let path = folder.join(MEMBERS);
        let file = match OpenOptions::new().create(true).truncate(false).write(true).open(&path) {
            // The last member is leaving and has removed the folder.
            Err(error) if error.kind() == ErrorKind::NotFound => continue,
            opened => opened?,
        };
        file.lock_shared()?;
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
