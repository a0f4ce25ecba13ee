//! Margins of the loops around commissioned models.

use std::fs;

use super::{
    EXCAVATOR,
    cli::{expect_refusal, run, success},
    folder_with,
    model_files::MODEL,
};

/// The model at the steepest piece, 0.75 m/s, swings at a kp of 57 1/m; at the mean slope, 0.667 m/s, at 64 1/m:
/// 0.02 s + T/2 of delay and 0.05 s of lag turn the phase by 90 degrees at 26 rad/s.
#[test]
fn a_loop_that_falls_short_is_a_warning_and_an_unstable_one_a_problem() {
    let folder = folder_with(EXCAVATOR);
    fs::write(folder.path().join("model.toml"), MODEL).unwrap();
    let with = |kp: &'static str| ["check", "m.toml", "--model", "model.toml", "--set", kp];
    let quiet = success(folder.path(), &with("axis.boom.control.kp=20"));
    assert!(
        quiet.contains("boom") && quiet.contains("fallback") && !quiet.contains("warning: axis.boom.control"),
        "{quiet}"
    );
    // With its dead band and rates of commands the loop falls short earlier, about rest.
    let at_rest = success(folder.path(), &with("axis.boom.control.kp=25"));
    let expected =
        "found 25.000 1/m, a gain margin of 2.28 and a delay margin of 36 ms, 180 % of the dead time; about rest 1.6";
    assert!(at_rest.contains(expected), "{at_rest}");
    let short = success(folder.path(), &with("axis.boom.control.kp=40"));
    assert!(short.contains("warning: axis.boom.control.kp: found 40.000 1/m, a gain margin of 1.4"), "{short}");
    let steep = success(folder.path(), &with("axis.boom.control.kp=60"));
    assert!(steep.contains("warning: axis.boom.control.kp: found 60.000 1/m, a gain margin of 0.9"), "{steep}");
    let expected = ["axis.boom.control.kp: found 100.000 1/m, with which the loop", "allowed: up to 63.025 1/m"];
    expect_refusal(folder.path(), &with("axis.boom.control.kp=100"), &expected);
}

#[test]
fn an_unstable_loop_is_not_run_and_is_simulated_with_a_warning() {
    let folder = folder_with(EXCAVATOR);
    fs::write(folder.path().join("model.toml"), MODEL).unwrap();
    let with = |command: &[&'static str]| {
        [command, &["m.toml", "--model", "model.toml", "--set", "axis.boom.control.kp=100"]].concat()
    };
    let problem = "axis.boom.control.kp: found 100.000 1/m, with which the loop of the commissioned model is unstable \
                   at the mean slope of its curve; allowed: up to 63.025 1/m, with the integral gain in proportion";
    for command in [&["run"][..], &["run", "--off", "--lockstep"], &["control-proc", "--prefix", "unstable"]] {
        expect_refusal(folder.path(), &with(command), &[problem]);
    }
    // A simulation moves nothing real.
    let output = run(folder.path(), &with(&["simulate", "--duration", "10ms"]));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && said.contains(&format!("warning: {problem}\n")), "{said}");
}
