//! References that ask for more than an axis or the pump can give.

use std::fs;

use super::{ARM_SINES, BOOM_SINES, EXCAVATOR, cli::success, folder_with, model_files::MODEL, replaced};

/// What `check` prints for the example with these references of boom and arm, a model of the boom that was measured up
/// to 0.2 m/s, and these further arguments.
fn check(boom: &str, arm: &str, arguments: &[&str]) -> String {
    let folder = folder_with(&replaced(&replaced(EXCAVATOR, BOOM_SINES, boom), ARM_SINES, arm));
    fs::write(folder.path().join("model.toml"), MODEL).unwrap();
    success(folder.path(), &[&["check", "m.toml", "--model", "model.toml"], arguments].concat())
}

/// Up from 0.4 m to `high` m in `rise` s, and slowly down.
fn ramps(high: f64, rise: f64) -> String {
    format!("kind = \"ramps\"\ntimes = [0, {rise}, 30]\npositions = [0.4, {high}, 0.4]")
}

fn expect(text: &str, expected: &[&str]) {
    for expected in expected {
        assert!(text.contains(expected), "{expected} in {text}");
    }
}

#[test]
fn a_ramp_that_is_faster_than_the_commissioned_axis_is_warned_of() {
    let fast = ramps(0.7, 1.0);
    let warning = "warning: axis.boom.reference.positions: found 0.300 m/s extending at ";
    let text = check(&fast, ARM_SINES, &[]);
    expect(
        &text,
        &["no problem found", warning, "allowed: up to 0.200 m/s", "axis.boom.control.slow_references = true"],
    );
    // Half of the opening beyond the dead band.
    let text = check(&ramps(0.7, 2.0), ARM_SINES, &["--set", "axis.boom.control.command_limit=0.3"]);
    expect(&text, &["found 0.150 m/s extending", "allowed: up to 0.125 m/s"]);
    for (reference, arguments) in
        [(&ramps(0.7, 2.0), &[][..]), (&fast, &["--set", "axis.boom.control.slow_references=true"][..])]
    {
        let text = check(reference, ARM_SINES, arguments);
        assert!(!text.contains("warning: axis"), "{text}");
    }
}

#[test]
fn sines_are_judged_by_their_largest_speed() {
    let text = check(BOOM_SINES, ARM_SINES, &[]);
    // The speeds of all three sines together are 0.263 m/s.
    expect(&text, &["warning: axis.boom.reference.sines: found 0.26", "allowed: up to 0.200 m/s"]);
}

#[test]
fn a_ramp_from_which_the_soft_stop_does_not_stop_is_warned_of() {
    let near = ramps(1.28, 5.0);
    let text = check(&near, ARM_SINES, &[]);
    let warning = "warning: axis.boom.reference.positions: found 0.176 m/s at 1.2";
    expect(&text, &[warning, "before the soft limit 1.284 m", "axis.boom.control.stop_deceleration"]);
    let text = check(&ramps(1.1, 4.0), ARM_SINES, &[]);
    assert!(!text.contains("warning: axis"), "{text}");
}

#[test]
fn references_that_ask_for_more_oil_than_the_pump_gives_are_warned_of() {
    // 0.175 m/s of 0.0226 m2 and of 0.01431 m2, at the same time.
    let both = ramps(0.75, 2.0);
    let boom = ["--set", "axis.telescope.reference.kind=hold", "--set", "axis.bucket.reference.kind=hold"];
    let with_flow = |flow: &'static str| [&boom[..], &["--set", flow]].concat();
    let text = check(&both, &both, &with_flow("supply.flow=6.3e-3"));
    expect(&text, &["warning: supply.flow: found 6.300e-3 m3/s", "allowed: 6.459e-3 m3/s or more"]);
    let text = check(&both, &both, &with_flow("supply.flow=6.5e-3"));
    assert!(!text.contains("warning"), "{text}");
    // One after the other they ask for less.
    let later = "kind = \"ramps\"\ntimes = [0, 10, 12, 30]\npositions = [0.4, 0.4, 0.75, 0.4]";
    let text = check(&both, later, &with_flow("supply.flow=6.3e-3"));
    assert!(!text.contains("warning"), "{text}");
}

#[test]
fn the_references_of_the_shipped_machines_are_not_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    for machine in ["excavator.toml", "four-axes.toml", "excavator-servo.toml"] {
        let path = format!("{}/examples/{machine}", env!("CARGO_MANIFEST_DIR"));
        let text = success(folder.path(), &["check", &path]);
        assert!(!text.contains("warning: axis"), "{text}");
        // The pump of the four axes is short at rare peaks.
        let is_short = text.contains("warning: supply.flow: found 1.000e-2 m3/s, and references that together ask for");
        assert_eq!(is_short, machine == "four-axes.toml", "{text}");
    }
    // The built-in machine comes with its model, whose margins are judged as well.
    let text = success(folder.path(), &["check"]);
    assert!(!text.contains(".reference") && !text.contains("warning: supply"), "{text}");
}

#[test]
fn a_task_that_the_machine_cannot_do_is_warned_of_while_no_axis_follows_it() {
    let folder = tempfile::tempdir().unwrap();
    for (row, expected) in [("6.2,0", None), ("60,0", Some("; no axis follows this task now"))] {
        fs::write(folder.path().join("cut.csv"), format!("x,z\n7.2,0\n{row}\n")).unwrap();
        let text = success(folder.path(), &["check", "--set", "tip.file=cut.csv"]);
        assert_eq!(text.contains("no axis follows"), expected.is_some(), "{text}");
        expect(
            &text,
            &expected.map_or(vec![], |expected| vec!["warning: tip.file: ", "rows 1 to 2: found [", expected]),
        );
    }
}
