//! `hydraxis can`: beside a bus with simulated devices.

use std::{
    io::Write,
    path::Path,
    process::{Output, Stdio},
};

use can::{
    BitRates,
    bus::{Address, LogLine},
};
use tempfile::TempDir;

use crate::harness::{
    FOUR_AXES,
    bus::{self, Devices},
    cli::expect_refusal,
    hydraxis,
};

const RATES: BitRates = BitRates { bus: 500_000, data: None };

/// Devices at `bus` of a folder. The encoder of the arm is reversed, and has another zero.
fn devices() -> (TempDir, Devices) {
    let folder = tempfile::tempdir().unwrap();
    let mounted = [("axis.arm.can.reversed", "true"), ("axis.arm.can.zero", "100000")];
    let devices = Devices::start_with(&folder.path().join("bus"), &mounted);
    (folder, devices)
}

/// `hydraxis can WORDS` about the machine of the devices.
fn run(folder: &Path, words: &[&str], input: &str) -> Output {
    let mut command = hydraxis();
    command.current_dir(folder).arg("can").args(words);
    command.args(bus::arguments(&bus::settings(&folder.join("bus"))));
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // A command that ends before it reads is no error of the test.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    child.wait_with_output().unwrap()
}

fn done(folder: &Path, words: &[&str], input: &str) -> String {
    let output = run(folder, words, input);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{words:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}

fn failed(folder: &Path, words: &[&str], input: &str) -> String {
    let output = run(folder, words, input);
    assert_eq!(output.status.code(), Some(1), "{words:?}");
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn a_scan_finds_every_device_with_its_identity() {
    let (folder, _devices) = devices();
    let text = done(folder.path(), &["scan", FOUR_AXES, "--duration", "100ms"], "");
    for expected in ["boom encoder", "bucket valve", "simulated 408", "8 nodes"] {
        assert!(text.contains(expected), "no {expected} in\n{text}");
    }
    let text = done(folder.path(), &["scan", FOUR_AXES, "--json", "-", "--duration", "100ms"], "");
    let found: serde_json::Value = serde_json::from_str(&text).unwrap();
    let nodes: Vec<_> = found.as_array().unwrap().iter().map(|node| node["node"].as_u64().unwrap()).collect();
    assert_eq!(nodes, [11, 12, 13, 14, 21, 22, 23, 24]);
    assert_eq!((&found[0]["profile"], &found[4]["serial"]), (&406.into(), &21.into()));
    // A device of the machine file that is not there is named.
    let mut command = hydraxis();
    command.args(["can", "scan", FOUR_AXES, "--duration", "100ms"]);
    command.args(bus::arguments(&bus::settings(&folder.path().join("bus"))));
    let output = command.args(["--set", "axis.boom.can.encoder=99"]).output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(errors.contains("not found: node 99 (boom encoder)"), "{errors}");
}

#[test]
fn objects_are_read_and_written_after_a_yes() {
    let (folder, _devices) = devices();
    let folder = folder.path();
    let read = ["sdo", "read", FOUR_AXES, "--node", "11", "--object", "1008"];
    assert!(done(folder, &read, "").contains("= \"simulated 406\""));
    let write = ["sdo", "write", FOUR_AXES, "--node", "21", "--object", "1400:5", "--value", "60", "--type", "u16"];
    let period = ["sdo", "read", FOUR_AXES, "--node", "21", "--object", "1400:5"];
    assert!(failed(folder, &write, "no\n").contains("nothing was written"));
    assert!(done(folder, &period, "").contains("[00 00] = 0"));
    assert!(done(folder, &write, "yes\n").contains("written, [3C 00] = 60"));
    assert!(done(folder, &period, "").contains("[3C 00] = 60"));
    let said = failed(folder, &["sdo", "read", FOUR_AXES, "--node", "11", "--object", "2FFF"], "");
    assert!(said.contains("node 11: 2FFFh:0: abort 06020000h (no such object)"), "{said}");
    let silent = ["sdo", "read", FOUR_AXES, "--node", "99", "--object", "1000", "--answer", "50ms"];
    let said = failed(folder, &silent, "");
    assert!(said.contains("node 99: 1000h:0: no answer; check power"), "{said}");
    let read_only = ["sdo", "write", FOUR_AXES, "--node", "11", "--object", "6004", "--value", "1", "--type", "u32"];
    let said = failed(folder, &[&read_only[..], &["--yes"]].concat(), "");
    assert!(said.contains("abort 06010002h (read only)"), "{said}");
}

#[test]
fn a_bus_is_watched_and_recorded_and_the_log_is_read_again() {
    let (folder, _devices) = devices();
    let folder = folder.path();
    // Heartbeats, which the devices send once they are told to.
    let beat =
        ["sdo", "write", FOUR_AXES, "--node", "21", "--object", "1017", "--value", "20", "--type", "u16", "--yes"];
    done(folder, &beat, "");
    let table = done(folder, &["monitor", FOUR_AXES, "--duration", "1s"], "");
    assert!(table.contains("715") && table.contains("boom valve (node 21): heartbeat, pre-operational"), "{table}");
    assert!(table.contains("lost 0, errors 0, bus-off 0, malformed 0"), "{table}");
    done(folder, &["record", FOUR_AXES, "--out", "bus.log", "--duration", "500ms"], "");
    let log = std::fs::read_to_string(folder.join("bus.log")).unwrap();
    assert!(log.lines().count() > 5 && log.lines().all(|line| LogLine::parse(line).is_some()), "{log}");
    let again = run(folder, &["record", FOUR_AXES, "--out", "bus.log", "--duration", "500ms"], "");
    assert_eq!(again.status.code(), Some(2));
    let shown = done(folder, &["monitor", FOUR_AXES, "--log", "bus.log"], "");
    assert!(shown.contains("heartbeat, pre-operational"), "{shown}");
    let lines = done(folder, &["monitor", FOUR_AXES, "--log", "bus.log", "--frames"], "");
    assert_eq!(lines.lines().count(), log.lines().count());
}

#[test]
fn marks_give_direction_scale_and_zero() {
    let (folder, _devices) = devices();
    let folder = folder.path();
    // The arm stands at 0.75 m: 7500 counts of 0.1 mm, on a reversed encoder with the zero 100000. It creeps by some
    // counts in a minute. This machine file does not say that it is reversed; two marks would.
    let lines = |options: &[&str]| {
        let words = [&["calibrate", FOUR_AXES, "--axis", "arm", "--mark", "0.75"], options].concat();
        let text = done(folder, &words, "\n");
        let raw = text.split_once("0.75 m is ").unwrap().1.lines().next().unwrap().parse::<i64>().unwrap();
        assert!((92_450..=92_500).contains(&raw), "{text}");
        (text, raw)
    };
    let (text, raw) = lines(&[]);
    assert!(text.contains(&format!("\n[axis.arm.can]\nreversed = false\nzero = {}\n", raw - 7500)), "{text}");
    let (text, raw) = lines(&["--set", "axis.arm.can.reversed=true"]);
    assert!(text.contains(&format!("reversed = true\nzero = {}\n", raw + 7500)), "{text}");
    let said = failed(folder, &["calibrate", FOUR_AXES, "--axis", "arm", "--mark", "0.1", "--mark", "0.9"], "\n\n");
    assert!(said.contains("the position has changed by ") && said.contains("allowed: a motion of 10 counts"), "{said}");
    let said = failed(folder, &["calibrate", FOUR_AXES, "--axis", "boom", "--duration", "100ms"], "");
    assert!(said.contains("node 11: the position has changed by "), "{said}");
    for (words, expected) in [
        (&["--mark", "7"][..], "--mark: found 7; allowed: 0 to "),
        (&["--mark", "0.1", "--mark", "0.1"], "allowed: positions that are 1 mm apart"),
        (&["--mark", "0", "--mark", "0.1", "--mark", "0.2"], "--mark: found 3 of them"),
        (&["--mark", "0", "--at", "bom=0.1"], "--at: found axis bom"),
    ] {
        let output = run(folder, &[&["calibrate", FOUR_AXES, "--axis", "boom"], words].concat(), "");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(expected), "{said}");
    }
}

#[test]
fn a_bus_that_another_program_has_is_refused() {
    let (folder, _devices) = devices();
    let at = folder.path().join("bus");
    let address = Address::Serial(at.clone());
    let taken = can::bus::open(&address, RATES, false).unwrap();
    for words in [
        &["scan", FOUR_AXES][..],
        &["sdo", "read", FOUR_AXES, "--node", "11", "--object", "1000"],
        &["monitor", FOUR_AXES],
        &["calibrate", FOUR_AXES, "--axis", "boom"],
    ] {
        let said = failed(folder.path(), words, "");
        assert!(said.contains("another program has this port, such as a running group"), "{words:?}: {said}");
    }
    drop(taken);
    done(folder.path(), &["sdo", "read", FOUR_AXES, "--node", "11", "--object", "1000"], "");
}

#[test]
fn a_link_of_a_killed_program_is_replaced_and_one_of_a_living_program_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().join("bus");
    let start = || {
        let mut command = hydraxis();
        command.args(["can", "simulate", FOUR_AXES, "--at"]).arg(&at).args(bus::arguments(&bus::settings(&at)));
        command.output().unwrap()
    };
    // It is killed, which leaves the link.
    let killed = Devices::start(&at);
    let said = start();
    assert_eq!(said.status.code(), Some(2));
    let said = String::from_utf8_lossy(&said.stderr).into_owned();
    assert!(said.contains("other simulated devices are there; allowed: a path of its own"), "{said}");
    drop(killed);
    assert!(at.is_symlink());
    let old = std::fs::read_link(&at).unwrap();
    let devices = Devices::start(&at);
    crate::harness::wait_for("a bus that answers", || {
        can::bus::open(&Address::Serial(at.clone()), RATES, false).ok().map(drop)
    });
    devices.end();
    assert!(!at.exists(), "removed, was {}", old.display());
    // What is no link to a pseudo terminal stays.
    std::fs::write(&at, "mine").unwrap();
    let said = start();
    assert_eq!((said.status.code(), std::fs::read_to_string(&at).unwrap().as_str()), (Some(2), "mine"));
    assert!(String::from_utf8_lossy(&said.stderr).contains("--at: "));
}

#[test]
fn words_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (words, expected) in [
        (&["scan"][..], "the bus: found neither; allowed: --interface can0"),
        (&["scan", FOUR_AXES], "the bus: found a machine file without [can]"),
        (&["scan", "--interface", "a/b"], "allowed: an interface such as can0"),
        (&["scan", "--interface", "can0", "--bit-rate", "123"], "allowed: 10000, 20000"),
        (&["sdo", "read", "--interface", "can0", "--node", "128", "--object", "1000"], "allowed: 1 to 127"),
        (&["sdo", "read", "--interface", "can0", "--node", "1", "--object", "10"], "four hexadecimal digits"),
        (
            &[
                "sdo",
                "write",
                "--interface",
                "can0",
                "--node",
                "1",
                "--object",
                "1017",
                "--value",
                "70000",
                "--type",
                "u16",
            ],
            "--value: found 70000; allowed: a number that the type holds",
        ),
        (&["monitor", "--log", "none.log"], "--log: none.log"),
    ] {
        expect_refusal(folder.path(), &[&["can"], words].concat(), &[expected]);
    }
}

#[test]
fn an_interface_that_is_not_there_is_explained() {
    let folder = tempfile::tempdir().unwrap();
    let output = hydraxis().current_dir(&folder).args(["can", "scan", "--interface", "none-such0"]).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1));
    let is_explained =
        ["this kernel has no CAN (AF_CAN), or has not loaded it; type: modprobe can_raw", "there is no such interface"];
    assert!(is_explained.iter().any(|text| said.contains(text)), "{said}");
}
