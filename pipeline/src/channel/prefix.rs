//! The name of a group.

use std::{
    ffi::OsString,
    fmt,
    path::{Path, PathBuf},
    str::FromStr,
};

use thiserror::Error;

/// Folder in which shared memory has its names.
pub(super) const SHARED_MEMORY: &str = "/dev/shm";
/// First part of the name of a group's folder.
pub(super) const FOLDER: &str = "hydraxis.";

/// The name of a group; it becomes part of file names.
///
/// ```
/// use pipeline::channel::Prefix;
///
/// let prefix: Prefix = "excavator-1".parse()?;
/// assert_eq!(prefix.to_string(), "excavator-1");
/// assert!("a/b".parse::<Prefix>().is_err());
/// # Ok::<(), pipeline::channel::PrefixError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Prefix(String);

/// A text that is no prefix.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("prefix: found \"{found}\"; allowed: 1 to 32 letters, digits, - and _")]
pub struct PrefixError {
    /// The text.
    pub found: String,
}

impl FromStr for Prefix {
    type Err = PrefixError;

    fn from_str(text: &str) -> Result<Self, PrefixError> {
        let valid =
            (1..=32).contains(&text.len()) && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
        if valid { Ok(Self(text.to_owned())) } else { Err(PrefixError { found: text.to_owned() }) }
    }
}

impl fmt::Display for Prefix {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Where groups have their folders: `TMPDIR`, or `/dev/shm`.
///
/// Trap: whoever joins a group writes small files that iceoryx2 forces to the disk. In a folder on a disk that others
/// keep busy, a stage that starts again and a program that operates wait for tens of seconds.
pub fn place() -> PathBuf {
    place_of(std::env::var_os("TMPDIR"))
}

fn place_of(set: Option<OsString>) -> PathBuf {
    let memory = || Some(PathBuf::from(SHARED_MEMORY)).filter(|memory| memory.is_dir());
    let set = set.filter(|set| !set.is_empty()).map(PathBuf::from);
    set.or_else(memory).unwrap_or_else(|| Path::new("/tmp").to_owned())
}

impl Prefix {
    /// A prefix that no other running process has.
    pub fn of_this_process() -> Self {
        Self(format!("hydraxis-{}", std::process::id()))
    }

    /// Folder of the group's static files.
    pub fn folder(&self) -> PathBuf {
        place().join(format!("{FOLDER}{}", self.0))
    }

    /// First part of the names of the group's shared memory. The dot keeps prefix `a` apart from prefix `ab`.
    pub(super) fn file_prefix(&self) -> String {
        format!("{}.", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_have_their_folders_in_memory_unless_they_are_told_another_place() {
        let found = rustix::fs::statfs(place_of(None)).unwrap();
        const TMPFS: i64 = 0x0102_1994;
        assert_eq!(found.f_type as i64, TMPFS, "joining would wait for a disk");
        assert_eq!(place_of(Some("".into())), place_of(None));
        assert_eq!(place_of(Some("/run/hydraxis".into())), Path::new("/run/hydraxis"));
    }
}
