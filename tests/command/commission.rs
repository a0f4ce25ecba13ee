//! `hydraxis commission` on the simulated machine.

use std::{fs, path::Path};

use pipeline::machine::model_settings;

use crate::harness::{
    FOUR_AXES,
    cli::{expect_refusal, run, success},
    mechanism::EXCAVATOR,
};

/// The experiment with one axis, no longer than necessary.
const QUICK: [&str; 6] = ["commission", FOUR_AXES, "--axis", "bucket", "--duration", "40s"];

#[test]
fn a_model_is_found_written_and_read_by_the_other_commands() {
    let folder = tempfile::tempdir().unwrap();
    let output = run(folder.path(), &QUICK);
    let (shown, said) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert_eq!(said, format!("next: hydraxis run {FOUR_AXES} --model model.toml\n"));
    assert!(shown.contains("bucket") && shown.ends_with("written: model.toml\n"), "{shown}");
    let text = fs::read_to_string(folder.path().join("model.toml")).unwrap();
    assert!(text.starts_with("# Found by `hydraxis commission` on \"four-axis excavator\""), "{text}");
    assert!(text.contains("\n[axis.bucket.commissioned]\n") && !text.contains("[axis.boom"), "{text}");
    assert!(text.contains("\ntested_extend = ") && text.contains("\ntested_retract = "), "{text}");
    success(folder.path(), &["check", FOUR_AXES, "--model", "model.toml"]);
    success(folder.path(), &["simulate", FOUR_AXES, "--duration", "1s", "--model", "model.toml"]);

    // A second run gives the same file, bit for bit, but overwrites it only with --force. The scenario of the machine
    // file, a cold start, is not that of the experiment.
    expect_refusal(folder.path(), &QUICK, &["--out: found model.toml, which is there already", "--force"]);
    let again = run(
        folder.path(),
        &[&QUICK[..], &["--force", "--scenario", "nominal", "--json", "-", "--report", "report.html"]].concat(),
    );
    assert_eq!(again.status.code(), Some(0));
    assert_eq!(fs::read_to_string(folder.path().join("model.toml")).unwrap(), text);
    let figures: serde_json::Value = serde_json::from_slice(&again.stdout).unwrap();
    let bucket = &figures[0];
    assert_eq!(bucket["axis"], "bucket");
    assert!((bucket["dead_band_extend"].as_f64().unwrap() - 0.1).abs() < 0.015, "{bucket}");
    assert!(bucket["fit_percent"].as_f64().unwrap() > 90.0, "{bucket}");
    let fallback = &bucket["loops"][0];
    assert_eq!(fallback["controller"], "fallback");
    assert!(fallback["mean_gain_margin"].as_f64().unwrap() > 1.0, "{bucket}");

    // The report has curve, experiment, answer to a jump, and two pictures of the frequency response; it loads nothing.
    let report = fs::read_to_string(folder.path().join("report.html")).unwrap();
    assert_eq!(report.matches("<svg ").count(), 5);
    let own = report.replace("http://www.w3.org/2000/svg", "");
    assert!(["http", "<script", "src=", "url("].iter().all(|foreign| !own.contains(foreign)));
    assert!(["curve that was found", "by the model, from the commands", "gain margin"].iter().all(|t| own.contains(t)));
}

#[test]
fn a_scenario_that_is_asked_for_is_named() {
    let folder = tempfile::tempdir().unwrap();
    for (file, asked) in [("a.toml", ["--scenario", "aeration"]), ("b.toml", ["--set", "scenario=aeration"])] {
        let output = run(folder.path(), &[&QUICK[..], &asked, &["--out", file]].concat());
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{said}");
        assert!(said.starts_with("measured under the scenario \"aeration\": the pump draws air"), "{said}");
    }
}

#[test]
fn a_poor_model_is_not_the_next_to_run() {
    let folder = tempfile::tempdir().unwrap();
    // The load swings slower than the experiment waits, and its strokes take half a minute.
    let heavy = ["--duration", "60s", "--set", "axis.bucket.plant.mass=1000e3"];
    let output = run(folder.path(), &[&QUICK[..4], &heavy].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.starts_with("axis.bucket: found a fit of ") && said.lines().count() == 1, "{said}");
    assert!(["--report", "--duration", "--travel"].iter().all(|option| said.contains(option)), "{said}");
}

/// Keys and values of a model file: the words, and the numbers among them.
fn found(file: &Path) -> (Vec<String>, Vec<f64>) {
    let settings = model_settings(file).unwrap();
    let text: String = settings.iter().map(|(key, value)| format!("{key} {value} ")).collect();
    let words = text.split([' ', ',', '[', ']']).filter(|word| !word.is_empty());
    let (numbers, names): (Vec<&str>, Vec<&str>) = words.partition(|word| word.parse::<f64>().is_ok());
    (names.into_iter().map(str::to_owned).collect(), numbers.iter().map(|word| word.parse().unwrap()).collect())
}

#[test]
fn the_model_of_the_built_in_machine_is_what_commissioning_finds() {
    let (folder, examples) = (tempfile::tempdir().unwrap(), Path::new(env!("CARGO_MANIFEST_DIR")).join("examples"));
    let machine = examples.join("excavator.toml");
    let output = run(folder.path(), &["commission", machine.to_str().unwrap()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let (names, numbers) = found(&folder.path().join("model.toml"));
    let (shipped_names, shipped) = found(&examples.join("excavator-model.toml"));
    assert_eq!((names, numbers.len()), (shipped_names, shipped.len()));
    assert!(numbers.len() > 100, "{}", numbers.len());
    for (number, shipped) in numbers.into_iter().zip(shipped) {
        // Another computer's library may round exponentials in another way.
        assert!((number - shipped).abs() <= 1e-6 * shipped.abs(), "{number} {shipped}");
    }
}

#[test]
fn an_experiment_that_ends_early_says_why_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, expected) in [
        // The pump cannot lift the boom.
        (
            &["--set", "supply.pressure=1e6"][..],
            "axis.boom: ended, valve neutral: does not extend by 2.0 mm/s or more up",
        ),
        (&["--travel", "0.01"][..], "axis.boom: ended, valve neutral: window: found 0.0100 m of travel"),
        (&["--speed", "0.01"][..], "axis.boom: ended, valve neutral: speed: found 0.01"),
        (&["--duration", "10s"][..], "axis.boom: ended, valve neutral: duration: found 10.0 s"),
    ] {
        let output = run(folder.path(), &[&["commission", FOUR_AXES], arguments].concat());
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{said}");
        assert!(said.starts_with(expected), "{said}");
        if let [option, _] = arguments
            && *option != "--set"
        {
            assert!(said.contains(&format!("er {option}")), "no greater, wider or longer {option}: {said}");
        }
        assert!(output.stdout.is_empty() && !folder.path().join("model.toml").exists());
    }
}

/// The machine starts beyond the wall: commands that lead further are neutral.
#[test]
fn a_virtual_wall_stops_an_experiment_and_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let walls = "\n[walls]\ndepth = 0.3\nclearance = 0.3\npayload = 1500\n[[walls.corner]]\nat = [1.15, 0.62]\n";
    let text = fs::read_to_string(EXCAVATOR).unwrap() + walls;
    fs::write(folder.path().join("walled.toml"), text).unwrap();
    let set = |axis: &str, position: &str| format!("axis.{axis}.plant.initial_position={position}");
    let [boom, arm] = [set("boom", "0.2"), set("arm", "0.5")];
    let arguments = ["commission", "walled.toml", "--axis", "boom", "--duration", "40s", "--set", &boom, "--set", &arm];
    let output = run(folder.path(), &arguments);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("walls.depth has kept the valve neutral: no part of the machine may pass it"), "{said}");
    assert!(!folder.path().join("model.toml").exists());
}

#[test]
fn invalid_options_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (arguments, expected) in [
        (&["--axis", "blade"][..], "--axis: found \"blade\"; allowed: one of boom, arm, telescope, bucket"),
        (&["--out", "nowhere/model.toml"][..], "allowed: a file in a folder that exists, and nowhere does not"),
        (&["--speed", "0"][..], "allowed: more than 0 m/s"),
        (&["--travel", "-40"][..], "--travel: found \"-40\"; allowed: more than 0 m"),
        (&["--duration", "-3s"][..], "--duration: found \"-3s\"; allowed: a duration greater than 0"),
        // The bucket travels 1.02 m, the least of all axes.
        (&["--travel", "40"][..], "--travel: found 40 m; allowed: up to "),
        (&["--travel", "1.3"][..], "the travel between the soft limits of axis "),
        (&["--set", "source.kind=replay", "--set", "source.file=x.csv"][..], "source.kind: found \"replay\""),
    ] {
        expect_refusal(folder.path(), &[&["commission"], arguments].concat(), &[expected]);
    }
}
