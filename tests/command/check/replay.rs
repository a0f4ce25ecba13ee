//! Records that are replayed.

use std::fs;

use tempfile::TempDir;

use super::{
    BOOM_SINES, EXCAVATOR,
    cli::{expect_refusal, success},
    folder_with, replaced,
};

/// A folder with the example, which replays `r.csv`; the file is written if there are `rows`.
fn with_replay(rows: Option<&str>) -> TempDir {
    let folder = folder_with(&replaced(EXCAVATOR, "kind = \"sim\" ", "kind = \"replay\"\nfile = \"r.csv\" "));
    if let Some(rows) = rows {
        fs::write(folder.path().join("r.csv"), format!("t,u,y\n{rows}")).unwrap();
    }
    folder
}

#[test]
fn a_record_to_replay_is_accepted() {
    let text = success(with_replay(Some("0,0,0.5\n0.01,0,0.5\n")).path(), &["check", "m.toml"]);
    assert!(text.contains("replayed from r.csv"), "{text}");
}

#[test]
fn a_missing_record_to_replay_is_refused_with_its_file() {
    let expected = ["r.csv: ", "No such file or directory"];
    expect_refusal(with_replay(None).path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_missing_record_to_replay_is_refused_with_its_key() {
    expect_refusal(with_replay(None).path(), &["check", "m.toml"], &["source.file"]);
}

#[test]
fn a_missing_record_to_replay_is_refused_with_what_is_allowed() {
    expect_refusal(with_replay(None).path(), &["check", "m.toml"], &["r.csv", "allowed: "]);
}

#[test]
fn a_bad_row_of_a_record_to_replay_is_refused() {
    let expected = ["r.csv:3: row 2, column \"y\": found \"x\"; allowed: a finite number"];
    expect_refusal(with_replay(Some("0,0,0.5\n0.01,0,x\n")).path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_record_of_another_period_is_refused() {
    let expected = ["r.csv: found a period of 0.020000 s; allowed: ", "timing.period = 0.010000 s"];
    expect_refusal(with_replay(Some("0,0,0.5\n0.02,0,0.5\n")).path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_trajectory_and_a_record_that_are_both_missing_are_reported_at_once() {
    let folder = with_replay(None);
    let file = folder.path().join("m.toml");
    let text = fs::read_to_string(&file).unwrap();
    fs::write(&file, replaced(&text, BOOM_SINES, "kind = \"trajectory\"\nfile = \"path.csv\"")).unwrap();
    expect_refusal(folder.path(), &["check", "m.toml"], &["path.csv: ", "r.csv: "]);
}
