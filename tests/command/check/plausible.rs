//! Values that are allowed and hardly meant: each warning names key, value, what it was compared with, what to change.

use std::fs;

use super::{EXCAVATOR, cli::success, folder_with, replaced};
use crate::harness::hydraxis;

/// The warnings of `check` for the example with these values, by key.
fn warnings(settings: &[&str]) -> Vec<String> {
    let folder = folder_with(EXCAVATOR);
    let settings = settings.iter().flat_map(|setting| ["--set", setting]);
    let text = success(folder.path(), &["check", "m.toml"].into_iter().chain(settings).collect::<Vec<_>>());
    let warnings = text.lines().filter_map(|line| line.strip_prefix("warning: "));
    // The pump of the example is short of flow at rare peaks.
    warnings.filter(|warning| !warning.starts_with("supply.flow")).map(str::to_owned).collect()
}

/// Expects no warning for the first values, and one that begins and goes on like this for the second ones.
fn expect(good: &[&str], bad: &[&str], expected: &[&str]) {
    assert_eq!(warnings(good), Vec::<String>::new(), "{good:?}");
    let found = warnings(bad);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].starts_with(expected[0]), "{found:?}");
    expected.iter().for_each(|expected| assert!(found[0].contains(expected), "{expected} in {found:?}"));
}

#[test]
fn a_dead_time_beyond_the_inputs_of_the_model_is_warned_of() {
    expect(
        &["axis.boom.plant.dead_time=30ms"],
        &["axis.boom.plant.dead_time=31ms"],
        &[
            "axis.boom.identification.nk: found 3, and nb 1",
            "end 30 ms before a sample, and axis.boom.plant.dead_time is 31 ms",
            "nk of 4 or more",
        ],
    );
    // A later input bears the delay as well.
    expect(
        &["axis.boom.plant.dead_time=31ms", "axis.boom.identification.nk=4"],
        &["axis.boom.identification.nk=1"],
        &["axis.boom.identification.nk: found 1"],
    );
}

#[test]
fn a_time_out_of_less_than_two_periods_is_warned_of() {
    expect(
        &["timing.feedback_timeout=20ms"],
        &["timing.feedback_timeout=19ms"],
        &["timing.feedback_timeout: found 19 ms with a period of 10 ms", "asked for: 20 ms or more, 2 periods"],
    );
    expect(
        &["timing.feedback_timeout=20ms"],
        &["timing.feedback_timeout=10ms"],
        &["timing.feedback_timeout: found 10 ms", "the next sample is always too late, so no axis can be armed"],
    );
    expect(
        &["timing.drive_timeout=20ms"],
        &["timing.drive_timeout=5ms"],
        &["timing.drive_timeout: found 5 ms with a period of 10 ms", "asked for: 20 ms or more, 2 periods"],
    );
}

#[test]
fn a_time_out_in_which_the_machine_looks_stopped_is_warned_of() {
    expect(
        &["timing.feedback_timeout=1s"],
        &["timing.feedback_timeout=1.1s"],
        &["timing.feedback_timeout: found 1100 ms: an axis waits so long", "asked for: 1000 ms or less"],
    );
    expect(
        &["timing.drive_timeout=1s"],
        &["timing.drive_timeout=60s"],
        &["timing.drive_timeout: found 60000 ms: a valve stays open", "asked for: 1000 ms or less"],
    );
    let on_a_bus = |heartbeat: &'static str| {
        let bus = ["source.kind=can", "can.interface=can0", "axis.boom.can.encoder=11", "axis.boom.can.valve=21"];
        let arm = ["axis.arm.can.encoder=12", "axis.arm.can.valve=22"];
        let rest = ["axis.telescope.can.encoder=13", "axis.telescope.can.valve=23", "axis.bucket.can.encoder=14"];
        [&bus[..], &arm, &rest, &["axis.bucket.can.valve=24", heartbeat]].concat()
    };
    expect(
        &on_a_bus("can.heartbeat=1s"),
        &on_a_bus("can.heartbeat=10s"),
        &["can.heartbeat: found 10000 ms: a device is set up, and missed, after", "asked for: 1000 ms or less"],
    );
}

#[test]
fn counts_that_are_longer_than_the_way_in_a_period_are_warned_of() {
    let slow = ["timing.period=1ms", "axis.boom.identification.nk=21"];
    let others =
        ["axis.arm.identification.nk=21", "axis.telescope.identification.nk=21", "axis.bucket.identification.nk=21"];
    let with = |resolution| [&slow[..], &others[..], &[resolution]].concat();
    expect(
        &with("axis.boom.encoder.resolution=1mm"),
        &with("axis.boom.encoder.resolution=1.5mm"),
        &[
            "axis.boom.encoder.resolution: found counts of 1.5 mm, and the axis moves 1 mm in a period of 1 ms",
            "asked for: counts of 1 mm or less, or a timing.period of 1.5 ms or more",
        ],
    );
}

#[test]
fn a_tolerance_of_less_than_two_counts_is_warned_of() {
    expect(
        &["axis.boom.encoder.tolerance=0.2mm"],
        &["axis.boom.encoder.tolerance=0.15mm"],
        &["axis.boom.encoder.tolerance: found 0.15 mm, and a count is 0.1 mm", "asked for: 0.2 mm or more, 2 counts"],
    );
}

#[test]
fn an_axis_that_rests_at_an_error_that_stops_it_is_warned_of() {
    expect(
        &["axis.boom.control.rest_band=149mm", "axis.boom.control.rest_band=99mm"],
        &["axis.boom.control.rest_band=99mm", "axis.boom.control.following_error=99mm"],
        &[
            "axis.boom.control.rest_band: found 99 mm, with counts of 0.1 mm",
            "axis.boom.control.following_error of 99 mm stops",
            "asked for: a rest_band of less",
        ],
    );
}

#[test]
fn times_that_are_too_short_for_this_computer_are_warned_of() {
    let folder =
        folder_with(&replaced(EXCAVATOR, "period = \"10ms\"", "period = \"10ms\"\nfeedback_timeout = \"30ms\""));
    let computer = fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
    let state = folder.path().join("hydraxis");
    fs::create_dir(&state).unwrap();
    let check = |computer: &str, p99_9_ns: u64, max_ns: u64| {
        let text = format!(r#"{{"computer": "{computer}", "at_s": 0, "p99_9_ns": {p99_9_ns}, "max_ns": {max_ns}}}"#);
        fs::write(state.join("doctor.json"), text).unwrap();
        let mut command = hydraxis();
        command.current_dir(folder.path()).env("XDG_STATE_HOME", folder.path()).args(["check", "m.toml"]);
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines().filter(|line| line.starts_with("warning: timing")).map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(check(computer.trim(), 2_500_000, 20_000_000), Vec::<String>::new());
    assert_eq!(check("another", 9_000_000, 50_000_000), Vec::<String>::new());
    let found = check(computer.trim(), 2_600_000, 21_000_000);
    let [period, time_out] = &found[..] else { panic!("{found:?}") };
    for (found, expected) in [
        (
            period,
            "timing.period: found 10 ms, and this computer woke 1 in 1000 threads later than 2.6 ms (`hydraxis doc",
        ),
        (period, " ago); asked for: 11 ms or more, 4 times that"),
        (time_out, "timing.feedback_timeout: found 30 ms, and this computer woke a thread 21 ms late"),
        (time_out, "asked for: 32 ms or more"),
    ] {
        assert!(found.contains(expected), "{expected} in {found}");
    }
}
