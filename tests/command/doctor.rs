//! `hydraxis doctor` on the computer that runs the tests.

use crate::harness::{FOUR_AXES, hydraxis};

#[test]
fn every_check_and_latency_is_printed_and_a_bad_check_fails() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("doctor.json");
    let settings = ["--set", "stage.control-proc.priority=80", "--set", "timing.period=2ms"];
    let output = hydraxis()
        .args(["doctor", FOUR_AXES, "--seconds", "1", "--json", file.to_str().unwrap()])
        .args(settings)
        .env("XDG_STATE_HOME", folder.path())
        .output()
        .unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let report: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let findings = report["findings"].as_array().unwrap();
    let mut counts = [0, 0, 0];
    for finding in findings {
        let place = ["good", "bad", "unknown"].iter().position(|verdict| finding["verdict"] == *verdict).unwrap();
        counts[place] += 1;
        let (check, found) = (finding["check"].as_str().unwrap(), finding["found"].as_str().unwrap());
        let is_its_line = |line: &&str| {
            line.starts_with(finding["verdict"].as_str().unwrap()) && line.contains(check) && line.contains(found)
        };
        assert_eq!(text.lines().filter(is_its_line).count(), 1, "{finding}\n{text}");
    }
    let [good, bad, unknown] = counts;
    assert_eq!(text.lines().last().unwrap(), format!("{good} good, {bad} bad, {unknown} unknown"));
    assert_eq!(output.status.code(), Some(i32::from(bad > 0)), "{text}");
    for check in ["preemption", "SCHED_FIFO", "leftovers", "wake-up", "wake-up under load"] {
        assert!(findings.iter().any(|finding| finding["check"] == check), "{check}");
    }

    // `check` compares with the last figures.
    let kept = std::fs::read_to_string(folder.path().join("hydraxis/doctor.json")).unwrap();
    let kept: serde_json::Value = serde_json::from_str(&kept).unwrap();
    let largest = |figure: &str| report["latency"].as_array().unwrap().iter().map(|of| of[figure].as_u64()).max();
    assert_eq!(largest("max"), Some(kept["max_ns"].as_u64()));
    assert_eq!(largest("p99_9"), Some(kept["p99_9_ns"].as_u64()));

    let [alone, loaded] = [&report["latency"][0], &report["latency"][1]];
    assert_eq!(alone["load"], 0);
    assert!(loaded["load"].as_u64().unwrap() >= 1);
    for latency in [alone, loaded] {
        assert_eq!(latency["count"], 1000, "a thousand wake-ups a second");
        assert!(latency["p99_9"].as_u64() <= latency["max"].as_u64());
    }
    assert!(text.contains("a quarter of the period is 0.5 ms"), "{text}");
}

#[test]
fn invalid_options_are_refused() {
    for (arguments, expected) in [
        (&["--seconds", "0"][..], "allowed: a whole number from 1 to 86400"),
        (&["--set", "timing.period=0"][..], "timing.period"),
        (&["nowhere.toml"][..], "nowhere.toml: found a file that cannot be read"),
        (&["--json", "/nowhere/x.json"][..], "--json: /nowhere/x.json cannot be written"),
    ] {
        let output = hydraxis().arg("doctor").args(arguments).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}\n{said}");
        assert!(said.contains(expected) && output.stdout.is_empty(), "{arguments:?}\n{said}");
    }
}
