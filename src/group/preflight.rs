//! Checks before the first process of a run starts, so that the user sees everything that is wrong at once: the name of
//! the group, the folders that it needs, the programs that replace stages, and the rights that the machine file
//! demands.
//!
//! Runs once, before the loop.

use std::{
    env::split_paths,
    path::{Path, PathBuf},
};

use pipeline::{
    channel::{Claim, ClaimError, Prefix, RemoveError},
    machine::Machine,
    stage::{Clock, StageKind, missing},
};
use rustix::{
    fs::{Access, access, statvfs},
    io::Errno,
};
use thiserror::Error;

/// Shared memory that a group may need, bytes.
pub const SHARED_MEMORY: u64 = 32 << 20;
/// Space that the small files of a group need, bytes.
const SMALL_FILES: u64 = 1 << 20;

/// Why a run cannot start.
#[derive(Debug, Error)]
pub enum PreflightError {
    /// Another run has the name, or something else its folder.
    #[error(transparent)]
    Claim(#[from] ClaimError),
    /// A group of this name runs already, or what it left cannot be removed.
    #[error(transparent)]
    Leftovers(#[from] RemoveError),
    /// A folder that every group needs is not usable.
    #[error(transparent)]
    Folder(#[from] FolderError),
    /// The folder of the log is not usable.
    #[error("--log-folder: {0}")]
    LogFolder(FolderError),
    /// A file that is to be made is there already.
    #[error("{option}: {}: found a file; allowed: a new one", .path.display())]
    Exists {
        /// The option that names it.
        option: &'static str,
        /// The file.
        path: PathBuf,
    },
    /// The folder of a file that is to be made is not usable.
    #[error("{option}: {source}")]
    FolderOfFile {
        /// The option that names the file.
        option: &'static str,
        /// What is wrong.
        source: FolderError,
    },
    /// The program that replaces a stage cannot be executed.
    #[error(
        "{key}: found \"{program}\", which cannot be executed; allowed: a program by its path, or by \
         its name in one of the folders of PATH"
    )]
    Program {
        /// The key of the machine file.
        key: String,
        /// The program.
        program: String,
    },
    /// The machine file demands a right that this process does not have.
    #[error("{0} (the machine file is strict)")]
    Right(String),
}

/// Why files cannot be created in a folder.
#[derive(Debug, Error)]
pub enum FolderError {
    /// There is no folder of this name.
    #[error("{}: found no folder; allowed: a folder for {purpose}", .folder.display())]
    Absent {
        /// The folder.
        folder: PathBuf,
        /// What it is needed for.
        purpose: &'static str,
    },
    /// This user may not create files in it.
    #[error("{}: found a folder that cannot be written ({source}); allowed: a folder for {purpose}", .folder.display())]
    NotWritable {
        /// The folder.
        folder: PathBuf,
        /// What it is needed for.
        purpose: &'static str,
        /// What the system says.
        source: Errno,
    },
    /// It has too little space.
    #[error("{}: found {free} bytes free; allowed: at least {needed} bytes for {purpose}", .folder.display())]
    Full {
        /// The folder.
        folder: PathBuf,
        /// What it is needed for.
        purpose: &'static str,
        /// Free space, bytes.
        free: u64,
        /// Space that is needed, bytes.
        needed: u64,
    },
}

/// Checks the folders of the group's files. Removes what a dead group of the claimed name has left.
pub fn folders(prefix: &Prefix, claim: Option<&Claim>, log_folder: Option<&Path>) -> Vec<PreflightError> {
    let mut errors = Vec::new();
    let left = claim.and_then(|claim| claim.remove_leftovers().err());
    errors.extend(left.map(PreflightError::from));
    errors.extend(folder(Path::new("/dev/shm"), SHARED_MEMORY, "the channels").err().map(PreflightError::from));
    let own = prefix.folder();
    let temporary = own.parent().unwrap_or(Path::new("/"));
    errors.extend(folder(temporary, SMALL_FILES, "the group's files").err().map(PreflightError::from));
    if let Some(wanted) = log_folder {
        // A folder that does not exist is created in the first folder above it that does.
        let existing = wanted.ancestors().map(current).find(|folder| folder.exists()).unwrap_or(wanted);
        errors.extend(folder(existing, SMALL_FILES, "the log").err().map(PreflightError::LogFolder));
    }
    errors
}

/// Checks that a new file can be made.
///
/// # Errors
/// It is there, or its folder is not usable.
pub fn new_file(option: &'static str, path: &Path) -> Result<(), PreflightError> {
    if path.symlink_metadata().is_ok() {
        return Err(PreflightError::Exists { option, path: path.to_owned() });
    }
    let parent = current(path.parent().unwrap_or(Path::new("/")));
    folder(parent, SMALL_FILES, "the recording").map_err(|source| PreflightError::FolderOfFile { option, source })
}

/// Checks the programs that replace these stages.
pub fn programs(machine: &Machine, kinds: impl IntoIterator<Item = StageKind>) -> Vec<PreflightError> {
    let broken = kinds.into_iter().filter_map(|kind| {
        let program = machine.stage(kind).command.as_ref().and_then(|words| words.first());
        let program = program.filter(|program| !is_executable(program))?;
        Some(PreflightError::Program { key: machine.command_key(kind), program: program.clone() })
    });
    broken.collect()
}

/// Checks the rights that the machine file asks for: those that it demands, as errors, and the others, as warnings.
pub fn rights(machine: &Machine, clock: Clock) -> (Vec<PreflightError>, Vec<String>) {
    let (strict, others): (Vec<_>, Vec<_>) = missing(machine, clock).into_iter().partition(|right| right.strict);
    let errors = strict.into_iter().map(|right| PreflightError::Right(right.text));
    (errors.collect(), others.into_iter().map(|right| right.text).collect())
}

/// The folder itself; `.` for an empty path, which means the working folder of this process.
fn current(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

/// Whether files of `needed` bytes can be created in a folder.
fn folder(folder: &Path, needed: u64, purpose: &'static str) -> Result<(), FolderError> {
    let path = folder.to_owned();
    if !folder.is_dir() {
        return Err(FolderError::Absent { folder: path, purpose });
    }
    if let Err(source) = access(folder, Access::WRITE_OK | Access::EXEC_OK) {
        return Err(FolderError::NotWritable { folder: path, purpose, source });
    }
    let free = statvfs(folder).map(|found| found.f_bavail.saturating_mul(found.f_frsize));
    match free {
        Ok(free) if free < needed => Err(FolderError::Full { folder: path, purpose, free, needed }),
        // Where the system does not say how much space there is, the first write will tell.
        _ => Ok(()),
    }
}

fn is_executable(program: &str) -> bool {
    let is_one = |path: &Path| path.is_file() && access(path, Access::EXEC_OK).is_ok();
    if program.contains('/') {
        return is_one(Path::new(program));
    }
    let folders = std::env::var_os("PATH").unwrap_or_default();
    split_paths(&folders).any(|folder| is_one(&folder.join(program)))
}
