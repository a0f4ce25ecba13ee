//! The folder of a group: it belongs to this user, and no other user can look into it.
//!
//! The folder lies where all users may make folders. So another user may have made one of that name before, or a link.
//! In a folder of mode 0700 of this user, no other user can open, lock or remove a file.

use std::{
    fmt,
    fs::DirBuilder,
    io::{Error, ErrorKind},
    os::unix::fs::{DirBuilderExt, MetadataExt},
    path::{Path, PathBuf},
};

use rustix::process::geteuid;
use thiserror::Error;

/// Mode of the folder.
const MODE: u32 = 0o700;
/// Bits of a mode that give rights to others than the owner.
const OTHERS: u32 = 0o077;

/// A folder or file that stands in the place of one of ours.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum Foreign {
    /// It is no folder.
    #[error("found {}, which is no folder; allowed: a group's folder, or nothing: remove it, or take another --prefix",
        .path.display())]
    NotAFolder {
        /// The path.
        path: PathBuf,
    },
    /// It is a link.
    #[error("found {}, which is a link; allowed: a folder, or nothing: type rm {0}, or take another --prefix",
        .path.display())]
    Link {
        /// The path.
        path: PathBuf,
    },
    /// It belongs to another user.
    #[error(
        "found {} of user {owner}; allowed: files of user {own}, or nothing: remove it as that user or as root, or \
         take another --prefix", .path.display()
    )]
    Owner {
        /// The path.
        path: PathBuf,
        /// User that it belongs to.
        owner: u32,
        /// User of this process.
        own: u32,
    },
    /// Other users have rights to it.
    #[error(
        "found {} with mode {mode:04o}; allowed: mode 0700: end the group, type rm -r {0}, and start it again",
        .path.display()
    )]
    Mode {
        /// The path.
        path: PathBuf,
        /// Its mode.
        mode: u32,
    },
}

/// Why the folder of a group, or a file of the group, cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum UnusableFolder {
    /// Something else is there.
    #[error(transparent)]
    Foreign(#[from] Foreign),
    /// It cannot be made or written.
    #[error("the folder {} cannot be used: {source}", folder.display())]
    System {
        /// The group's folder.
        folder: PathBuf,
        /// What the operating system said.
        source: Error,
    },
}

impl UnusableFolder {
    /// The operating system refuses.
    pub(super) fn refused(folder: &Path) -> impl Fn(Error) -> Self {
        |source| Self::System { folder: folder.to_owned(), source }
    }
}

/// Makes the folder if it is not there; refuses one that is not private.
pub(super) fn make(folder: &Path) -> Result<(), UnusableFolder> {
    if let Some(parent) = folder.parent() {
        std::fs::create_dir_all(parent).map_err(UnusableFolder::refused(folder))?;
    }
    match DirBuilder::new().mode(MODE).create(folder) {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
        Err(error) => return Err(UnusableFolder::refused(folder)(error)),
    }
    examine(folder).map_err(UnusableFolder::from)
}

/// Refuses a folder that is not private. One that is not there is no fault.
pub(super) fn examine(folder: &Path) -> Result<(), Foreign> {
    let Ok(found) = folder.symlink_metadata() else { return Ok(()) };
    let path = folder.to_owned();
    if found.is_symlink() {
        return Err(Foreign::Link { path });
    }
    if !found.is_dir() {
        return Err(Foreign::NotAFolder { path });
    }
    owned(folder)?;
    let mode = found.mode() & 0o7777;
    if mode & OTHERS == 0 { Ok(()) } else { Err(Foreign::Mode { path, mode }) }
}

/// Refuses a path that belongs to another user. One that is not there is no fault.
pub(super) fn owned(path: &Path) -> Result<(), Foreign> {
    let own = geteuid().as_raw();
    match path.symlink_metadata() {
        Ok(found) if found.uid() != own => Err(Foreign::Owner { path: path.to_owned(), owner: found.uid(), own }),
        _ => Ok(()),
    }
}

/// A path of a group that another user can reach, or that belongs to another user.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exposed {
    /// The path.
    pub path: PathBuf,
    /// User that it belongs to.
    pub owner: u32,
    /// Whether it belongs to another user than that of this process.
    pub is_foreign: bool,
    /// Its mode.
    pub mode: u32,
}

impl Exposed {
    /// What is exposed of a path; nothing where only the user of this process has rights to it.
    pub(super) fn of(path: PathBuf) -> Option<Self> {
        let found = path.symlink_metadata().ok()?;
        let (owner, mode) = (found.uid(), found.mode() & 0o7777);
        let is_foreign = owner != geteuid().as_raw();
        let is_open = found.is_symlink() || mode & OTHERS != 0;
        (is_foreign || is_open).then_some(Self { path, owner, is_foreign, mode })
    }
}

impl fmt::Display for Exposed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} (user {}, mode {:04o})", self.path.display(), self.owner, self.mode)
    }
}
