//! `run --warm`: the identification begins with what the last run has learned.

use std::{fs, path::Path, process::Output};

use serde_json::Value;

use crate::harness::hydraxis;

const AXES: [&str; 4] = ["boom", "arm", "telescope", "bucket"];
/// A busy computer keeps a run in real time without samples for longer than the machine bears.
const PATIENT: [&str; 2] = ["--set", "timing.feedback_timeout=400ms"];

/// A command with its state in `folder`.
fn output(folder: &Path, arguments: &[&str]) -> Output {
    hydraxis().env("XDG_STATE_HOME", folder).args(arguments).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn a_warm_run_begins_with_what_the_last_one_has_learned() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // Nothing was learned yet.
    let early = output(folder, &["run", "--warm", "--lockstep", "--duration", "1s"]);
    let said = text(&early.stderr);
    assert_eq!(early.status.code(), Some(2), "{said}");
    assert!(said.contains("--warm: ") && said.contains("Run it once without --warm"), "{said}");

    let cold = output(folder, &[&["run", "--duration", "12s", "--no-black-box"], &PATIENT[..]].concat());
    assert!(cold.status.success(), "{}", text(&cold.stderr));
    let states = fs::read_dir(folder.join("hydraxis")).unwrap().map(|entry| entry.unwrap().path());
    let learned: Vec<_> =
        states.filter(|path| path.file_name().unwrap().to_str().unwrap().starts_with("learned-")).collect();
    let [learned] = learned.as_slice() else { panic!("one file: {learned:?}") };
    let content: toml::Table = fs::read_to_string(learned).unwrap().parse().unwrap();

    // A lock-step run takes them as settings, and so can a simulation.
    let mut settings = Vec::new();
    for axis in AXES {
        let start = content["axis"][axis]["identification"].as_table().unwrap();
        assert_eq!(start.len(), 3, "{axis}");
        settings.extend(
            start
                .iter()
                .flat_map(|(key, value)| ["--set".to_owned(), format!("axis.{axis}.identification.{key}={value}")]),
        );
    }
    let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
    let common = ["--duration", "3s", "--seed", "5", "--json", "-"];
    let axes = |arguments: &[&str]| {
        let output = output(folder, &[arguments, &PATIENT, &common[..]].concat());
        assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
        serde_json::from_slice::<Value>(&output.stdout).unwrap()["axes"].clone()
    };
    let warm = axes(&["run", "--lockstep", "--warm"]);
    let all = [&["simulate"], &settings[..]].concat();
    assert_eq!(warm, axes(&all));
    assert_ne!(warm["arm"]["tracking"], axes(&["simulate"])["arm"]["tracking"]);

    // What is typed wins, another machine has learned nothing, and a file that somebody has changed is refused.
    let other = output(folder, &["run", "examples/excavator-servo.toml", "--warm", "--lockstep", "--duration", "1s"]);
    assert_eq!(other.status.code(), Some(2), "{}", text(&other.stderr));
    let refused = |changed: String, expected: &str| {
        fs::write(learned, changed).unwrap();
        let output = output(folder, &["run", "--warm", "--lockstep", "--duration", "1s"]);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(expected), "{said}");
    };
    let original = fs::read_to_string(learned).unwrap();
    refused(original.replacen("start_lag", "memory", 1), "found the key axis.boom.identification.memory");
    refused(original.replacen("start_lag = ", "start_lag = -", 1), "start_lag: found");
    refused(original.replacen("start_lag", "# start_lag", 1), "all three of them, or none");
    refused("[axis".to_owned(), "learned-");
    refused(String::new(), "found no model there");
}
