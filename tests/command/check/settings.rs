//! `--set`: values for keys of the machine file.

use super::{
    EXCAVATOR,
    cli::{expect_refusal, refusal, success},
    expect_four_axes, folder_with, replaced,
};

/// Arguments that check the built-in machine with one setting.
fn check_with(setting: &str) -> [&str; 3] {
    ["check", "--set", setting]
}

#[test]
fn settings_that_their_keys_take_are_accepted() {
    let folder = tempfile::tempdir().unwrap();
    for setting in [
        "axis.boom.control.kp=3",
        "axis.boom.identification.estimator=constant:0.995",
        "axis.boom.identification.estimator=\"paper\"",
        "axis.boom.identification.estimator=rules",
        "axis.boom.identification.estimator=fuzzy:0.9",
        "axis.boom.identification.estimator=fortescue:500",
        "axis.boom.identification.estimator=directional:0.99",
        "axis.boom.identification.estimator=window:500",
        "axis.boom.identification.estimator=auto",
        "axis.arm.soft_limits=[0.1, 1.4]",
        "axis.boom.reference.sines[0].amplitude=0.01",
        "realtime.lock_memory=true",
        "stage.control-proc.core=3",
    ] {
        expect_four_axes(&success(folder.path(), &check_with(setting)));
    }
}

#[test]
fn a_setting_takes_the_place_of_the_value_in_the_file() {
    let folder = folder_with(&replaced(EXCAVATOR, "period = \"10ms\"", "period = 10"));
    let text = success(folder.path(), &["check", "m.toml", "--set", "timing.period=5ms"]);
    assert!(text.contains("every 5ms"), "{text}");
}

#[test]
fn the_last_of_several_settings_of_a_key_counts() {
    let folder = tempfile::tempdir().unwrap();
    let text = success(folder.path(), &["check", "--set", "timing.period=-1", "--set", "timing.period=20ms"]);
    assert!(text.contains("every 20ms"), "{text}");
}

#[test]
fn settings_that_their_keys_do_not_take_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (setting, expected) in [
        (
            "axis.boom.control.kp=nan",
            "axis.boom.control.kp: found nan (from the command line); allowed: a number from 0 to 10000",
        ),
        (
            "axis.boom.stroke=-1",
            "axis.boom.stroke: found -1 (from the command line); allowed: a number from 0.001 to 100 m",
        ),
        (
            "axis.boom.soft_limits=[.59,.61]",
            "axis.boom.soft_limits: found [.59,.61], which is no TOML (from the command line); allowed: a list of 2",
        ),
        ("axis.boom.control.kp=.5", "kp: found .5, which is no TOML (from the command line); allowed: a number from 0"),
        ("timing.period=5", "timing.period: found 5 (from the command line); allowed: a duration with its unit"),
        ("realtime.lock_memory=yes", "realtime.lock_memory: found yes (from the command line); allowed: true or false"),
        (
            "axis.boom.identification.estimator=constant:2",
            "axis.boom.identification.estimator: found constant:2 (from the command line); allowed: \"auto\", \
             \"paper\", \"rules\", \"constant:L\" with L",
        ),
        (
            "axis.boom.forgetting=paper",
            "axis.boom.forgetting: found a key that has been renamed; allowed: axis.boom.identification.estimator",
        ),
        (
            "axis.boom.identification.estimator=fuzzy:1.0",
            "axis.boom.identification.estimator: found fuzzy:1.0 (from the command line); allowed: \"auto\", ",
        ),
        ("axis.boom.identification.estimator=window:1", "\"window:N\" with N from 2 to 100000 samples"),
        (
            "axis.boom.identification.estimator=window:3",
            "axis.boom.identification.estimator: found \"window:3\" for 5 coefficients (from the command line); \
             allowed: \"window:N\" with N from 5",
        ),
    ] {
        expect_refusal(folder.path(), &check_with(setting), &[expected]);
    }
}

#[test]
fn a_setting_of_an_unknown_key_is_refused_with_the_keys_of_its_table() {
    let folder = tempfile::tempdir().unwrap();
    for (key, expected) in [
        (
            "axis.boom.kq",
            "--set axis.boom.kq: found an unknown key; allowed: one of can, columns, commissioned, control,",
        ),
        ("axis.boom.control.kq", "--set axis.boom.control.kq: found an unknown key; allowed: one of command_limit,"),
        ("axis.crane.stroke", "--set axis.crane: found an unknown key; allowed: one of arm, boom, bucket, telescope"),
        ("axis.boom.reference.sines[9].phase", "--set axis.boom.reference.sines[9]: found an unknown key; allowed:"),
        ("controler", "--set controler: found an unknown key; allowed: one of axis, can, drive, fuzzy,"),
        (
            "axis.boom.max_speed.high",
            "--set axis.boom.max_speed.high: found an unknown key; allowed: axis.boom.max_speed, which has no keys",
        ),
    ] {
        let error = refusal(folder.path(), &check_with(&format!("{key}=3")));
        assert!(error.contains(expected) && error.lines().count() == 1, "{key}: {error}");
    }
}

#[test]
fn one_value_for_a_table_is_no_unknown_key() {
    let folder = tempfile::tempdir().unwrap();
    for (setting, key, such) in [
        ("axis.boom=3", "axis.boom", ", such as axis.boom.stroke"),
        ("axis.boom.reference={kind=\"hold\"}", "axis.boom.reference", ", such as axis.boom.reference.kind"),
        ("tip.piece=[]", "tip.piece", ", such as tip.piece[0].to"),
    ] {
        let expected = format!(
            "--set {key}: found one value for a table or a list of tables; allowed: a key inside it{such}; the machine \
             file takes the whole\n"
        );
        expect_refusal(folder.path(), &check_with(setting), &[&expected]);
    }
}

#[test]
fn a_setting_in_the_wrong_table_is_refused_with_the_keys_of_that_name() {
    let folder = tempfile::tempdir().unwrap();
    for (setting, expected) in [
        ("axis.boom.kp=3", "reference, soft_limits, stroke; or axis.boom.control.kp\n"),
        (
            "kp=3",
            "timing, tip, walls; or axis.boom.control.kp, axis.arm.control.kp, axis.telescope.control.kp, axis.bucket.",
        ),
    ] {
        expect_refusal(folder.path(), &check_with(setting), &[expected]);
    }
}

#[test]
fn a_bad_gain_of_the_smith_predictor_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let error = refusal(folder.path(), &check_with("axis.arm.control.smith_kp=-1"));
    let expected = "axis.arm.control.smith_kp: found -1 (from the command line); allowed: a number from 0 to 10000 1/m";
    assert!(error.contains(expected) && error.lines().count() == 1, "{error}");
}

#[test]
fn a_setting_without_key_or_value_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for setting in ["axis.boom.control.kp", "=3"] {
        expect_refusal(folder.path(), &check_with(setting), &["--set", setting, "allowed: KEY=VALUE"]);
    }
}
