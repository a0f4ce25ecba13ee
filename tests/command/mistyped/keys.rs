//! Mistyped keys and values of `--set`.

use super::{Row, expect, folder, missing, run, words};

const ROWS: &[Row] = &[
    (
        "check excavator.toml --set timing.perod=5ms",
        &["--set timing.perod: found an unknown key; allowed", "`period`?"],
    ),
    (
        "check excavator.toml --set timing.period=5",
        &["timing.period: found 5 (from", "allowed: a duration with its unit"],
    ),
    (
        "check excavator.toml --set timing.period=fast",
        &["timing.period: found fast", "allowed: a duration with its unit"],
    ),
    ("check excavator.toml --set timing.period", &["--set: found \"timing.period\"; allowed: KEY=VALUE", "next: "]),
    ("check excavator.toml --set =5", &["--set: found \"=5\"; allowed: KEY=VALUE with a key", "next: "]),
    ("check excavator.toml --set axis.bom.control.kp=3", &["--set axis.bom: found an unknown key", "`boom`?"]),
    (
        "check excavator.toml --set axis.boom.kp=3",
        &["--set axis.boom.kp: found an unknown key", "or axis.boom.control.kp"],
    ),
    (
        "check excavator.toml --set axis.boom.control.kp=",
        &["control.kp: found \"\" (from", "a number from 0 to 10000 1/m"],
    ),
    ("check excavator.toml --set axis.boom.control.kp=three", &["control.kp: found three", "a number from 0 to 10000"]),
    ("check excavator.toml --set axis.boom.control.kp=-3", &["control.kp: found -3", "a number from 0 to 10000 1/m"]),
    ("check excavator.toml --set axis.boom.control.kp=nan", &["control.kp: found nan", "a number from 0 to 10000 1/m"]),
    ("check excavator.toml --set axis.boom.control.kp=inf", &["control.kp: found inf", "a number from 0 to 10000 1/m"]),
    ("check excavator.toml --set axis.boom.control.kp=5%", &["control.kp: found 5%", "one of the units 1/m, 1/mm"]),
    ("check excavator.toml --set axis.boom.stroke=1.2km", &["boom.stroke: found 1.2km", "one of the units m, mm, cm"]),
    ("check excavator.toml --set axis.boom.soft_limits=0.1", &["soft_limits: found 0.1", "allowed: a list of 2"]),
    ("check excavator.toml --set axis.boom.soft_limits=[0.9,0.1]", &["soft_limits: found [0.9, 0.1]", "low < high"]),
    ("check excavator.toml --set axis.boom.encoder.resolution=50", &["encoder.resolution: found 50", "to 0.1 m"]),
    ("check excavator.toml --set axis.boom.control.command_limit=2", &["command_limit: found 2", "from 0.001 to 1"]),
    ("check excavator.toml --set axis.boom.reference.kind=sins", &["reference.kind: found sins", "`sines`?"]),
    ("check excavator.toml --set axis.boom.control.law=smth", &["control.law: found smth", "did you mean `smith`?"]),
    ("check excavator.toml --set axis.boom.identification.estimator=papr", &["estimator: found papr", "`paper`?"]),
    (
        "check excavator.toml --set stage.plant-sm.core=1",
        &["--set stage.plant-sm: found an unknown key", "`plant-sim`?"],
    ),
    ("check excavator.toml --set stage.ident-proc.core=-1", &["ident-proc.core: found -1", "a whole number from 0 to"]),
    (
        "check excavator.toml --set stage.ident-proc.restart=allways",
        &["restart: found allways", "\"on-failure\" or \"never\""],
    ),
    ("check excavator.toml --set stage.control-proc.wait=spinn", &["control-proc.wait: found spinn", "`spin`?"]),
    (
        "check excavator.toml --set stage.plant-sim.command=[]",
        &["plant-sim.command: found an empty list", "such as [\""],
    ),
    ("check excavator.toml --set scenario=lunar", &["scenario: found lunar", "allowed: \"nominal\" or \"cold-start\""]),
    ("check excavator.toml --set axis=5", &["--set axis: found one value for a table", "such as axis."]),
    ("check excavator.toml --set name=", &["name: found \"\" (from the command line); allowed: a text that names"]),
    ("check excavator.toml --set drive.kind=non", &["drive.kind: found non", "allowed: \"sim\""]),
    (
        "check excavator.toml --set source.kind=xyz",
        &["source.kind: found xyz", "\"sim\" or \"replay\" or \"external\""],
    ),
    ("check external.toml --set source.kind=xyz", &["external.toml: source.kind: found xyz", "or \"external\""]),
    ("check external.toml --set source.kind=externl", &["external.toml: source.kind: found externl", "`external`?"]),
    ("check rig.toml --set source.kind=externl", &["rig.toml: source.kind: found externl", "did you mean `external`?"]),
    ("check external.toml --set drive.kind=sim", &["drive.kind: found sim", "allowed: \"external\" or \"none\""]),
    (
        "check external.toml --set source.command=[]",
        &["source.command: found an empty list", "[\"python3\", \"rig.py\"]"],
    ),
    ("check external.toml --set 'source.command=python3 rig.py'", &["source.command: found python3 rig.py", "[\"pyth"]),
    (
        "run external.toml --duration 1s --prefix mistyped --set 'source.command=[\"no-such-program\"]'",
        &["source.command: found \"no-such-program\", which cannot be executed; allowed: a program by its path"],
    ),
];

#[test]
fn a_mistyped_setting_is_answered_with_the_nearest_key_or_what_is_allowed() {
    expect(ROWS);
}

/// A mistyped kind of source is the only problem: what belongs to the kind that was meant is not refused.
#[test]
fn a_mistyped_kind_of_source_is_refused_alone() {
    let folder = folder();
    for kind in ["externl", "xyz"] {
        let line = format!("check external.toml --set source.kind={kind} --set 'source.command=[\"rig\"]'");
        let said = String::from_utf8(run(folder.path(), &words(&line)).stderr).unwrap();
        assert!(said.starts_with("external.toml: source.kind: found ") && said.lines().count() == 1, "{said}");
    }
}

/// A value that is allowed and doubtful is a warning.
#[test]
fn a_doubtful_value_is_a_warning_with_what_was_found_and_asked_for() {
    let folder = folder();
    for (line, expected) in [
        (
            "check rig.toml --set timing.feedback_timeout=1ms",
            ["warning: timing.feedback_timeout: found 1 ms with a period of 10 ms", "asked for: "],
        ),
        (
            "check four.toml --model model.toml",
            ["warning: axis.boom.commissioned.measured_on: found ", "hydraxis comm"],
        ),
    ] {
        let output = run(folder.path(), &words(line));
        let shown = String::from_utf8(output.stdout).unwrap();
        assert_eq!(output.status.code(), Some(0), "{line}");
        assert_eq!(missing(&shown, &expected), None, "{line}\n{shown}");
    }
}
