//! The shipped 20 t excavator: a coupled mechanism on a load-sensing pump.

use std::path::Path;

use super::trajectory;
use crate::harness::report;

/// The machine file, from the folder in which the tests run.
const MACHINE: &str = "examples/excavator.toml";

const AXES: [&str; 4] = ["boom", "arm", "telescope", "bucket"];

#[test]
fn the_20_t_excavator_follows_calmly_without_a_fault() {
    for (scenario, seed) in [("nominal", "1"), ("nominal", "2"), ("payload", "1"), ("aeration", "2"), ("digging", "3")]
    {
        let report = report(&["simulate", MACHINE, "--scenario", scenario, "--seed", seed, "--duration", "30s"]);
        for axis in AXES {
            let tracking = &report["axes"][axis]["tracking"];
            // Every tick counts from the end of settling on: an axis that a fault has latched would count less.
            assert!(tracking["count"].as_u64().unwrap() > 2700, "{scenario} {seed} {axis}: {tracking}");
            let rmse = tracking["rmse"].as_f64().unwrap();
            assert!(rmse < 0.03, "{scenario} {seed} {axis}: {rmse} m rms");
        }
    }
}

#[test]
fn the_arm_pushes_the_boom_whose_valve_is_shut() {
    let folder = tempfile::tempdir().unwrap();
    let commands = folder.path().join("u.csv");
    // The arm extends for a second.
    let row = |i: i32| format!("{},{}\n", 0.01 * f64::from(i), if (50..150).contains(&i) { 0.8 } else { 0.0 });
    std::fs::write(&commands, "t,arm\n".to_owned() + &(0..300).map(row).collect::<String>()).unwrap();
    let run = trajectory(Path::new("."), &[MACHINE, "--open-loop", commands.to_str().unwrap()]);
    let positions = run.column("boom.position");
    let moved = positions.iter().map(|position| (position - positions[0]).abs()).fold(0.0, f64::max);
    println!("the boom's piston moves by {:.2} mm", 1e3 * moved);
    // An axis with a mass of its own would not move at all; a boom that is not held would sink by far more.
    assert!((1e-3..6e-3).contains(&moved), "{moved}");
}

#[test]
fn both_examples_have_one_mechanism() {
    let read = |path: &str| std::fs::read_to_string(path).unwrap();
    let mechanism = read("examples/mechanism.toml");
    let tables = &mechanism[mechanism.find("[mechanism.boom]").unwrap()..];
    assert!(tables.contains("[mechanism.bucket]") && read(MACHINE).contains(tables.trim_end()));
}
