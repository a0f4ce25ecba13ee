//! The load of the computer, and the file with the figures.

use std::{fs, path::Path};

use serde_json::Value;

/// Mean number of processes that wanted to run in the last minute; part of every report, because other processes
/// disturb the times.
pub fn load() -> String {
    let text = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').next().unwrap_or_default().to_owned()
}

/// Writes the figures to the file that `--json` names, if it was given.
pub fn write(file: Option<&Path>, figures: &Value) {
    if let Some(file) = file {
        let text = serde_json::to_string_pretty(figures).expect("plain figures");
        fs::write(file, text).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    }
}
