//! The name of a group.

use std::{fmt, path::PathBuf, str::FromStr};

use thiserror::Error;

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

impl Prefix {
    /// A prefix that no other running process has.
    pub fn of_this_process() -> Self {
        Self(format!("hydraxis-{}", std::process::id()))
    }

    /// Folder of the group's static files.
    pub fn folder(&self) -> PathBuf {
        std::env::temp_dir().join(format!("{FOLDER}{}", self.0))
    }

    /// First part of the names of the group's shared memory. The dot keeps prefix `a` apart from prefix `ab`.
    pub(super) fn file_prefix(&self) -> String {
        format!("{}.", self.0)
    }
}
