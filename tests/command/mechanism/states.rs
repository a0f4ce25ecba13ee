//! What `--states` accepts, and what it refuses.

use std::{fs::File, process::Stdio};

use super::*;
use crate::harness::{cli::run, hydraxis};

/// What the command says to states with this text: standard output and standard error.
fn said(folder: &Path, text: &str) -> (String, String) {
    fs::write(folder.join("states.json"), text).unwrap();
    let output = run(folder, &["mechanism", "m.toml", "--states", "states.json", "--json", "-"]);
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (text(output.stdout), text(output.stderr))
}

fn with(key: &str, value: Value) -> Value {
    let mut state = state();
    state[key] = value;
    state
}

#[test]
fn lengths_beyond_a_stroke_are_evaluated_with_a_warning_that_names_them() {
    let folder = folder();
    let beyond = with("cylinder_length", json!([1.86, 2.8, -0.1, 2.81]));
    let (answer, warnings) = said(folder.path(), &json!({ "states": [state(), beyond] }).to_string());
    for (number, expected) in [
        "warning: --states: states.json: states[1].cylinder_length[0]: found 1.86 m, beyond the stroke of the boom, \
         1.870 to 3.204 m",
        "warning: --states: states.json: states[1].cylinder_length[2]: found -0.1 m, beyond the stroke of the \
         telescope, 0.000 to 1.200 m",
        "warning: --states: states.json: states[1].cylinder_length[3]: found 2.81 m, beyond the stroke of the \
         bucket, 1.680 to 2.800 m",
    ]
    .into_iter()
    .enumerate()
    {
        assert_eq!(warnings.lines().nth(number), Some(expected), "{warnings}");
    }
    assert_eq!(warnings.lines().count(), 3, "{warnings}");
    let answer: Value = serde_json::from_str(&answer).unwrap();
    assert!(numbers(&answer["states"][1]["cylinder_acceleration"]).iter().all(|a| a.is_finite()));
    // Both ends belong to the stroke.
    for ends in [json!([1.87, 2.075, 0, 1.68]), json!([3.204, 3.565, 1.2, 2.8])] {
        let (_, warnings) = said(folder.path(), &json!({ "states": [with("cylinder_length", ends)] }).to_string());
        assert_eq!(warnings, "");
    }
}

#[test]
fn lengths_that_no_cylinder_has_are_refused() {
    let folder = folder();
    for (lengths, expected) in [
        (
            json!([-2.3, 2.8, 0.2, 2.3]),
            "states[0].cylinder_length[0]: found -2.3 m, with which the linkage of the boom",
        ),
        (json!([2.3, -2.8, 0.2, 2.3]), "states[0].cylinder_length[1]: found -2.8 m, with which the linkage of the arm"),
        (
            json!([2.3, 2.8, -2.5, 2.3]),
            "states[0].cylinder_length[2]: found -2.5 m, with which the linkage of the tele",
        ),
        (
            json!([2.3, 2.8, 0.2, -2.3]),
            "states[0].cylinder_length[3]: found -2.3 m, with which the linkage of the buck",
        ),
    ] {
        let states = json!({ "states": [with("cylinder_length", lengths)] });
        expect_states_refused(folder.path(), &states.to_string(), expected);
    }
}

#[test]
fn no_number_is_so_large_that_the_answer_is_none() {
    let folder = folder();
    for (key, value, expected) in [
        (
            "cylinder_length",
            json!([2.3, 2.8, 1e200, 2.3]),
            "cylinder_length[2]: found 1e200; allowed: numbers from -200",
        ),
        (
            "cylinder_velocity",
            json!([0, 1e200, 0, 0]),
            "cylinder_velocity[1]: found 1e200; allowed: numbers from -1000",
        ),
        (
            "cylinder_force",
            json!([0, 0, 0, -1e200]),
            "cylinder_force[3]: found -1e200; allowed: numbers from -1000000000",
        ),
        ("tip_force", json!([1e200, 0]), "tip_force[0]: found 1e200; allowed: numbers from -1000000000"),
    ] {
        expect_states_refused(folder.path(), &json!({ "states": [with(key, value)] }).to_string(), expected);
    }
    let mut largest = state();
    for (key, value) in [("cylinder_velocity", 1e3), ("cylinder_force", 1e9)] {
        largest[key] = json!(vec![value; 4]);
    }
    (largest["payload"], largest["tip_force"]) = (json!(1e6), json!([1e9, -1e9]));
    // At the boom's dead centre the cylinder is as long as both sides of its triangle together.
    let sides = 0.582 * 2f64.sqrt() + 2.431f64.hypot(0.982);
    for length in [2.3, sides - 1e-15, sides - 1e-12] {
        largest["cylinder_length"][0] = json!(length);
        let (answer, errors) = said(folder.path(), &json!({ "states": [largest] }).to_string());
        assert!(!answer.contains("null"), "{length}: {answer}");
        assert!(!answer.is_empty() || errors.contains("allowed:"), "{length}: {errors}");
    }
}

#[test]
fn unknown_keys_and_keys_that_are_given_twice_are_refused() {
    let folder = folder();
    let states = json!({ "states": [with("tipforce", json!([0, 0]))] }).to_string();
    let expected = "states[0].tipforce: found an unknown key; allowed: one of cylinder_length, cylinder_velocity,";
    expect_states_refused(folder.path(), &states, expected);
    let expected = "parameter: found an unknown key; allowed: one of about, parameters, states";
    expect_states_refused(folder.path(), &json!({ "parameter": {}, "states": [state()] }).to_string(), expected);
    let twice = json!({ "states": [state()] }).to_string().replace("\"payload\"", "\"payload\":0,\"payload\"");
    expect_states_refused(folder.path(), &twice, "found the key \"payload\" twice at line 1 column");
}

#[test]
fn an_answer_is_a_file_of_states() {
    let folder = folder();
    let (answer, _) = said(folder.path(), &json!({ "about": "one", "states": [state()] }).to_string());
    let (again, warnings) = said(folder.path(), &answer);
    assert_eq!((again, warnings.as_str()), (answer, ""));
}

#[test]
fn a_payload_of_the_parameters_is_that_of_states_without_one() {
    let folder = folder();
    let with_payload = |payload: Value| {
        let mut parameters = parameters();
        parameters["payload"] = payload;
        let mut state = state();
        state.as_object_mut().unwrap().remove("payload");
        json!({ "parameters": parameters, "states": [state, super::state()] })
    };
    let found = answer(folder.path(), &with_payload(json!([800, 0.75, 0.22, 800.0 * 0.5 * 0.5])));
    let states = &found["states"];
    assert_eq!((&states[0]["payload"], &states[1]["payload"]), (&json!(800.0), &json!(700.0)));
    let point = answer(folder.path(), &with_payload(json!([800, 0.75, 0.22, 0])));
    let inertia = |found: &Value, state: usize| numbers(&found["states"][state]["M"])[15];
    for (state, mass) in [(0, 800.0), (1, 700.0)] {
        let added = inertia(&found, state) - inertia(&point, state);
        assert!((added - mass * 0.5 * 0.5).abs() < 1e-9, "{added} kg m2");
    }
    for payload in [json!([0, 0.75, 0.22, 100]), json!([1e-3, 0.75, 0.22, 1e9])] {
        expect_states_refused(folder.path(), &with_payload(payload).to_string(), "allowed: an inertia from 0 to the");
    }
}

#[test]
fn parameters_can_say_the_strokes() {
    let folder = folder();
    let mut parameters = parameters();
    parameters["lmin"] = json!([1.87, 2.075, 0, 1.68]);
    let states = json!({ "parameters": parameters, "states": [state()] }).to_string();
    expect_states_refused(folder.path(), &states, "parameters.stroke: found nothing; allowed: 4 numbers, m");
    parameters["stroke"] = json!([0.4, 1.49, 1.2, 1.12]);
    let (_, warnings) = said(folder.path(), &json!({ "parameters": parameters, "states": [state()] }).to_string());
    assert!(
        warnings.contains("states[0].cylinder_length[0]: found 2.3 m, beyond the stroke of the boom"),
        "{warnings}"
    );
}

#[test]
fn states_come_from_standard_input_and_with_a_byte_order_mark() {
    let folder = folder();
    let text = json!({ "states": [state()] }).to_string();
    let (answer, _) = said(folder.path(), &text);
    let (marked, warnings) = said(folder.path(), &format!("\u{feff}{text}"));
    assert_eq!((&marked, warnings.as_str()), (&answer, ""));
    fs::write(folder.path().join("states.json"), text).unwrap();
    let mut command = hydraxis();
    command.current_dir(&folder).args(["mechanism", "m.toml", "--states", "-", "--json", "-"]);
    command.stdin(Stdio::from(File::open(folder.path().join("states.json")).unwrap()));
    assert_eq!(String::from_utf8(command.output().unwrap().stdout).unwrap(), answer);
}

#[test]
fn a_file_without_end_is_refused() {
    let folder = folder();
    let arguments = ["mechanism", "m.toml", "--states", "/dev/zero"];
    expect_refusal(folder.path(), &arguments, &["--states: /dev/zero: found more than 67108864 bytes; allowed: up to"]);
}
