//! `hydraxis bench tip`: figures of the teeth, measures that are switched off, and the picture.

use std::{fs, path::Path};

use serde_json::Value;

use crate::harness::cli::{expect_refusal, run, success};

/// One task with one speed, payload and scenario.
const ONE: [&str; 10] =
    ["bench", "tip", "--task", "level", "--scenario", "nominal", "--payload", "0", "--speed", "0.5m/s"];

fn rows(arguments: &[&str]) -> Vec<Value> {
    let text = success(Path::new("."), &[arguments, &["--json", "-"]].concat());
    serde_json::from_str::<Value>(&text).unwrap()["rows"].as_array().unwrap().clone()
}

#[test]
fn drawn_tasks_of_the_teeth_are_refused_before_they_begin_or_done() {
    let folder = tempfile::tempdir().unwrap();
    let chosen = ["bench", "tip", "--drawn", "10", "--seed", "1", "--scenario", "nominal", "--json", "-"];
    let text = success(folder.path(), &chosen);
    assert_eq!(success(folder.path(), &[&chosen[..], &["--threads", "1"]].concat()), text);
    let figures: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(figures["drawn_with"], 1);
    let rows = figures["rows"].as_array().unwrap();
    let (refused, driven): (Vec<&Value>, Vec<&Value>) = rows.iter().partition(|row| row["refused"].is_string());
    // Each by both controllers.
    assert!(rows.len() == 20 && !refused.is_empty() && !driven.is_empty(), "{text}");
    for row in refused {
        assert!(row["rms"].is_null() && row["refused"].as_str().unwrap().starts_with("tip.piece["), "{row}");
    }
    for row in driven {
        assert_eq!((&row["latches"], &row["is_done"]), (&Value::Array(Vec::new()), &Value::Bool(true)), "{row}");
        assert!(row["way"].as_str().unwrap().starts_with("[tip]\nstart = ["), "{row}");
        assert!((1e-4..0.2).contains(&row["rms"].as_f64().unwrap()), "{row}");
    }
}

#[test]
fn every_measure_that_is_switched_off_changes_what_it_says() {
    let rows = rows(&[&ONE[..], &["--without", "all"]].concat());
    let names: Vec<&str> = rows.iter().map(|row| row["controller"].as_str().unwrap()).collect();
    let less = ["feedforward", "learning", "hysteresis", "damping", "load", "scaling", "waiting", "free-axis"];
    let less = less.map(|measure| format!("without-{measure}"));
    let expected: Vec<&str> =
        ["fallback", "model"].into_iter().chain(less.iter().map(String::as_str)).chain(["joint"]).collect();
    assert_eq!(names, expected);
    let of = |name: &str| rows.iter().find(|row| row["controller"] == name).unwrap();
    let figure = |name: &str, key: &str| of(name)[key].as_f64().unwrap();
    for name in &names {
        assert_eq!((&of(name)["is_done"], &of(name)["latches"]), (&true.into(), &Value::Array(Vec::new())), "{name}");
        let differs = figure(name, "rms") != figure("fallback", "rms");
        // The built-in machine has no transducers, and its teeth do not lag far enough for their time to wait.
        assert_eq!(differs, !["fallback", "without-damping", "without-waiting"].contains(name), "{name}");
    }
    let by_fallback = |name: &str, key: &str| figure(name, key) / figure("fallback", key);
    // Every cylinder has to move by its error alone.
    assert!(by_fallback("without-feedforward", "rms") > 2.0, "{rows:?}");
    assert!(by_fallback("without-learning", "rms") > 1.05 && by_fallback("without-hysteresis", "rms") > 1.05);
    // At 0.5 m/s axes and pump are what slows the plan.
    for (name, worse) in [("without-scaling", 1.1), ("joint", 1.5)] {
        assert!(by_fallback(name, "duration") < 0.9 && by_fallback(name, "rms") > worse, "{name}: {rows:?}");
    }
    for name in ["without-feedforward", "without-learning", "without-hysteresis", "without-load", "without-waiting"] {
        assert_eq!(by_fallback(name, "duration"), 1.0, "{name}");
    }
    // What nothing slows takes the planned time, to a period; a lag of the teeth beyond 60 mm makes it longer.
    let late = |name: &str| figure(name, "time") - figure(name, "duration");
    assert!(late("without-waiting") < 0.015 && late("joint") < 0.015, "{rows:?}");
    assert!(late("without-feedforward") > 1.0, "{rows:?}");
    assert!(late("without-load") > 0.05 && late("without-free-axis") > 0.05, "{rows:?}");
    for name in &names {
        let stays = of(name)["way"].as_str().unwrap().contains("telescope = 0.6");
        assert_eq!(stays, ["without-free-axis", "joint"].contains(name), "{name}");
    }
}

#[test]
fn time_waits_for_teeth_that_lag_behind_worn_valves_unless_that_is_switched_off() {
    let worn = ONE.map(|argument| if argument == "nominal" { "everything" } else { argument });
    let rows = rows(&[&worn[..], &["--without", "waiting"]].concat());
    let of = |name: &str| rows.iter().find(|row| row["controller"] == name).unwrap();
    let late = |name: &str| of(name)["time"].as_f64().unwrap() - of(name)["duration"].as_f64().unwrap();
    assert!(late("fallback") > 0.05 && late("without-waiting") < 0.015, "{rows:?}");
    assert_ne!(of("fallback")["rms"], of("without-waiting")["rms"]);
}

#[test]
fn a_task_that_cannot_be_done_without_the_free_axis_is_refused_and_told() {
    // Within these limits the boom can only stand, and telescope and arm do the level cut.
    let mut chosen = [&ONE[..], &["--without", "free-axis", "--set", "axis.boom.soft_limits=[0.75, 0.85]"]].concat();
    let follows = ["boom", "arm", "telescope", "bucket"].map(|axis| format!("axis.{axis}.reference.kind=tip"));
    chosen.extend(follows.iter().flat_map(|setting| ["--set", setting.as_str()]));
    let text = success(Path::new("."), &chosen);
    assert!(text.contains("without-free-axis, level: 1 refused, the first of them: tip.piece[0]: found ["), "{text}");
    assert!(text.contains("where axis.boom would have to be at "), "{text}");
}

/// Regression: a task 0.2 m above a wall was accepted, and a wall ended it for good, which nobody was told.
#[test]
fn a_task_near_a_wall_is_refused_or_done() {
    let folder = tempfile::tempdir().unwrap();
    let walls = "[walls]\ndepth = 1\nclearance = 0.3\npayload = 1500\ncorner = [{ at = [1.15, 0.62] }]\n";
    fs::write(folder.path().join("walled.toml"), format!("{}\n{walls}", pipeline::machine::BUILT_IN)).unwrap();
    let model = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/excavator-model.toml");
    let near = |depth: &str, without: &[&str]| {
        let depth = format!("walls.depth={depth}");
        // The machine starts above the wall.
        let starts = [("boom", 0.837), ("arm", 0.481), ("telescope", 1.015), ("bucket", 0.826)]
            .map(|(axis, position)| format!("axis.{axis}.plant.initial_position={position}"));
        let starts: Vec<&str> = starts.iter().flat_map(|setting| ["--set", setting.as_str()]).collect();
        let walled = ["walled.toml", "--model", model, "--set", &depth];
        success(folder.path(), &[&ONE[..], &walled, without, &starts].concat())
    };
    let [far, close] = ["0.2", "0.05"].map(|depth| near(depth, &[]));
    assert!(!far.contains("refused,") && !far.contains("stopped,"), "{far}");
    assert!(close.contains("fallback, level: 1 refused, the first of them: tip.piece[0]: found"), "{close}");
    assert!(close.contains("before walls.depth; allowed: at least 0.1"), "{close}");
    // The plan's own speed in joint space does not know the wall.
    let told = near("0.2", &["--without", "teeth"]);
    assert!(told.contains("joint, level: 1 stopped, the first of them: walls.depth stopped axis."), "{told}");
}

#[test]
fn a_model_of_another_machine_is_warned_of() {
    let examples = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/");
    let files = ["excavator-servo.toml", "excavator-model.toml"].map(|name| format!("{examples}{name}"));
    let foreign = [files[0].as_str(), "--model", files[1].as_str()];
    for command in [&[&ONE[..], &foreign].concat()[..], &[&["tip"][..], &foreign].concat()] {
        let errors = String::from_utf8(run(Path::new("."), command).stderr).unwrap();
        assert!(errors.contains("warning: axis.boom.commissioned.measured_on: found"), "{command:?}\n{errors}");
    }
}

#[test]
fn seeds_are_summed_up_and_a_picture_shows_up_to_four_controllers() {
    let folder = tempfile::tempdir().unwrap();
    let two = [&ONE[..], &["--without", "scaling", "--seeds", "2"]].concat();
    let text = success(folder.path(), &two);
    let line = text.lines().find(|line| line.contains("without-scaling ")).unwrap();
    assert_eq!(line.split_whitespace().nth(1), Some("2"), "{text}");
    let picture = [&ONE[..], &["--without", "scaling", "--picture", "cut.svg"]].concat();
    success(folder.path(), &picture);
    let svg = fs::read_to_string(folder.path().join("cut.svg")).unwrap();
    for name in ["fallback: ", "model: ", "without-scaling: "] {
        assert_eq!(svg.matches(name).count(), 1, "{name}");
    }
    let many = [&ONE[..], &["--without", "all", "--picture", "cut.svg"]].concat();
    expect_refusal(folder.path(), &many, &["--picture: found 11 runs", "at most 4 controllers"]);
}

#[test]
fn what_makes_no_sense_is_refused_with_what_is_allowed() {
    let folder = tempfile::tempdir().unwrap();
    let refuse = |more: &[&str], expected: &[&str]| {
        expect_refusal(folder.path(), &[&["bench", "tip"], more].concat(), expected);
    };
    refuse(&["--speed", "100m/s"], &["--speed", "found \"100m/s\"", "allowed: 0.001 to 10 m/s"]);
    refuse(&["--drawn", "3", "--seed", "x"], &["--seed: found \"x\"; allowed: a whole number"]);
    let open = ["--scenario: found \"open-loop\"", "allowed: scenarios without commands, as nominal, cold-start, "];
    refuse(&["--scenario", "open-loop"], &open);
    fs::write(folder.path().join("four.toml"), pipeline::machine::FOUR_AXES).unwrap();
    refuse(&["four.toml"], &["four.toml: mechanism: found nothing; allowed: the tables [mechanism.boom]"]);
    let mass = "allowed: 0 to 100000 kg, as a number in kg or with one of the units kg, t, g, lb";
    refuse(&["--payload", "-1"], &["--payload: found \"-1\"", mass]);
}

#[test]
fn no_key_of_a_machine_file_switches_a_measure_off() {
    for key in ["tip.without", "tip.without.scaling", "axis.boom.control.without.learning"] {
        let set = format!("{key}=true");
        expect_refusal(Path::new("."), &["check", "--set", &set], &["found an unknown key"]);
    }
    expect_refusal(Path::new("."), &["bench", "tip", "--without", "walls"], &["walls", "free-axis", "teeth"]);
}
