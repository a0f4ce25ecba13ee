//! `hydraxis check`: good machine files, and machine files with every kind of mistake. The refusal names file, line,
//! key, what was found and what is allowed, for all mistakes at once.

mod explain;
mod identification;
mod limits;
mod machine_files;
mod margins;
mod model_files;
mod plausible;
mod references;
mod replay;
mod settings;
mod trajectories;
mod units;

use std::fs;

use tempfile::TempDir;

use crate::harness::cli::{self, expect_refusal};

const EXCAVATOR: &str = include_str!("../../examples/four-axes.toml");
/// Lines of the boom's reference, from its kind to its last sine.
const BOOM_SINES: &str = "kind = \"sines\"
center = 0.65
sines = [
  { amplitude = 0.12, frequency = 0.11 },
  { amplitude = 0.05, frequency = 0.29, phase = 1.0 },
  { amplitude = 0.02, frequency = 0.71, phase = 2.0 },
]";
/// Lines of the arm's reference.
const ARM_SINES: &str = "kind = \"sines\"
center = 0.75
sines = [
  { amplitude = 0.13, frequency = 0.13, phase = 0.5 },
  { amplitude = 0.05, frequency = 0.31, phase = 1.5 },
  { amplitude = 0.02, frequency = 0.67, phase = 2.5 },
]";

/// The text with the first `from` replaced. It panics where `from` is missing.
fn replaced(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "the machine file has no {from:?}");
    text.replacen(from, to, 1)
}

/// Number of the line with the first `wanted` in the example, from 1.
fn line_of(wanted: &str) -> usize {
    1 + EXCAVATOR[..EXCAVATOR.find(wanted).expect(wanted)].matches('\n').count()
}

/// A folder with this text as `m.toml`.
fn folder_with(text: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("m.toml"), text).unwrap();
    folder
}

/// Expects a refusal of the example with `from` replaced. The message names the line of `from`, and then `expected`.
fn expect_broken(from: &str, to: &str, expected: &str) {
    let folder = folder_with(&replaced(EXCAVATOR, from, to));
    expect_refusal(folder.path(), &["check", "m.toml"], &[&format!("m.toml:{}: {expected}", line_of(from))]);
}

fn expect_four_axes(text: &str) {
    for axis in ["boom", "arm", "telescope", "bucket"] {
        assert!(text.contains(axis), "{axis} in {text}");
    }
    assert!(text.contains("4 axes") && text.contains("no problem found"), "{text}");
}
