//! Mistyped command lines and machine files. The answer names the place, what was found, what is allowed or the nearest
//! name, and what to type next; it has at most three lines for one mistake.

mod commands;
mod files;
mod groups;
mod keys;
mod lines;
mod values;

use std::{fs, path::Path};

use tempfile::TempDir;

use super::harness::cli::{run, success};

/// Most lines of an answer to one mistake.
const MOST_LINES: usize = 3;
/// The flags of a rig, without the file.
const RIG: &str = "init --axes cylinder --stroke 0.5 --bore 50mm --rod 30mm --valve-hz 8 --dead-time 40ms";

/// A mistyped command line, and parts of the answer in their order. Words are separated by spaces; a word with spaces,
/// and an empty one, stands between apostrophes.
type Row = (&'static str, &'static [&'static str]);

/// A folder with good and bad files of every kind.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &[u8]| fs::write(folder.path().join(name), text).unwrap();
    write("four.toml", pipeline::machine::FOUR_AXES.as_bytes());
    write("excavator.toml", pipeline::machine::BUILT_IN.as_bytes());
    write("model.toml", include_bytes!("../../examples/excavator-model.toml"));
    for (name, source) in [("rig.toml", "sim"), ("external.toml", "external")] {
        success(folder.path(), &words(&format!("{RIG} --source {source} --output {name}")));
    }
    let rows: String = (0..400).map(|k| format!("{:.2},{:.1},{:.3}\n", 0.01 * k as f64, 0.1, 0.5)).collect();
    write("record.csv", format!("t,u,y\n{rows}").as_bytes());
    write("words.csv", b"t,u,y\n0.00,0.1,0.5\n0.01,zero,0.5\n");
    write("motion.csv", b"t,boom.command,boom.position\n0,0,0.5\n0.01,0,0.5\n");
    write("states.json", b"{\"states\": 3}");
    let bytes: Vec<u8> = (0..=255).cycle().take(2048).collect();
    for name in ["binary.toml", "binary.csv"] {
        write(name, &bytes);
    }
    for name in ["empty.toml", "empty.csv"] {
        write(name, b"");
    }
    fs::create_dir(folder.path().join("folder")).unwrap();
    folder
}

/// The words of a command line.
fn words(line: &str) -> Vec<&str> {
    let mut words = Vec::new();
    for (index, part) in line.split('\'').enumerate() {
        match index % 2 {
            0 => words.extend(part.split(' ').filter(|word| !word.is_empty())),
            _ => words.push(part),
        }
    }
    words
}

/// What is wrong with the answer to a command line, if anything is.
fn fault(folder: &Path, line: &str, expected: &[&str]) -> Option<String> {
    let output = run(folder, &words(line));
    let (said, shown) = (String::from_utf8_lossy(&output.stderr), String::from_utf8_lossy(&output.stdout));
    let refuse = |what: &str| Some(format!("hydraxis {line}\n  {what} in:\n{said}{shown}"));
    if !matches!(output.status.code(), Some(1 | 2)) {
        return refuse(&format!("exit code {:?}", output.status.code()));
    }
    if said.contains("panicked") || !shown.is_empty() {
        return refuse("a panic, or an output");
    }
    if said.lines().count() > MOST_LINES {
        return refuse(&format!("more than {MOST_LINES} lines"));
    }
    missing(&said, expected).and_then(|part| refuse(&format!("no {part:?}")))
}

/// The first part that the text has not, or not after the part before it.
fn missing<'p>(text: &str, parts: &[&'p str]) -> Option<&'p str> {
    let mut rest = text;
    for part in parts {
        let Some(place) = rest.find(part) else { return Some(part) };
        rest = &rest[place + part.len()..];
    }
    None
}

/// Expects the answers of a table.
fn expect(rows: &[Row]) {
    let folder = folder();
    let faults = rows.iter().filter_map(|(line, expected)| fault(folder.path(), line, expected));
    judge(rows.len(), faults.collect());
}

/// Fails with all faults of a table.
fn judge(rows: usize, faults: Vec<String>) {
    println!("{rows} rows, {} with a bad answer", faults.len());
    assert!(faults.is_empty(), "{} of {rows} answers:\n{}", faults.len(), faults.join("\n"));
}
