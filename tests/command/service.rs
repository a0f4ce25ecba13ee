//! The unit for systemd in `examples`: systemd accepts its keys, and the program accepts its commands.

use std::{
    path::Path,
    process::{Command, Output},
};

use crate::harness::{TestGroup, hydraxis};

const UNIT: &str = include_str!("../../examples/hydraxis.service");
const PROGRAM: &str = "/usr/local/bin/hydraxis";

/// Exit code and messages of `systemd-analyze verify` for a unit, with the program under test in the place of the
/// installed one. A good unit has no message. The exit code is 0 even for an unknown key.
fn verify(unit: &str) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("hydraxis.service");
    std::fs::write(&file, unit.replace(PROGRAM, env!("CARGO_BIN_EXE_hydraxis"))).unwrap();
    let output = Command::new("systemd-analyze").args(["verify", "--man=no"]).arg(&file).output();
    let Output { status, stdout, stderr } = output.expect(
        "systemd-analyze is not installed; type: apt-get install systemd (Debian, Ubuntu), or dnf install systemd; \
         systemd need not run",
    );
    (status.code(), String::from_utf8_lossy(&[stdout, stderr].concat()).into_owned())
}

#[test]
fn systemd_accepts_the_unit() {
    assert_eq!(verify(UNIT), (Some(0), String::new()));
}

#[test]
fn systemd_names_mistakes_in_a_unit() {
    let moved = UNIT.replace("StartLimitBurst=3\n", "").replace("[Service]\n", "[Service]\nStartLimitIntervalSec=3\n");
    for (from, to, expected) in [
        ("LimitRTPRIO=", "LimitRTPRIOX=", "'LimitRTPRIOX'"),
        ("KillMode=mixed", "KillMode=mixt", "mixt"),
        ("ExecStart=/usr/local/bin/hydraxis", "ExecStart=/nowhere/hydraxis", "not executable"),
        (UNIT, moved.as_str(), "StartLimitIntervalSec"),
    ] {
        let unit = UNIT.replacen(from, to, 1);
        assert_ne!(unit, UNIT, "{from}");
        let (_, said) = verify(&unit);
        assert!(said.contains(expected), "{to}: {said:?}");
    }
}

#[test]
fn the_program_accepts_the_commands_of_the_unit() {
    let group = TestGroup::new("service");
    let folder = tempfile::tempdir().unwrap();
    let machine = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/four-axes.toml");
    let commands = UNIT.lines().filter_map(|line| line.strip_prefix("ExecStart")?.split_once('='));
    let mut count = 0;
    for (_, command) in commands {
        let words = command.strip_prefix(PROGRAM).unwrap().split_whitespace().map(|word| match word {
            "/etc/hydraxis/machine.toml" => machine.to_str().unwrap().to_owned(),
            "hydraxis" => group.prefix.to_string(),
            "10years" => "1s".to_owned(),
            other => other.to_owned(),
        });
        let output = hydraxis().args(words).env("TMPDIR", folder.path()).output().unwrap();
        assert!(output.status.success(), "{command}\n{}", String::from_utf8_lossy(&output.stderr));
        count += 1;
    }
    assert_eq!(count, 3);
    // The program accepts the long duration of the unit, which was shortened above.
    let years = ["--duration", "10years", "--prefix", "x", "--scenario", "open-loop"];
    let said = String::from_utf8(hydraxis().arg("run").args(years).output().unwrap().stderr).unwrap();
    assert!(said.contains("is an open loop"), "{said}");
}
