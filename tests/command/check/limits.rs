//! Limits of the motion: their ranges, and the values that follow from the commissioned model.

use std::{fs, path::Path};

use super::{
    EXCAVATOR,
    cli::{expect_refusal, success},
    expect_four_axes,
    explain::value_and_origin,
    folder_with,
    model_files::MODEL,
};

#[test]
fn limits_within_their_ranges_are_accepted_and_others_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (key, allowed, refused, expected) in [
        ("stop_deceleration", "20", "1e3", "allowed: a number from 0.001 to 100 m/s2"),
        ("stop_reaction", "0.9", "0", "allowed: a number from 0.001 to 60 s"),
        // Dead time and lag of the boom's commissioned model.
        ("stop_reaction", "0.26", "0.25", "allowed: 0.2551375525779397 s or more, commissioned.dead_time + time_const"),
        ("rest_band", "0.001", "1", "allowed: a number from 0.000001 to 0.1 m"),
        ("rest_band", "0.0002", "1e-5", "allowed: 0.0002 m or more, 2 counts of the encoder"),
        ("slow_references", "true", "1", "allowed: true or false"),
        ("jerk", "500", "0", "allowed: a number from 0.001 to 1000000 m/s3"),
    ] {
        let setting = |value| format!("axis.boom.control.{key}={value}");
        expect_four_axes(&success(folder.path(), &["check", "--set", &setting(allowed)]));
        expect_refusal(folder.path(), &["check", "--set", &setting(refused)], &[expected]);
    }
}

#[test]
fn a_jerk_whose_mean_is_too_long_for_a_short_period_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let check = |jerk| ["check", "--set", "timing.period=1ms", "--set", jerk];
    expect_four_axes(&success(folder.path(), &check("axis.boom.control.jerk=0.005")));
    let expected = ["axis.boom.control.jerk: found 0.003", "allowed: 0.004", "m/s3 or more"];
    expect_refusal(folder.path(), &check("axis.boom.control.jerk=0.003"), &expected);
}

#[test]
fn limits_follow_from_the_commissioned_model_where_the_machine_file_leaves_them_out() {
    let model = ["--model", "model.toml"];
    let servo = ["--model", "model.toml", "--set", "axis.boom.commissioned.dead_time=0.002"];
    let servo = [&servo[..], &["--set", "axis.boom.commissioned.time_constant=0.003"]].concat();
    let slow = [&model[..], &["--set", "axis.boom.commissioned.time_constant=1"]].concat();
    for (arguments, key, expected) in [
        (&[][..], "stop_reaction", 0.3),
        (&[][..], "stop_deceleration", 0.5),
        (&[][..], "rest_band", 0.25e-3),
        (&[][..], "jerk", 10.0),
        (&model[..], "stop_reaction", 0.3),
        (&servo[..], "stop_reaction", 4.0 * 0.035),
        (&servo[..], "stop_deceleration", 0.5 * (0.3f64 / 0.14).powi(2)),
        (&slow[..], "stop_reaction", 3.0 * 1.02),
        (&slow[..], "stop_deceleration", 0.5),
        // 10 / s times 0.2 m/s over an opening of 0.3, over 1 s.
        (&slow[..], "jerk", 10.0 * 0.2 / 0.3),
    ] {
        let (value, origin) = value_and_origin(EXCAVATOR, arguments, &format!("axis.boom.control.{key}"));
        assert_eq!(origin["from"], "derived", "{key}");
        assert!((value.parse::<f64>().unwrap() / expected - 1.0).abs() < 1e-9, "{key}: {value}, expected {expected}");
    }
}

#[test]
fn a_command_limit_within_a_dead_band_is_refused() {
    let folder = folder_with(EXCAVATOR);
    fs::write(folder.path().join("model.toml"), MODEL.replace("dead_band_retract = 0.08", "dead_band_retract = 0.2"))
        .unwrap();
    let check = |limit: &'static str| ["check", "m.toml", "--set", limit];
    // The simulated valve has a dead band of 0.1 and a hysteresis of 0.01.
    success(folder.path(), &check("axis.boom.control.command_limit=0.11"));
    let expected = "axis.boom.control.command_limit: found 0.1040, with which the axis never extends; allowed: more \
                    than 0.1050, where the dead band of [axis.boom.plant] with half of the hysteresis ends";
    expect_refusal(folder.path(), &check("axis.boom.control.command_limit=0.104"), &[expected]);
    let with_model = [&check("axis.boom.control.command_limit=0.2")[..], &["--model", "model.toml"]].concat();
    let expected = "axis.boom.control.command_limit: found 0.2000, with which the axis never retracts; allowed: more \
                    than 0.2000, where the dead band of [axis.boom.commissioned] with half of the hysteresis ends";
    expect_refusal(folder.path(), &with_model, &[expected]);
}

#[test]
fn values_with_which_a_run_fails_at_once_are_refused() {
    let folder = folder_with(EXCAVATOR);
    // The file has counts of 0.1 mm, dead bands of 0.1 and 0.08, and 1 m/s.
    for (settings, expected) in [
        (
            &["axis.boom.encoder.resolution=0.05", "axis.boom.control.following_error=0.5"][..],
            "axis.boom.encoder.resolution: found counts of 0.05 m; allowed: up to 0.008000 m: an axis that moves \
             is told from one that has stalled by 5 counts, which take 0.4 s at 0.1 m/s then, a tenth of max_speed",
        ),
        (
            &["axis.boom.control.following_error=2e-4"],
            "axis.boom.control.following_error: found 0.0002 m; allowed: 0.000300 m or more, 3 counts of the encoder",
        ),
        (
            &["axis.boom.control.command_rate=0.1"],
            "axis.boom.control.command_rate: found 0.1 1/s, with which a command needs 1.80 s to cross the dead bands \
             of [axis.boom.plant]; allowed: 0.1800 1/s or more, 1 s",
        ),
        (
            &["axis.boom.control.kp=0", "axis.boom.control.ki=0"],
            "axis.boom.control.kp: found 0 1/m with a ki of 0, with which the axis never moves; allowed: more than 0",
        ),
    ] {
        let settings: Vec<&str> = settings.iter().flat_map(|setting| ["--set", setting]).collect();
        for command in ["check", "simulate", "run"] {
            expect_refusal(folder.path(), &[&[command, "m.toml"], &settings[..]].concat(), &[expected]);
        }
    }
    // With an integral gain it moves.
    expect_four_axes(&success(folder.path(), &["check", "m.toml", "--set", "axis.boom.control.kp=0"]));
}

#[test]
fn a_start_outside_the_soft_limits_is_warned_of() {
    let check = |position| success(Path::new("."), &["check", "--set", position]);
    let warning = "warning: axis.boom.plant.initial_position: found 0.02 m, outside the soft limits; allowed: 0.05 to \
                   1.284 m: from there the axis is moved inwards only";
    assert!(check("axis.boom.plant.initial_position=0.02").contains(warning));
    assert!(!check("axis.boom.plant.initial_position=0.05").contains("initial_position"));
}

#[test]
fn a_model_with_a_poor_fit_is_warned_of() {
    let folder = folder_with(EXCAVATOR);
    let check = ["check", "m.toml", "--model", "model.toml"];
    let warning = "warning: axis.boom.commissioned.fit_percent: found 69.90 %; allowed: 70 % and more. Do not control \
                   with this model";
    for (fit, is_warned) in [("69.9", true), ("70.0", false)] {
        fs::write(folder.path().join("model.toml"), MODEL.replace("97.5", fit)).unwrap();
        assert_eq!(success(folder.path(), &check).contains(warning), is_warned, "{fit}");
    }
}
