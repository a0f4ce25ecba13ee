//! What is wrong with a machine file.

use std::{borrow::Cow, fmt};

/// Number of problems that are shown; a file that is no machine file has one in every line.
const MAX_SHOWN: usize = 30;
/// Longest key, and longest text about what was found, characters. Both quote the file, in which a line has any length.
const LONGEST: usize = 500;

/// One problem of a machine file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Name of the file, where it is another one than the machine file.
    pub file: Option<String>,
    /// Line of the file, where the problem has one.
    pub line: Option<usize>,
    /// Full dotted key, empty for the file as a whole.
    pub key: String,
    /// What was found.
    pub found: String,
    /// What is allowed.
    pub allowed: String,
}

/// All problems of a machine file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MachineError {
    /// Name of the file, as the user typed it.
    pub file: String,
    /// At least one problem.
    pub problems: Vec<Problem>,
}

impl MachineError {
    /// One problem of a file as a whole.
    pub(super) fn of_file(file: String, found: impl Into<String>, allowed: impl Into<String>) -> Self {
        let problem =
            Problem { file: None, line: None, key: String::new(), found: found.into(), allowed: allowed.into() };
        Self { file, problems: vec![problem] }
    }
}

impl fmt::Display for MachineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.problems.iter().take(MAX_SHOWN).enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{}:", problem.file.as_ref().unwrap_or(&self.file))?;
            if let Some(line) = problem.line {
                write!(f, "{line}:")?;
            }
            if !problem.key.is_empty() {
                write!(f, " {}:", cut(&problem.key))?;
            }
            write!(f, " found {}; allowed: {}", cut(&problem.found), problem.allowed)?;
        }
        match self.problems.len().checked_sub(MAX_SHOWN) {
            None | Some(0) => Ok(()),
            Some(more) => write!(f, "\n{}: and {more} more", self.file),
        }
    }
}

/// A text of at most [`LONGEST`] characters.
fn cut(text: &str) -> Cow<'_, str> {
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{}..", &text[..end]).into(),
        None => text.into(),
    }
}

impl std::error::Error for MachineError {}
