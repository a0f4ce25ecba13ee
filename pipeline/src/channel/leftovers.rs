//! Files that groups leave behind: which groups there are, which of them live, and which files of dead ones to remove.
//!
//! A process that was killed cannot remove its shared memory, and iceoryx2 leaves a small file per prefix.
//!
//! | where | name | is ours because |
//! |---|---|---|
//! | `TMPDIR`, or `/dev/shm` | `hydraxis.PREFIX/` | it holds `members`, which every member keeps locked, or `run` |
//! | `/dev/shm` | `PREFIX.`, 40 hexadecimal digits, `_`, more | iceoryx2 names files so; the folder tells the prefix |
//!
//! A group lives as long as a process holds the lock. Trap: the folder is where `TMPDIR` points, which may be another
//! place for a service than for a person. A group whose memory is there without its folder is not known to be dead, and
//! another program that uses iceoryx2 may have given its files such names. So this group is removed only when it is
//! named, and only while no process has its memory mapped.

use std::{
    collections::BTreeMap,
    fs::{File, OpenOptions},
    io::ErrorKind,
    os::unix::fs::OpenOptionsExt,
    path::{Path, PathBuf},
    time::Duration,
};

use rustix::{fs::OFlags, process::geteuid};

use super::{
    error::RemoveError,
    folder::{Exposed, owned},
    members::{MEMBERS, RUN, is_still},
    names::{BOARD, entries, foreign, memory, prefix_of},
    prefix::{FOLDER, Prefix, SHARED_MEMORY, place},
};

/// How often a lock is tried before its group counts as alive. Another process may hold the lock for a moment, only to
/// find out whether it can be had, as [`groups`] does.
const TRIES: usize = 10;
/// Pause between two tries.
const PAUSE: Duration = Duration::from_millis(1);
/// Name of the process of a stage and of the supervisor.
const PROGRAM: &str = "hydraxis";

/// Whether a group lives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GroupState {
    /// A process is a member, or has the group's memory mapped.
    Alive,
    /// No process is a member.
    Dead,
    /// There is memory without a folder, and no process has it mapped: the group is dead, or another program's.
    Unknown,
    /// Its folder, or a file of it, belongs to another user.
    Foreign,
}

impl GroupState {
    /// Name of the state.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Alive => "alive",
            Self::Dead => "dead",
            Self::Unknown => "unknown",
            Self::Foreign => "foreign",
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
    for path in entries(&place()) {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let prefix = name.strip_prefix(FOLDER).and_then(|rest| rest.parse::<Prefix>().ok());
        if let Some(prefix) = prefix.filter(|_| is_group(&path)) {
            files.entry(prefix.to_string()).or_default().push(path);
        }
    }
    let one = |(prefix, mut files): (String, Vec<PathBuf>)| {
        let prefix: Prefix = prefix.parse().ok()?;
        files.sort();
        // A foreign folder is not looked into: what is in it is another user's. A foreign file beside a group that
        // lives does not make it another user's.
        let is_foreign = |path: &PathBuf| owned(path).is_err();
        let state = match if is_foreign(&prefix.folder()) { Lock::Missing } else { lock(&prefix, false) } {
            Lock::Held => GroupState::Alive,
            _ if files.iter().any(is_foreign) => GroupState::Foreign,
            Lock::Taken { .. } => GroupState::Dead,
            Lock::Missing if is_mapped(&files) => GroupState::Alive,
            Lock::Missing => GroupState::Unknown,
        };
        Some(FoundGroup { prefix, state, files })
    };
    files.into_iter().filter_map(one).collect()
}

/// Whether a process is a member of the group. A supervisor that has only claimed the name is none yet. A process that
/// removes the files of the group looks like a member for some milliseconds.
pub fn is_joined(prefix: &Prefix) -> bool {
    matches!(lock_file(&prefix.folder().join(MEMBERS)), Lock::Held)
}

/// Names of the groups that have a board, alive or not, sorted.
pub fn boards() -> Vec<Prefix> {
    let has_board = |path: &PathBuf| path.to_string_lossy().ends_with(BOARD);
    let mut found: Vec<Prefix> =
        entries(Path::new(SHARED_MEMORY)).filter(has_board).filter_map(|path| prefix_of(&path)).collect();
    found.sort();
    found
}

/// Files and folders of groups that another user can reach, or that belong to another user, sorted.
pub fn exposed() -> Vec<Exposed> {
    let memory = entries(Path::new(SHARED_MEMORY)).filter(|path| prefix_of(path).is_some());
    let is_named = |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(FOLDER));
    let mut paths: Vec<PathBuf> = memory.chain(entries(&place()).filter(is_named)).collect();
    paths.sort();
    paths.into_iter().filter_map(Exposed::of).collect()
}

/// Removes every file that a dead group has left behind; returns what was removed, sorted.
///
/// # Errors
/// The group is alive: its files are in use. Or one of them belongs to another user; then nothing is removed.
pub fn remove_leftovers(prefix: &Prefix) -> Result<Vec<PathBuf>, RemoveError> {
    remove(prefix, false)
}

/// As [`remove_leftovers`]; a process that has claimed the name keeps its claim.
pub(super) fn remove(prefix: &Prefix, is_claimed: bool) -> Result<Vec<PathBuf>, RemoveError> {
    let alive = || Err(RemoveError::Alive { prefix: prefix.clone() });
    if let Some(source) = foreign(prefix) {
        return Err(RemoveError::Foreign { prefix: prefix.clone(), source });
    }
    let mut found = memory(prefix);
    // The locks are held until all files are removed. A process that joins meanwhile waits, and then finds that its
    // lock is on a file that is gone.
    let locks = match lock(prefix, is_claimed) {
        Lock::Held => return alive(),
        Lock::Missing if is_mapped(&found) => return alive(),
        Lock::Taken(locks) => Some(locks),
        Lock::Missing => None,
    };
    found.retain(|path| std::fs::remove_file(path).is_ok());
    let folder = prefix.folder();
    // A folder of that name without the locks belongs to another program.
    if (locks.is_some() || is_claimed) && remove_folder(&folder, is_claimed) {
        found.push(folder);
    }
    Ok(found)
}

/// Removes the folder, or all but the claim. Returns whether the folder is gone.
fn remove_folder(folder: &Path, is_claimed: bool) -> bool {
    // The files with the locks go last. A process that joins before that waits for the lock.
    for path in entries(folder).filter(|path| !path.ends_with(RUN) && !path.ends_with(MEMBERS)) {
        let is_folder = path.symlink_metadata().is_ok_and(|found| found.is_dir());
        // What cannot be removed keeps the folder.
        let _ = if is_folder { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
    }
    let _ = std::fs::remove_file(folder.join(MEMBERS));
    if is_claimed {
        return false;
    }
    let _ = std::fs::remove_file(folder.join(RUN));
    std::fs::remove_dir(folder).is_ok()
}

/// The locks that keep a group: that of every member, and that of its run.
enum Lock {
    /// Another process holds one of them.
    Held,
    /// This process holds them until the files are dropped.
    Taken(Vec<File>),
    /// There is no folder, or no file to lock in it.
    Missing,
}

fn lock(prefix: &Prefix, is_claimed: bool) -> Lock {
    let names = [MEMBERS, RUN];
    let names = if is_claimed { &names[..1] } else { &names[..] };
    let mut taken = Vec::new();
    for name in names {
        match lock_file(&prefix.folder().join(name)) {
            Lock::Held => return Lock::Held,
            Lock::Taken(files) => taken.extend(files),
            Lock::Missing => {}
        }
    }
    if taken.is_empty() { Lock::Missing } else { Lock::Taken(taken) }
}

fn lock_file(path: &Path) -> Lock {
    for again in 0..TRIES {
        if again > 0 {
            std::thread::sleep(PAUSE);
        }
        // Trap: opening a FIFO waits for its writer, which may never come. A link may point to one.
        let options = (OFlags::NONBLOCK | OFlags::NOFOLLOW).bits() as i32;
        let file = match OpenOptions::new().read(true).custom_flags(options).open(path) {
            Ok(file) if file.metadata().is_ok_and(|found| found.is_file()) => file,
            Ok(_) => return Lock::Missing,
            // A file with the name of the folder is no group either.
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
                return Lock::Missing;
            }
            // A file of another user must not be removed.
            Err(_) => return Lock::Held,
        };
        // Another process may have removed the file since, and a new group may have made one.
        if file.try_lock().is_ok() && is_still(&file, path) {
            return Lock::Taken(vec![file]);
        }
    }
    Lock::Held
}

/// Whether a folder is that of a group.
fn is_group(folder: &Path) -> bool {
    [MEMBERS, RUN].iter().any(|name| folder.join(name).is_file()) || owned(folder).is_err()
}

/// Whether a process has one of these files mapped, or may have.
///
/// Trap: the kernel hides the maps of a process of the same user that has a capability, or that is in a user namespace
/// of its own. A program of Hydraxis that hides them may be one of this group.
fn is_mapped(files: &[PathBuf]) -> bool {
    let is_ours = |line: &str| {
        // The mapped file stands at the end of the line, with its absolute path.
        line.find('/').is_some_and(|begin| files.iter().any(|file| file.as_os_str() == &line[begin..]))
    };
    let has_mapped = |process: PathBuf| match std::fs::read_to_string(process.join("maps")) {
        Ok(maps) => maps.lines().any(is_ours),
        Err(error) => error.kind() == ErrorKind::PermissionDenied && is_member_program(&process),
    };
    !files.is_empty() && entries(Path::new("/proc")).any(has_mapped)
}

/// Whether a process in `/proc` is a program of Hydraxis of the user of this process.
fn is_member_program(process: &Path) -> bool {
    let status = std::fs::read_to_string(process.join("status")).unwrap_or_default();
    let value = |name: &str| status.lines().find_map(|line| line.strip_prefix(name));
    let user = value("Uid:").and_then(|ids| ids.split_whitespace().nth(1)?.parse::<u32>().ok());
    user == Some(geteuid().as_raw()) && value("Name:").is_some_and(|name| name.trim() == PROGRAM)
}

#[cfg(test)]
mod tests {
    use std::sync::{
        atomic::{AtomicBool, Ordering},
        mpsc::channel,
    };

    use rustix::fs::{CWD, FileType, Mode, mknodat};

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
    fn a_fifo_in_the_place_of_a_lock_keeps_nobody_waiting() {
        let prefix: Prefix = format!("t{}-fifo", std::process::id()).parse().unwrap();
        let folder = prefix.folder();
        std::fs::create_dir_all(&folder).unwrap();
        mknodat(CWD, folder.join(MEMBERS), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
        let (said, saying) = channel();
        let looked = std::thread::spawn(move || said.send(matches!(lock(&prefix, false), Lock::Missing)));
        let is_missing = saying.recv_timeout(Duration::from_secs(5));
        // A thread that still waits gets its writer.
        let _ = OpenOptions::new().write(true).custom_flags(OFlags::NONBLOCK.bits() as i32).open(folder.join(MEMBERS));
        looked.join().unwrap().ok();
        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(is_missing, Ok(true));
    }

    #[test]
    fn a_dead_group_is_removed_while_others_look_whether_it_lives() {
        let prefix: Prefix = format!("t{}-looked-at", std::process::id()).parse().unwrap();
        let stop = AtomicBool::new(false);
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    while !stop.load(Ordering::Relaxed) {
                        drop(lock(&prefix, false));
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
