//! The unit for systemd in `examples`: systemd accepts its keys and finds little that the service could harm, and the
//! program accepts its commands.

use std::{
    path::Path,
    process::{Command, Output},
};

use crate::harness::{TestGroup, hydraxis};

const UNIT: &str = include_str!("../../examples/hydraxis.service");
const PROGRAM: &str = "/usr/local/bin/hydraxis";

/// Largest exposure that `systemd-analyze security` may find, in tenths; its scale ends at 100. It finds 11.
const EXPOSURE: &str = "--threshold=11";

/// What systemd may hold against the unit. The unit gives the reasons, but for these: who installs the program chooses
/// a root directory, a private `/tmp` brings private mounts, and without a network there are no addresses to deny.
const EXPOSED: [&str; 11] = [
    "RootDirectory=/RootImage=",
    "PrivateMounts=",
    "RemoveIPC=",
    "PrivateDevices=",
    "DeviceAllow=",
    "ProcSubset=",
    "PrivateUsers=",
    "RestrictAddressFamilies=~AF_UNIX",
    "IPAddressDeny=",
    "RestrictRealtime=",
    "SystemCallFilter=~@resources",
];

/// Runs a command of `systemd-analyze` for a unit, with the program under test in the place of the installed one.
fn analyze(arguments: &[&str], unit: &str) -> Output {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("hydraxis.service");
    std::fs::write(&file, unit.replace(PROGRAM, env!("CARGO_BIN_EXE_hydraxis"))).unwrap();
    let output = Command::new("systemd-analyze").args(arguments).arg(&file).output();
    output.expect(
        "systemd-analyze is not installed; type: apt-get install systemd (Debian, Ubuntu), or dnf install systemd; \
         systemd need not run",
    )
}

/// Exit code and messages of `systemd-analyze verify` for a unit. A good unit has no message. The exit code is 0 even
/// for an unknown key.
fn verify(unit: &str) -> (Option<i32>, String) {
    let Output { status, stdout, stderr } = analyze(&["verify", "--man=no"], unit);
    (status.code(), String::from_utf8_lossy(&[stdout, stderr].concat()).into_owned())
}

/// Whether the exposure of a unit is within [`EXPOSURE`], and what systemd holds against the unit.
fn security(unit: &str) -> (bool, Vec<String>) {
    let Output { status, stdout, stderr } = analyze(&["security", "--offline=true", EXPOSURE, "--json=short"], unit);
    let checks: Vec<serde_json::Value> =
        serde_json::from_slice(&stdout).unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&stderr)));
    let is_exposed = |check: &&serde_json::Value| {
        let exposure = check["exposure"].as_str().and_then(|exposure| exposure.parse::<f64>().ok());
        exposure.is_some_and(|exposure| exposure > 0.0)
    };
    let exposed = checks.iter().filter(is_exposed).filter_map(|check| check["name"].as_str());
    (status.success(), exposed.map(str::to_owned).collect())
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
fn the_service_can_do_little_harm() {
    let (is_low, exposed) = security(UNIT);
    let more: Vec<_> = exposed.iter().filter(|name| !EXPOSED.contains(&name.as_str())).collect();
    assert!(more.is_empty(), "systemd holds this against the unit: {more:?}");
    assert!(is_low, "the exposure is above {EXPOSURE}");
}

#[test]
fn a_unit_without_one_of_its_protections_is_noticed() {
    for line in [
        "User=hydraxis",
        "CapabilityBoundingSet=",
        "NoNewPrivileges=yes",
        "ProtectSystem=strict",
        "ProtectHome=yes",
        "PrivateTmp=yes",
        "DevicePolicy=closed",
        "ProtectKernelTunables=yes",
        "ProtectKernelModules=yes",
        "ProtectKernelLogs=yes",
        "ProtectControlGroups=yes",
        "ProtectClock=yes",
        "ProtectHostname=yes",
        "ProtectProc=invisible",
        "PrivateNetwork=yes",
        "RestrictAddressFamilies=AF_UNIX",
        "RestrictNamespaces=yes",
        "RestrictSUIDSGID=yes",
        "LockPersonality=yes",
        "MemoryDenyWriteExecute=yes",
        "SystemCallArchitectures=native",
        "SystemCallFilter=@system-service",
        "SystemCallFilter=~@privileged @resources",
    ] {
        let unit = UNIT.replacen(&format!("\n{line}\n"), "\n", 1);
        assert_ne!(unit, UNIT, "{line}");
        let (is_low, exposed) = security(&unit);
        let is_noticed = !is_low || exposed.iter().any(|name| !EXPOSED.contains(&name.as_str()));
        assert!(is_noticed, "without {line}: {exposed:?}");
    }
    assert!(!UNIT.lines().any(|line| line.starts_with("RestrictRealtime=")), "it would forbid SCHED_FIFO");
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
