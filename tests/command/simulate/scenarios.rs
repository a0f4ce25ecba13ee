//! Scenarios by name, and those of a machine file.

use std::fs;

use pipeline::machine::{self, Scenario};
use serde_json::{Value, json};

use super::{
    cli::{run, success},
    folder_with,
    harness::{FOUR_AXES, report},
};

#[test]
fn a_scenario_changes_the_result() {
    let run = |scenario| report(&["simulate", "--duration", "3s", "--scenario", scenario])["axes"].clone();
    assert_ne!(run("nominal"), run("cold-start"));
    assert_eq!(run("nominal"), report(&["simulate", "--duration", "3s"])["axes"], "which the built-in machine has");
}

#[test]
fn a_scenario_by_name_is_the_setting_of_its_key_and_counts_before_it() {
    let named = report(&["simulate", "--duration", "2s", "--scenario", "nominal"]);
    assert_eq!(named, report(&["simulate", "--duration", "2s", "--set", "scenario=nominal"]));
    let arguments = ["simulate", "--duration", "2s", "--scenario", "nominal", "--set", "scenario=everything"];
    assert_eq!(named, report(&arguments));
}

#[test]
fn a_scenario_of_ones_own_is_the_same_in_one_process_and_in_four() {
    let own = "\n[scenarios.weak-arm]\nsummary = \"the arm loses half its flow\"\n\
               changes = [{ axis = \"arm\", parameter = \"flow_gain\", start = 1, end = 2, factor = 0.5 }]\n";
    let folder = folder_with("m.toml", &format!("{}{own}", machine::FOUR_AXES));
    let file = folder.path().join("m.toml");
    let arguments = [file.to_str().unwrap(), "--duration", "4s", "--scenario", "weak-arm"];
    let simulated = report(&[&["simulate"], &arguments[..]].concat());
    assert_eq!(simulated, report(&[&["run", "--lockstep"], &arguments[..]].concat()));
    let nominal = report(&["simulate", FOUR_AXES, "--duration", "4s", "--scenario", "nominal"]);
    assert_ne!(simulated["axes"]["arm"], nominal["axes"]["arm"]);
}

#[test]
fn a_scenario_of_ones_own_takes_the_place_of_the_built_in_one_of_its_name() {
    let own = "\n[scenarios.payload]\nchanges = []\n";
    let folder = folder_with("m.toml", &format!("{}{own}", machine::FOUR_AXES));
    let file = folder.path().join("m.toml");
    let run =
        |file: &str, scenario| report(&["simulate", file, "--duration", "12s", "--scenario", scenario])["axes"].clone();
    assert_eq!(run(file.to_str().unwrap(), "payload"), run(FOUR_AXES, "nominal"));
    assert_ne!(run(FOUR_AXES, "payload"), run(FOUR_AXES, "nominal"));
}

#[test]
fn the_help_lists_every_scenario() {
    for command in ["run", "simulate"] {
        let help = success(tempfile::tempdir().unwrap().path(), &[command, "--help"]);
        for scenario in Scenario::built_in() {
            let line = help.lines().find(|line| line.trim_start().starts_with(&format!("{} ", scenario.name)));
            let line = line.unwrap_or_else(|| panic!("{} in\n{help}", scenario.name));
            assert!(line.ends_with(&scenario.summary), "{line}");
        }
    }
}

#[test]
fn a_run_names_its_scenario() {
    let arguments = ["run", "--lockstep", "--duration", "100ms", "--scenario", "digging"];
    let output = run(tempfile::tempdir().unwrap().path(), &arguments);
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(errors.starts_with("20 t excavator, scenario \"digging\": group \""), "{errors}");
}

#[test]
fn a_run_that_ends_with_latched_axes_says_so_first_and_fails() {
    let own = "\n[scenarios.pump-fails]\nsummary = \"the pump fails\"\n\
               changes = [{ parameter = \"supply_pressure\", start = 5, end = 5, factor = 0.05 }]\n";
    let folder = folder_with("m.toml", &format!("{}{own}", machine::FOUR_AXES));
    for command in [&["simulate"][..], &["run", "--lockstep"]] {
        let arguments = ["m.toml", "--scenario", "pump-fails", "--duration", "10s", "--json", "j.json"];
        let output = run(folder.path(), &[command, &arguments].concat());
        assert_eq!(output.status.code(), Some(1));
        let (tables, errors) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
        assert!(tables.starts_with("axis.boom: LATCHED by stall at "), "{tables}");
        assert!(!tables.contains("use a longer --duration"), "{tables}");
        assert!(errors.contains("the run ended with latched axes, whose valves are neutral: "), "{errors}");
        let report: Value = serde_json::from_str(&fs::read_to_string(folder.path().join("j.json")).unwrap()).unwrap();
        for (name, axis) in report["axes"].as_object().unwrap() {
            let at = axis["latch"]["at_s"].as_f64().unwrap();
            // The pump fails at 5 s. An axis has 0.4 s to move, and turns round within 3 s.
            assert!((5.0..9.0).contains(&at), "{name}: {at}");
            assert_eq!((&axis["latch"]["by"], &axis["latch"]["times"]), (&json!(["stall"]), &json!(1)), "{name}");
            assert!(axis["latch"]["at_end"].as_bool().unwrap(), "{name}");
        }
    }
    assert_eq!(report(&["simulate", "--duration", "3s"])["axes"]["boom"].get("latch"), None);
}

#[test]
fn an_axis_that_never_has_healthy_samples_is_latched_and_told() {
    let noise = ["simulate", "--set", "axis.boom.plant.encoder_noise=0.02", "--duration", "20s"];
    let output = run(tempfile::tempdir().unwrap().path(), &noise);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(1) && said.contains("axis.boom (feedback at 0.030000 s)"), "{said}");
    let tables = String::from_utf8(output.stdout).unwrap();
    let hint = "boom: no model yet: a fault latched the axis before it had moved enough to be identified";
    assert!(tables.contains(hint) && !tables.contains("arm: no model yet"), "{tables}");
}
