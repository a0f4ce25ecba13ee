//! `hydraxis mechanism`: figures over the workspace, states, URDF, and `check` of a machine with a mechanism.

mod states;

use std::{fs, path::Path};

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::harness::{
    cli::{expect_refusal, success},
    mechanism::excavator,
};

/// A folder with the excavator as `m.toml`.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("m.toml"), excavator()).unwrap();
    folder
}

fn figures(folder: &Path, payload: f64) -> Value {
    let payload = format!("mechanism.payload.mass={payload}");
    serde_json::from_str(&success(folder, &["mechanism", "m.toml", "--set", &payload, "--json", "-"])).unwrap()
}

/// Expects the 5, 50 and 95 % values, in parts of `unit`, each within 5 % of itself or, where the values change their
/// sign, of the largest.
fn expect_spread(found: &Value, unit: f64, expected: [f64; 3]) {
    let largest = expected.iter().fold(0.0f64, |most, value| most.max(value.abs()));
    let is_mixed = expected[0] * expected[2] <= 0.0;
    for (key, expected) in ["p5", "p50", "p95"].iter().zip(expected) {
        let value = found[*key].as_f64().unwrap() / unit;
        let allowed = 0.05 * if is_mixed { largest } else { expected.abs() };
        assert!((value - expected).abs() <= allowed, "{key} {value} instead of {expected}: {found}");
    }
}

/// Expected values: an independent evaluation of the same machine at 19 000 postures of its workspace.
#[test]
fn masses_loads_and_frequencies_over_the_workspace_are_those_of_the_excavator() {
    let folder = folder();
    let empty = figures(folder.path(), 0.0);
    assert!(empty["workspace"]["postures"].as_u64().unwrap() > 19_000);
    for (axis, mass, gravity, tip) in [
        (0, [116.0, 193.0, 343.0], [183.0, 225.0, 257.0], Some((8.9, 13.5))),
        (1, [12.7, 20.0, 43.0], [-53.0, -14.0, 45.0], Some((5.3, 7.7))),
        (2, [1.31, 1.31, 1.31], [-12.8, -11.4, -2.9], Some((1.0, 1.0))),
        (3, [1.8, 2.2, 5.9], [-10.0, 0.0, 14.0], Some((3.3, 5.4))),
    ] {
        let axis = &empty["axes"][axis];
        expect_spread(&axis["reflected_mass"], 1e3, mass);
        expect_spread(&axis["gravity"], 1e3, gravity);
        let (median, most) = tip.unwrap();
        let ratio = |key: &str| axis["tip_ratio"][key].as_f64().unwrap();
        assert!((ratio("p50") / median - 1.0).abs() < 0.05 && (ratio("p95") / most - 1.0).abs() < 0.05, "{axis}");
    }
    let loaded = figures(folder.path(), 1500.0);
    for (axis, mass, gravity) in [
        (0, [158.0, 319.0, 603.0], [241.0, 340.0, 415.0]),
        (1, [33.0, 51.0, 108.0], [-119.0, -26.0, 106.0]),
        (2, [2.81, 2.81, 2.81], [-28.0, -24.0, -6.0]),
        (3, [5.9, 7.5, 20.0], [-36.0, 2.0, 49.0]),
    ] {
        expect_spread(&loaded["axes"][axis]["reflected_mass"], 1e3, mass);
        expect_spread(&loaded["axes"][axis]["gravity"], 1e3, gravity);
    }
    for (figures, low, high) in [(&empty, 2.6, 4.0), (&loaded, 1.9, 3.3)] {
        let frequency = &figures["axes"][0]["ideal_frequency"];
        let (p5, p95) = (frequency["p5"].as_f64().unwrap(), frequency["p95"].as_f64().unwrap());
        assert!((p5 / low - 1.0).abs() < 0.05 && (p95 / high - 1.0).abs() < 0.05, "{frequency}");
        // The slowest mode of all cylinders is slower than the boom alone.
        let p5 = figures["axes"][0]["natural_frequency"]["p5"].as_f64().unwrap();
        let slowest = figures["workspace"]["coupled_frequencies"][0]["p5"].as_f64().unwrap();
        assert!(slowest < p5, "{slowest} {p5}");
    }
}

#[test]
fn reach_and_joints_are_those_of_the_excavator() {
    let folder = folder();
    let found = figures(folder.path(), 0.0);
    for (row, (reach, depth)) in [(9.5, 6.1), (10.1, 6.7), (10.7, 7.3)].into_iter().enumerate() {
        let extent = |key: &str| found["extents"][row][key].as_f64().unwrap();
        assert!((extent("reach") - reach).abs() < 0.06 && (extent("depth") - depth).abs() < 0.06, "{found}");
    }
    for (axis, from, to) in [(0, -47.0f64, 62.0f64), (1, -32.0, -150.0), (3, 38.8, -123.2)] {
        let joint = |i: usize| found["axes"][axis]["joint"][i].as_f64().unwrap().to_degrees();
        assert!((joint(0) - from).abs() < 0.15 && (joint(1) - to).abs() < 0.15, "{found}");
    }
    for (axis, low, high) in [(0, 0.395, 0.823), (1, 0.366, 0.879), (3, 0.205, 0.513)] {
        let arm = |i: usize| found["axes"][axis]["moment_arm"][i].as_f64().unwrap();
        assert!((arm(0) - low).abs() < 1e-3 && (arm(1) - high).abs() < 1e-3, "{found}");
    }
    let text = success(folder.path(), &["mechanism", "m.toml"]);
    assert!(text.contains("-47.0 .. 62.0 deg  0.395 .. 0.823"), "{text}");
    assert!(text.contains("natural frequency  of this mass on the oil of chambers and hoses"), "{text}");
}

/// Expected values: frequencies at which the simulated machine rings at its start, without friction and leakage
/// (`plant-sim/tests/coupling/modes.rs`).
#[test]
fn coupled_frequencies_are_those_of_the_simulated_machine_with_its_hoses() {
    let folder = folder();
    fs::write(folder.path().join("excavator.toml"), include_str!("../../examples/excavator.toml")).unwrap();
    let text = success(folder.path(), &["mechanism", "excavator.toml", "--json", "-"]);
    let found: Value = serde_json::from_str(&text).unwrap();
    for (found, expected) in numbers(&found["start_frequencies"]).into_iter().zip([2.304, 3.707, 11.95, 16.25]) {
        assert!((found / expected - 1.0).abs() < 5e-3, "{found} Hz for {expected} Hz");
    }
}

fn state() -> Value {
    json!({
        "cylinder_length": [2.3, 2.8, 0.2, 2.3], "cylinder_velocity": [0.1, -0.2, 0.3, -0.4],
        "cylinder_force": [2e5, 1e4, -1e4, 2e3], "payload": 700.0, "tip_force": [-3e3, 1e3],
    })
}

/// The answer for `states.json` with this text.
fn answer(folder: &Path, text: &Value) -> Value {
    fs::write(folder.join("states.json"), text.to_string()).unwrap();
    let arguments = ["mechanism", "m.toml", "--states", "states.json", "--json", "-"];
    serde_json::from_str(&success(folder, &arguments)).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(list) => list.iter().flat_map(numbers).collect(),
        value => vec![value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))],
    }
}

#[test]
fn a_state_is_answered_with_terms_that_satisfy_the_equation_of_motion() {
    let folder = folder();
    let found = answer(folder.path(), &json!({ "states": [state(), state()] }));
    assert_eq!(found["states"].as_array().unwrap().len(), 2);
    let found = &found["states"][1];
    let of = |key: &str| numbers(&found[key]);
    let (mass, load, tau, qdd) = (of("M"), of("coriolis_and_gravity"), of("tau"), of("qdd"));
    // The virtual work of the force at the teeth: J_tip^T f, from the speed of the teeth under one joint at a time.
    let tip_velocity = |rates: [f64; 4]| {
        let mut state = state();
        state["cylinder_velocity"] = json!(rates);
        let answer = answer(folder.path(), &json!({ "states": [state] }));
        numbers(&answer["states"][0]["tip_velocity"])
    };
    for joint in 0..4 {
        let mut rates = [0.0; 4];
        rates[joint] = 1.0 / of("dq_dl")[joint];
        let work: f64 = tip_velocity(rates).iter().zip(of("tip_force")).map(|(v, f)| v * f).sum();
        let inertia: f64 = (0..4).map(|k| mass[4 * joint + k] * qdd[k]).sum();
        let left = inertia + load[joint];
        assert!((left - tau[joint] - work).abs() < 1e-9 * tau[0].abs(), "joint {joint}: {left} {} {work}", tau[joint]);
    }
    let table = success(folder.path(), &["mechanism", "m.toml", "--states", "states.json"]);
    assert!(table.contains("boom, m/s2"), "{table}");
}

/// Pins and masses of the machine, as `parameters` of a file of states.
fn parameters() -> Value {
    json!({
        "O1": [0.23, 1.96], "L1": 5.65, "P1": [0.582, -0.582], "B1": [2.431, 0.982], "B2": [3.004, 0.885],
        "A1": [-0.843, 0.249], "L2": 2.4, "R": [-0.41, 0.0], "C": [-2.597, 0.711], "r": 0.7, "k": 0.6, "h": 0.466,
        "kappa": 1.7715091907742444, "L3": 1.51, "boom": [2130, 2.75, 0.55, 5450], "arm": [850, 0.75, 0.1, 480],
        "inner": [650, -1.0, 0.15, 280], "bucket": [660, 0.65, 0.28, 130], "payload": [0, 0.75, 0.22, 0], "g": 9.81,
    })
}

#[test]
fn parameters_of_the_file_take_the_place_of_those_of_the_machine() {
    let folder = folder();
    let parameters = parameters();
    let machine = answer(folder.path(), &json!({ "states": [state()] }));
    let same = answer(folder.path(), &json!({ "parameters": parameters, "states": [state()] }));
    for (key, value) in machine["states"][0].as_object().unwrap() {
        let (a, b) = (numbers(value), numbers(&same["states"][0][key]));
        let largest = a.iter().fold(1e-300, |most: f64, value| most.max(value.abs()));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-13 * largest), "{key}: {a:?} {b:?}");
    }
    let mut longer = parameters.clone();
    longer["L1"] = json!(5.75);
    let other = answer(folder.path(), &json!({ "parameters": longer, "states": [state()] }));
    assert_ne!(other["states"][0]["tip"], machine["states"][0]["tip"]);

    for (key, value, expected) in [
        ("L1", json!(-1), "parameters.L1: found -1; allowed: a number from 0.001 to 100 m"),
        ("P1", json!([1.0]), "parameters.P1: found [1.0]; allowed: 2 numbers, m, [x, z]"),
        ("boom", json!(null), "parameters.boom: found null; allowed: 4 numbers, [kg, m, m, kg m2]"),
        ("arm", json!([-850, 0.75, 0.1, 480]), "parameters.arm: found -850 kg, 480 kg m2; allowed: numbers from 0 on"),
        (
            "arm",
            json!([1e7, 0.75, 0.1, 480]),
            "parameters.arm: found 10000000 kg at [0.75, 0.1] m; allowed: up to 1000",
        ),
        ("A1", json!([1e200, 0]), "parameters.A1[0]: found 1e200; allowed: numbers from -100 to 100, m, [x, z]"),
        ("l1", json!(1), "parameters.l1: found an unknown key; allowed: one of O1, L1, P1,"),
        ("g", json!(1.62), "parameters.g: found 1.62; allowed: 9.81"),
    ] {
        let mut wrong = parameters.clone();
        wrong[key] = value;
        expect_states_refused(
            folder.path(),
            &json!({ "parameters": wrong, "states": [state()] }).to_string(),
            expected,
        );
    }
    let mut missing = parameters;
    missing.as_object_mut().unwrap().remove("kappa");
    let text = json!({ "parameters": missing, "states": [state()] }).to_string();
    expect_states_refused(
        folder.path(),
        &text,
        "parameters.kappa: found nothing; allowed: a number from -10 to 10 rad",
    );
}

fn expect_states_refused(folder: &Path, text: &str, expected: &str) {
    fs::write(folder.join("states.json"), text).unwrap();
    let arguments = ["mechanism", "m.toml", "--states", "states.json", "--json", "-"];
    expect_refusal(folder, &arguments, &["--states: states.json: ", expected]);
}

#[test]
fn wrong_states_are_refused_with_their_place() {
    let folder = folder();
    for (key, value, expected) in [
        (
            "cylinder_length",
            json!([2.3, 2.8, 0.2]),
            "states[1].cylinder_length: found [2.3,2.8,0.2]; allowed: 4 numbers, m",
        ),
        (
            "cylinder_length",
            json!([2.3, 2.8, 0.2, null]),
            "states[1].cylinder_length: found [2.3,2.8,0.2,null]; allowed: 4",
        ),
        ("cylinder_length", json!([3.5, 2.8, 0.2, 2.3]), "with which the linkage of the boom does not close; allowed:"),
        ("cylinder_length", json!([2.3, 2.8, 0.2, 3.2]), "with which the linkage of the bucket does not close"),
        ("cylinder_velocity", json!("fast"), "states[1].cylinder_velocity: found \"fast\"; allowed: 4 numbers, m/s"),
        ("cylinder_force", json!({}), "states[1].cylinder_force: found an object; allowed: 4 numbers, N"),
        ("payload", json!(-5), "states[1].payload: found -5; allowed: a number from 0 to 1000000 kg"),
        ("tip_force", json!([1, 2, 3]), "states[1].tip_force: found [1,2,3]; allowed: 2 numbers, N, [x, z]"),
    ] {
        let mut wrong = state();
        wrong[key] = value;
        expect_states_refused(folder.path(), &json!({ "states": [state(), wrong] }).to_string(), expected);
        let mut missing = state();
        missing.as_object_mut().unwrap().remove(key);
        let expected = format!("states[1].{key}: found nothing; allowed:");
        expect_states_refused(folder.path(), &json!({ "states": [state(), missing] }).to_string(), &expected);
    }
    let not_a_number = json!({ "states": [state()] }).to_string().replace("700.0", "NaN");
    expect_states_refused(folder.path(), &not_a_number, "found no JSON: expected value at line 1 column");
    let infinite = json!({ "states": [state()] }).to_string().replace("700.0", "1e999");
    expect_states_refused(folder.path(), &infinite, "found no JSON: number out of range");
    expect_states_refused(
        folder.path(),
        "{\"states\": []}",
        "states: found an empty list; allowed: a list of one or more",
    );
    expect_states_refused(folder.path(), "[]", "states: found nothing; allowed: a list of one or more states");
    expect_states_refused(folder.path(), "{\"states\": [3]}", "states[0]: found 3; allowed: an object");
    let arguments = ["mechanism", "m.toml", "--states", "none.json"];
    expect_refusal(folder.path(), &arguments, &["--states: none.json: found a file that cannot be read (No such file"]);
}

#[test]
fn a_machine_without_a_mechanism_has_nothing_to_show() {
    let folder = tempfile::tempdir().unwrap();
    let text = include_str!("../../fuzz/seeds/machine_file/one-axis");
    fs::write(folder.path().join("one.toml"), text).unwrap();
    expect_refusal(
        folder.path(),
        &["mechanism", "one.toml"],
        &["one.toml: mechanism: found nothing; allowed: the tables [mechanism.boom], .arm, .telescope and .bucket"],
    );
    fs::write(folder.path().join("states.json"), json!({ "states": [state()] }).to_string()).unwrap();
    let arguments = ["mechanism", "one.toml", "--states", "states.json"];
    expect_refusal(folder.path(), &arguments, &["parameters: found nothing; allowed: pins and masses in the file, or"]);
}

#[test]
fn urdf_has_the_tree_of_joints_with_their_ranges() {
    let folder = folder();
    let set = ["--set", "mechanism.payload.mass=800", "--set", "name=\"a <b> & c\""];
    let text = success(folder.path(), &[&["mechanism", "m.toml", "--urdf", "-"], &set[..]].concat());
    assert!(text.starts_with("<?xml version=\"1.0\"?>\n<robot name=\"a &lt;b&gt; &amp; c\">\n"), "{text}");
    assert!(text.ends_with("</robot>\n"), "{text}");
    for (child, parent, kind) in [
        ("boom", "base", "revolute"),
        ("arm", "boom", "revolute"),
        ("telescope", "arm", "prismatic"),
        ("bucket", "telescope", "revolute"),
        ("payload", "bucket", "fixed"),
        ("tip", "bucket", "fixed"),
    ] {
        let name = if kind == "fixed" { "mount" } else { "joint" };
        let begin = text.find(&format!("<joint name=\"{child}_{name}\" type=\"{kind}\">")).expect(child);
        let joint = &text[begin..begin + text[begin..].find("</joint>").unwrap()];
        assert!(joint.contains(&format!("<parent link=\"{parent}\"/>")), "{joint}");
        assert_eq!(joint.contains("<limit lower="), kind != "fixed", "{joint}");
    }
    // Moment arms of 0.395 to 0.823 m at 0.0226 m2, 35 MPa and 1 m/s.
    let of_boom = &text[text.find("<joint name=\"boom_joint\"").unwrap()..];
    let limit = |key: &str| -> f64 {
        let begin = of_boom.find(&format!("{key}=\"")).unwrap() + key.len() + 2;
        of_boom[begin..].split('"').next().unwrap().parse().unwrap()
    };
    assert!((limit("effort") / (0.0226 * 35e6 * 0.823) - 1.0).abs() < 1e-3, "{of_boom}");
    assert!((limit("velocity") * 0.395 - 1.0).abs() < 1e-2, "{of_boom}");
    // To a file, with the tables beside it.
    let tables = success(folder.path(), &["mechanism", "m.toml", "--urdf", "m.urdf"]);
    assert!(tables.contains("Farthest places") && folder.path().join("m.urdf").is_file());
    let both = ["mechanism", "m.toml", "--urdf", "-", "--json", "-"];
    expect_refusal(folder.path(), &both, &["-: found for --json and --urdf; allowed: one on standard output"]);
    expect_refusal(
        folder.path(),
        &["mechanism", "m.toml", "--urdf", "no/m.urdf"],
        &["--urdf: no/m.urdf cannot be written"],
    );
}

#[test]
fn a_joint_that_turns_past_half_a_turn_keeps_its_range() {
    let folder = folder();
    let joint = |rod: &str| {
        let rod = format!("mechanism.arm.cylinder_rod={rod}");
        let text = success(folder.path(), &["mechanism", "m.toml", "--set", &rod, "--json", "-"]);
        let found: Value = serde_json::from_str(&text).unwrap();
        let joint = |place: usize| found["axes"][1]["joint"][place].as_f64().unwrap().to_degrees();
        [joint(0), joint(1)]
    };
    // The rod pin at the same distance from the arm pin, 60 degrees farther: the arm hangs by as much lower.
    let (x, z) = (-0.843f64, 0.249f64);
    let (sin, cos) = 60f64.to_radians().sin_cos();
    let [usual, turned] = [[x, z], [x * cos - z * sin, x * sin + z * cos]].map(|[x, z]| joint(&format!("[{x}, {z}]")));
    for (usual, turned) in usual.into_iter().zip(turned) {
        assert!((usual - 60.0 - turned).abs() < 1e-9, "{usual} {turned}");
    }
}

#[test]
fn check_prints_reach_joints_and_the_load_at_rest() {
    let folder = folder();
    let text = success(folder.path(), &["check", "m.toml"]);
    for expected in [
        "mechanism: the teeth reach 9.5 m forward and 6.1 m deep, 10.7 and 7.3 m with the telescope out\n",
        "joints: boom -47.0 .. 62.0 deg, arm -32.0 .. -149.9 deg, telescope 0.00 .. 1.20 m, bucket 38.8 .. -123.2 deg",
        "load at rest, 0 kg in the bucket: boom 224 kN (9.9 MPa), arm -11 kN (1.5 MPa), telescope -13 kN",
    ] {
        assert!(text.contains(expected), "{text}");
    }
}

#[test]
fn check_warns_of_loads_that_open_the_relief_valves() {
    let folder = folder();
    let with = |settings: &[&str]| {
        let settings = settings.iter().flat_map(|setting| ["--set", setting]);
        success(folder.path(), &["check", "m.toml"].into_iter().chain(settings).collect::<Vec<_>>())
    };
    assert!(!with(&[]).contains("warning: axis"));
    // The boom holds at most 14.0 MPa empty, and 21.5 MPa under the payload of a scenario.
    let text = with(&["axis.boom.plant.relief_pressure=8e6"]);
    let expected = "warning: axis.boom.plant.relief_pressure: found 8.0 MPa, and a load at rest of 316 kN, 14.0";
    assert!(text.contains(expected) && text.contains("MPa, with 0 kg in the bucket in the posture ["), "{text}");
    let settings = ["axis.boom.plant.relief_pressure=15e6", "scenario=payload"];
    assert!(!with(&settings[..1]).contains("warning: axis"));
    let text = with(&settings);
    assert!(text.contains("found 15.0 MPa") && text.contains("with 1500 kg in the bucket"), "{text}");
}

#[test]
fn check_refuses_end_stops_into_which_the_linkage_cannot_follow() {
    let folder = folder();
    let set = "axis.boom.plant.end_stop_stiffness=1e6";
    expect_refusal(folder.path(), &["check", "m.toml", "--set", set], &["axis.boom.plant.end_stop_stiffness: found"]);
}

#[test]
fn check_finds_pins_with_which_the_machine_cannot_move() {
    let folder = folder();
    for (set, expected) in [
        (
            "mechanism.boom.cylinder_rod=[8,1]",
            "mechanism.boom: found pins that close at no length from 1.850 to 3.224 m",
        ),
        ("mechanism.arm.cylinder_rod=[-0.343,0.249]", "mechanism.arm: found a dead centre at position"),
        ("mechanism.bucket.link_length=0.5", "mechanism.bucket: found a dead centre at position"),
        ("mechanism.boom.cylinder_length=1.819", "mechanism.boom: found a moment arm of 0.0"),
        (
            "axis.boom.plant.mass=4e4",
            "axis.boom.plant.mass: found 4e4 (from the command line); allowed: no such key here: [mechanism]",
        ),
    ] {
        expect_refusal(folder.path(), &["check", "m.toml", "--set", set], &[expected]);
    }
}

#[test]
fn a_picture_shows_the_machine_beside_the_curves() {
    let folder = folder();
    let picture = success(folder.path(), &["simulate", "m.toml", "--duration", "2s", "--plot", "-"]);
    assert!(picture.starts_with("<svg width=\"2800\" height="), "{}", &picture[..200]);
    assert!(picture.contains("above ground, m") && picture.contains("2.0 s"), "{}", &picture[..200]);
    assert!(!picture.contains("NaN"));
}
