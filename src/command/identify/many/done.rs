//! The lines that a file has already.

use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, Read},
    path::Path,
};

use serde::{Deserialize, de::IgnoredAny};

use crate::failure::Failure;

/// The part of a line that says what it is about.
#[derive(Deserialize)]
struct Head {
    file: String,
    sha256: Option<String>,
    options: Vec<String>,
    error: Option<IgnoredAny>,
}

/// What was identified before, and whether it failed.
#[derive(Default)]
pub(super) struct Done(BTreeMap<(String, String, Vec<String>), bool>);

impl Done {
    /// Reads the lines, and removes a last one that is torn.
    ///
    /// # Errors
    /// The file cannot be read, or has another line that is none of this command.
    pub(super) fn read(file: &mut File, path: &Path) -> Result<Self, Failure> {
        let refuse = |what: String| Failure::usage(format!("--jsonl: {}: {what}", path.display()));
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).map_err(|error| refuse(error.to_string()))?;
        let whole = bytes.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
        if whole < bytes.len() {
            file.set_len(whole as u64).map_err(|error: io::Error| refuse(error.to_string()))?;
        }
        let mut done = BTreeMap::new();
        for (number, line) in bytes[..whole].split(|byte| *byte == b'\n').enumerate() {
            if line.is_empty() {
                continue;
            }
            let Ok(head) = serde_json::from_slice::<Head>(line) else {
                let what = match serde_json::from_slice::<IgnoredAny>(line) {
                    Ok(_) => "another JSON",
                    Err(_) => "no JSON",
                };
                let allowed = "lines that `hydraxis identify --jsonl` has written";
                return Err(refuse(format!("line {}: found {what}; allowed: {allowed}", number + 1)));
            };
            // A file that could not be read is tried again.
            if let Some(hash) = head.sha256 {
                done.insert((head.file, hash, head.options), head.error.is_some());
            }
        }
        Ok(Self(done))
    }

    /// Whether this file failed with these options before; none if it was not tried, or has changed since.
    pub(super) fn failed(&self, file: &str, hash: &str, options: &[String]) -> Option<bool> {
        self.0.get(&(file.to_owned(), hash.to_owned(), options.to_vec())).copied()
    }
}
