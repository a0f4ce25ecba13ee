//! References that are read from a file.

use std::fs;

use tempfile::TempDir;

use super::{
    ARM_SINES, BOOM_SINES, EXCAVATOR,
    cli::{expect_refusal, success},
    expect_four_axes, folder_with, replaced,
};

/// A folder with the example, whose boom has its reference in `path.csv`; the file is written if there are `rows`.
fn with_trajectory(rows: Option<&str>) -> TempDir {
    let folder = folder_with(&replaced(EXCAVATOR, BOOM_SINES, "kind = \"trajectory\"\nfile = \"path.csv\""));
    if let Some(rows) = rows {
        fs::write(folder.path().join("path.csv"), format!("t,boom\n{rows}")).unwrap();
    }
    folder
}

#[test]
fn a_trajectory_is_accepted() {
    expect_four_axes(&success(with_trajectory(Some("0,0.65\n1,0.7\n")).path(), &["check", "m.toml"]));
}

#[test]
fn a_missing_trajectory_is_refused_with_its_key_and_file() {
    let expected = ["axis.boom.reference", "path.csv: ", "No such file or directory"];
    expect_refusal(with_trajectory(None).path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_missing_trajectory_is_refused_with_what_is_allowed() {
    expect_refusal(with_trajectory(None).path(), &["check", "m.toml"], &["path.csv", "allowed: "]);
}

#[test]
fn a_bad_row_of_a_trajectory_is_refused_with_its_column() {
    let expected = ["axis.boom.reference", "path.csv", "column \"boom\": found \"nan\"; allowed: a finite number"];
    expect_refusal(with_trajectory(Some("0,0.65\n1,nan\n")).path(), &["check", "m.toml"], &expected);
}

#[test]
fn a_bad_row_of_a_trajectory_is_refused_with_its_line() {
    expect_refusal(with_trajectory(Some("0,0.65\n1,nan\n")).path(), &["check", "m.toml"], &["path.csv:3: "]);
}

#[test]
fn a_trajectory_outside_the_soft_limits_is_refused() {
    let expected =
        ["axis.boom.reference", "path.csv", "found 9; allowed: positions in the soft limits, 0.05 to 1.284 m"];
    expect_refusal(with_trajectory(Some("0,0.65\n1,9\n")).path(), &["check", "m.toml"], &expected);
}

#[test]
fn bad_rows_of_a_trajectory_are_reported_at_once() {
    let expected = ["found \"nan\"", "found \"inf\"", "found \"x\""];
    expect_refusal(with_trajectory(Some("0,nan\n1,inf\nx,0.65\n")).path(), &["check", "m.toml"], &expected);
}

#[test]
fn missing_trajectories_of_two_axes_are_reported_at_once() {
    let boom = replaced(EXCAVATOR, BOOM_SINES, "kind = \"trajectory\"\nfile = \"path.csv\"");
    let folder = folder_with(&replaced(&boom, ARM_SINES, "kind = \"trajectory\"\nfile = \"way.csv\""));
    let expected = ["axis.boom.reference", "path.csv", "axis.arm.reference", "way.csv"];
    expect_refusal(folder.path(), &["check", "m.toml"], &expected);
}
