//! Trajectory and picture of the closed loop.

use std::fs;

use super::{
    Trajectory,
    cli::{expect_refusal, success},
    folder_with,
    harness::{FOUR_AXES, report},
    trajectory,
};

#[test]
fn a_trajectory_has_a_row_per_tick_and_what_the_controller_knows() {
    let folder = tempfile::tempdir().unwrap();
    let found = trajectory(folder.path(), &[FOUR_AXES, "--duration", "10s", "--trajectory", "-"]);
    assert_eq!(found.names.len(), 2 + 4 * 11);
    let expected: Vec<f64> = (0..1000).map(|tick| f64::from(tick) / 100.0).collect();
    assert_eq!(found.column("t"), expected);
    let (reference, error) = (found.column("boom.reference"), found.column("boom.error"));
    for (row, (position, measured)) in
        found.column("boom.position").iter().zip(reference.iter().zip(error).map(|(y, e)| y - e)).enumerate()
    {
        // Half a count of the encoder, and noise of 0.03 mm.
        assert!((position - measured).abs() < 0.3e-3, "row {row}: {position} {measured}");
    }
    let mode = found.column("boom.mode");
    assert_eq!((mode[0], mode[500], mode[999]), (0.0, 1.0, 2.0), "neutral, fallback, model");
}

#[test]
fn recording_a_trajectory_changes_no_figure() {
    let folder = tempfile::tempdir().unwrap();
    let (csv, svg) = (folder.path().join("y.csv"), folder.path().join("y.svg"));
    let (csv, svg) = (csv.to_str().unwrap(), svg.to_str().unwrap());
    let arguments = ["simulate", "--duration", "3s"];
    let kept = report(&[&arguments[..], &["--trajectory", csv, "--plot", svg]].concat());
    assert_eq!(kept, report(&arguments));
    assert_eq!(Trajectory::read(&fs::read_to_string(csv).unwrap()).rows.len(), 300);
}

#[test]
fn a_trajectory_on_standard_output_is_alone_there() {
    let folder = tempfile::tempdir().unwrap();
    let text = success(folder.path(), &["simulate", "--duration", "1s", "--trajectory", "-"]);
    assert_eq!(text.lines().count(), 101);
}

#[test]
fn an_axis_by_name_is_alone_in_trajectory_and_picture() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["--duration", "1s", "--axis", "bucket", "--axis", "arm", "--plot", "y.svg", "--trajectory", "-"];
    let found = trajectory(folder.path(), &arguments);
    assert_eq!(found.names.len(), 2 + 2 * 11);
    assert_eq!((found.names[2].as_str(), found.names[13].as_str()), ("arm.command", "bucket.command"));
    let picture = fs::read_to_string(folder.path().join("y.svg")).unwrap();
    assert!(picture.contains("\narm\n") && picture.contains("\nbucket\n") && !picture.contains("boom"), "{picture}");
}

#[test]
fn a_picture_names_axes_and_units_and_needs_nothing_from_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let picture = success(folder.path(), &["simulate", "--duration", "1s", "--plot", "-"]);
    for text in ["boom", "arm", "telescope", "bucket", "reference", "valve command", "position, mm", "time, s"] {
        assert!(picture.contains(&format!("\n{text}\n")), "{text}");
    }
    assert!(picture.contains("20 t excavator, scenario nominal"));
    assert_eq!(picture.matches("http").count(), 1, "the name space of SVG alone");
    assert!(picture.trim_end().ends_with("</svg>"));
}

/// Width and height of a PNG file, which has them at the begin of its first chunk.
fn size_of_png(bytes: &[u8]) -> (u32, u32) {
    assert_eq!(&bytes[..8], b"\x89PNG\r\n\x1a\n");
    let number = |at: usize| u32::from_be_bytes(bytes[at..at + 4].try_into().unwrap());
    (number(16), number(20))
}

#[test]
fn a_closed_loop_is_drawn_with_its_errors_and_who_commands() {
    let folder = tempfile::tempdir().unwrap();
    let picture = success(folder.path(), &["simulate", "--duration", "1s", "--plot", "-"]);
    for text in ["following error, mm", "commanded by", "neutral or latched", "fallback", "model"] {
        assert!(picture.contains(&format!("\n{text}\n")), "{text}");
    }
}

#[test]
fn a_trajectory_is_drawn_as_simulate_draws_it() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["--duration", "3s", "--axis", "arm", "--trajectory", "y.csv", "--plot", "y.svg"];
    success(folder.path(), &[&["simulate", FOUR_AXES][..], &arguments].concat());
    let drawn = success(folder.path(), &["plot", "y.csv", "--output", "-"]);
    let curves = |picture: &str| {
        let curves = picture.lines().filter(|line| line.starts_with("<polyline") && line.len() > 500);
        let points = curves.filter_map(|line| line.split("points=").nth(1).map(str::to_owned));
        points.collect::<Vec<_>>()
    };
    let simulated = fs::read_to_string(folder.path().join("y.svg")).unwrap();
    assert!(curves(&simulated).len() >= 3 && curves(&drawn) == curves(&simulated), "{drawn}");
    assert!(drawn.contains("\ny.csv\n") && drawn.contains("\narm\n"));

    success(folder.path(), &["plot", "y.csv", "--output", "y.png"]);
    let (width, height) = size_of_png(&fs::read(folder.path().join("y.png")).unwrap());
    assert!(width == 1600 && height > 1000, "{width} {height}");
}

#[test]
fn a_trajectory_without_a_controller_has_commands_and_positions() {
    let folder = folder_with("y.csv", "t,lift.command,lift.position\n0,0,0.1\n1,0.5,0.1\n2,0.5,0.2\n");
    let picture = success(folder.path(), &["plot", "y.csv", "--output", "-"]);
    assert!(picture.contains("\nlift\n") && picture.contains("\n200\n") && !picture.contains("reference"), "{picture}");
}

#[test]
fn what_is_no_picture_or_no_trajectory_is_refused() {
    let folder = folder_with("u.csv", "t,boom\n0,0\n");
    expect_refusal(folder.path(), &["simulate", "--plot", "y.pdf"], &["--plot", "y.pdf", ".svg", ".png"]);
    expect_refusal(folder.path(), &["plot", "u.csv", "--output", "y"], &["--output", "\"y\"", ".svg", ".png"]);
    expect_refusal(folder.path(), &["plot", "u.csv", "--output", "y.svg"], &["u.csv", "AXIS.position", "--trajectory"]);
    let folder = folder_with("y.csv", "t,arm.command,arm.position\n");
    expect_refusal(folder.path(), &["plot", "y.csv", "--output", "y.svg"], &["y.csv", "one row or more"]);
    let other = ["plot", "y.csv", "--output", "y.svg", "--axis", "boom"];
    expect_refusal(folder.path(), &other, &["--axis", "\"boom\"", "arm"]);
    assert!(!folder.path().join("y.svg").exists());
}

#[test]
fn only_commanded_axes_are_drawn() {
    let folder = folder_with("u.csv", "t,arm\n0,0.4\n1,0.4\n");
    success_with_note(folder.path(), &["simulate", "--open-loop", "u.csv", "--plot", "y.svg"]);
    let picture = fs::read_to_string(folder.path().join("y.svg")).unwrap();
    assert!(picture.contains("\narm\n") && !picture.contains("boom") && !picture.contains("reference"), "{picture}");
}

#[test]
fn a_machine_that_stands_still_and_a_single_row_can_be_drawn() {
    for rows in ["0,0\n1,0\n", "0,0\n"] {
        let folder = folder_with("u.csv", &format!("t,boom\n{rows}"));
        success_with_note(folder.path(), &["simulate", "--open-loop", "u.csv", "--plot", "y.svg"]);
        let picture = fs::read_to_string(folder.path().join("y.svg")).unwrap();
        assert!(picture.contains("\n650\n") && !picture.contains("NaN"), "{picture}");
    }
}

#[test]
fn a_long_run_is_drawn_with_few_points() {
    let folder = tempfile::tempdir().unwrap();
    let arguments =
        ["simulate", FOUR_AXES, "--scenario", "open-loop", "--duration", "10m", "--axis", "boom", "--plot", "-"];
    let picture = success(folder.path(), &arguments);
    assert!(picture.len() < 100_000, "{} bytes", picture.len());
}

/// Expects success without standard output. Standard error may name axes without a column.
fn success_with_note(folder: &std::path::Path, arguments: &[&str]) {
    let output = super::cli::run(folder, arguments);
    assert!(output.status.success() && output.stdout.is_empty(), "{output:?}");
}
