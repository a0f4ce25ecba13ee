//! Files that groups leave behind: which groups there are, which of them live, and which files of dead ones to remove.
//!
//! A process that was killed cannot remove its shared memory, and iceoryx2 leaves a small file per prefix.
//!
//! | where | name | is ours because |
//! |---|---|---|
//! | folder for temporary files | `hydraxis.PREFIX/` | it holds the file `members`, which every member keeps locked |
//! | `/dev/shm` | `PREFIX.`, 40 hexadecimal digits, `_`, more | iceoryx2 names files so; the folder tells the prefix |
//!
//! A group lives as long as a process holds the lock. Trap: the folder is where `TMPDIR` points, which may be another
//! place for a service than for a person. A group whose memory is there without its folder is not known to be dead, and
//! another program that uses iceoryx2 may have given its files such names. So this group is removed only when it is
//! named, and only while no process has its memory mapped.

use std::{
    collections::BTreeMap,
    fs::File,
    io::ErrorKind,
    path::{Path, PathBuf},
    time::Duration,
};

use super::{
    error::RemoveError,
    members::{MEMBERS, is_still},
    prefix::{FOLDER, Prefix},
};

/// Folder in which shared memory has its names.
const SHARED_MEMORY: &str = "/dev/shm";
/// How often a lock is tried before its group counts as alive. Another process may hold the lock for a moment, only to
/// find out whether it can be had, as [`groups`] does.
const TRIES: usize = 10;
/// Pause between two tries.
const PAUSE: Duration = Duration::from_millis(1);
/// Number of hexadecimal digits that iceoryx2 puts behind the prefix.
const HASH_DIGITS: usize = 40;

/// Whether a group lives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GroupState {
    /// A process is a member, or has the group's memory mapped.
    Alive,
    /// No process is a member.
    Dead,
    /// There is memory without a folder, and no process has it mapped: the group is dead, or another program's.
    Unknown,
}

impl GroupState {
    /// Name of the state.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Alive => "alive",
            Self::Dead => "dead",
            Self::Unknown => "unknown",
        }
    }
}

/// A group that has files on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FoundGroup {
    /// Name of the group.
    pub prefix: Prefix,
    /// Whether the group lives.
    pub state: GroupState,
    /// Files of the group in shared memory, and its folder, sorted.
    pub files: Vec<PathBuf>,
}

/// All groups of this machine, sorted by name.
pub fn groups() -> Vec<FoundGroup> {
    let mut files = BTreeMap::<String, Vec<PathBuf>>::new();
    for path in entries(Path::new(SHARED_MEMORY)) {
        if let Some(prefix) = prefix_of(&path) {
            files.entry(prefix.to_string()).or_default().push(path);
        }
    }
    for path in entries(&std::env::temp_dir()) {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let prefix = name.strip_prefix(FOLDER).and_then(|rest| rest.parse::<Prefix>().ok());
        if let Some(prefix) = prefix.filter(|_| path.join(MEMBERS).is_file()) {
            files.entry(prefix.to_string()).or_default().push(path);
        }
    }
    let one = |(prefix, mut files): (String, Vec<PathBuf>)| {
        let prefix: Prefix = prefix.parse().ok()?;
        files.sort();
        let state = match lock(&prefix) {
            Lock::Held => GroupState::Alive,
            Lock::Taken(_) => GroupState::Dead,
            Lock::Missing if is_mapped(&files) => GroupState::Alive,
            Lock::Missing => GroupState::Unknown,
        };
        Some(FoundGroup { prefix, state, files })
    };
    files.into_iter().filter_map(one).collect()
}

/// Removes every file that a dead group has left behind; returns what was removed, sorted.
///
/// # Errors
/// The group is alive: its files are in use.
pub fn remove_leftovers(prefix: &Prefix) -> Result<Vec<PathBuf>, RemoveError> {
    let alive = || Err(RemoveError::Alive { prefix: prefix.clone() });
    let is_of = |path: &PathBuf| prefix_of(path).is_some_and(|other| other == *prefix);
    let mut found: Vec<PathBuf> = entries(Path::new(SHARED_MEMORY)).filter(is_of).collect();
    found.sort();
    // The lock is held until all files are removed. A process that joins meanwhile waits, and then finds that its lock
    // is on a file that is gone.
    let members = match lock(prefix) {
        Lock::Held => return alive(),
        Lock::Missing if is_mapped(&found) => return alive(),
        Lock::Taken(members) => Some(members),
        Lock::Missing => None,
    };
    found.retain(|path| std::fs::remove_file(path).is_ok());
    let folder = prefix.folder();
    // A folder of that name without the lock belongs to another program.
    if members.is_some() && std::fs::remove_dir_all(&folder).is_ok() {
        found.push(folder);
    }
    Ok(found)
}

/// The lock that every member holds.
enum Lock {
    /// Another process holds the lock.
    Held,
    /// This process holds the lock until the file is dropped.
    Taken(File),
    /// There is no folder, or no file to lock in it.
    Missing,
}

fn lock(prefix: &Prefix) -> Lock {
    let path = prefix.folder().join(MEMBERS);
    for again in 0..TRIES {
        if again > 0 {
            std::thread::sleep(PAUSE);
        }
        let members = match File::open(&path) {
            Ok(members) => members,
            // A file with the name of the folder is no group either.
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                return Lock::Missing;
            }
            // A file of another user must not be removed.
            Err(_) => return Lock::Held,
        };
        // Another process may have removed the file since, and a new group may have made one.
        if members.try_lock().is_ok() && is_still(&members, &path) {
            return Lock::Taken(members);
        }
    }
    Lock::Held
}

fn entries(folder: &Path) -> impl Iterator<Item = PathBuf> {
    std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
}

/// The prefix of a file in shared memory, if iceoryx2 gives such names.
fn prefix_of(path: &Path) -> Option<Prefix> {
    let (prefix, rest) = path.file_name()?.to_str()?.split_once('.')?;
    let (hash, rest) = rest.split_at_checked(HASH_DIGITS)?;
    let is_hash = hash.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'a'..=b'f'));
    (is_hash && rest.starts_with('_')).then(|| prefix.parse().ok()).flatten()
}

/// Whether a process has one of these files mapped. The processes of the same user can always be looked at.
fn is_mapped(files: &[PathBuf]) -> bool {
    let maps = entries(Path::new("/proc")).filter_map(|process| std::fs::read_to_string(process.join("maps")).ok());
    let is_ours = |line: &str| {
        // The mapped file stands at the end of the line, with its absolute path.
        line.find('/').is_some_and(|begin| files.iter().any(|file| file.as_os_str() == &line[begin..]))
    };
    !files.is_empty() && maps.into_iter().any(|maps| maps.lines().any(is_ours))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    #[test]
    fn only_names_that_iceoryx2_gives_have_a_prefix() {
        let hash = "0354a209029e7d094a819e2d4030ea331e6caaf0";
        let prefix = |name: &str| prefix_of(&Path::new("/dev/shm").join(name)).map(|prefix| prefix.to_string());
        for rest in ["_158456874115226466134152721365.data", "_1_2.connection", "_node.0_10_0.global_mgmt"] {
            assert_eq!(prefix(&format!("my-group.{hash}{rest}")).as_deref(), Some("my-group"), "{rest}");
        }
        for name in [
            "demo.txt".to_owned(),
            "demo".to_owned(),
            format!("{hash}_1.data"),
            format!("iox2_{hash}_1.data"),
            format!("demo.{hash}"),
            format!("demo.{hash}.data"),
            format!("demo.{}_1.data", hash.to_uppercase()),
            format!("demo.{}_1.data", &hash[1..]),
            format!("demo.0{hash}_1.data"),
            format!("sem.demo.{hash}_1.data"),
            format!("de mo.{hash}_1.data"),
            format!(".{hash}_1.data"),
            "demo.ääääääääääääääääääääääääääääääääääääääääääää_".to_owned(),
        ] {
            assert_eq!(prefix(&name), None, "{name}");
        }
    }

    #[test]
    fn a_dead_group_is_removed_while_others_look_whether_it_lives() {
        let prefix: Prefix = format!("t{}-looked-at", std::process::id()).parse().unwrap();
        let stop = AtomicBool::new(false);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    while !stop.load(Ordering::Relaxed) {
                        drop(lock(&prefix));
                        std::thread::sleep(Duration::from_micros(100));
                    }
                });
            }
            let tries = (0..2000).map(|_| {
                std::fs::create_dir_all(prefix.folder()).unwrap();
                std::fs::write(prefix.folder().join(MEMBERS), "").unwrap();
                remove_leftovers(&prefix)
            });
            let refused = tries.filter(Result::is_err).count();
            stop.store(true, Ordering::Relaxed);
            assert_eq!(refused, 0);
        });
    }
}
