//! Names of the files of groups in shared memory, and what has such a name.

use std::{
    fs::Permissions,
    os::unix::fs::{MetadataExt, PermissionsExt},
    path::{Path, PathBuf},
};

use super::{
    folder::{Foreign, owned},
    prefix::{Prefix, SHARED_MEMORY},
};

/// End of the name of the board.
pub(super) const BOARD: &str = "_board.stop";
/// Number of hexadecimal digits that iceoryx2 puts behind the prefix.
const HASH_DIGITS: usize = 40;

/// A folder or file of this group that belongs to another user.
pub(super) fn foreign(prefix: &Prefix) -> Option<Foreign> {
    std::iter::once(prefix.folder()).chain(memory(prefix)).find_map(|path| owned(&path).err())
}

/// The file that every member opens first, if it belongs to another user. Other names keep no member from joining.
pub(super) fn foreign_counter(prefix: &Prefix) -> Option<Foreign> {
    let is_counter = |path: &PathBuf| path.extension().is_some_and(|end| end == "global_mgmt");
    memory(prefix).into_iter().filter(is_counter).find_map(|path| owned(&path).err())
}

/// Takes all rights to the group's shared memory from other users. A client in another language that joins first makes
/// a file that all users can write.
pub(super) fn make_private(prefix: &Prefix) {
    for path in memory(prefix) {
        let is_open = path.symlink_metadata().is_ok_and(|found| found.is_file() && found.mode() & 0o077 != 0);
        if is_open && owned(&path).is_ok() {
            // A file that stays open is told by the doctor.
            let _ = std::fs::set_permissions(&path, Permissions::from_mode(0o600));
        }
    }
}

/// Files of a group in shared memory, sorted.
pub(super) fn memory(prefix: &Prefix) -> Vec<PathBuf> {
    let is_of = |path: &PathBuf| prefix_of(path).is_some_and(|other| other == *prefix);
    let mut found: Vec<PathBuf> = entries(Path::new(SHARED_MEMORY)).filter(is_of).collect();
    found.sort();
    found
}

/// What is in a folder; nothing where there is none.
pub(super) fn entries(folder: &Path) -> impl Iterator<Item = PathBuf> {
    std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
}

/// The prefix of a file in shared memory, if iceoryx2 gives such names.
pub(super) fn prefix_of(path: &Path) -> Option<Prefix> {
    let (prefix, rest) = path.file_name()?.to_str()?.split_once('.')?;
    let (hash, rest) = rest.split_at_checked(HASH_DIGITS)?;
    let is_hash = hash.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
    (is_hash && rest.starts_with('_')).then(|| prefix.parse().ok()).flatten()
}
