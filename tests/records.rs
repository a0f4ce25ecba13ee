//! Measured records of public benchmarks, as CSV files, and reference states of an excavator. They are not part of the
//! project: `HYDRAXIS_RECORDS` names the folder in which they lie. Every test here is ignored unless it is asked for
//! (`cargo test --test records -- --ignored`), and fails where its record is missing.

mod harness;

use std::fs;

use serde_json::Value;

use harness::{
    cli::success,
    records::{
        expect_finite_with_short_memory, expect_good_auto, expect_identified, identify, measured, number, simulated,
    },
    replay::expect_same_bits,
};

#[test]
#[ignore = "needs the measured records; HYDRAXIS_RECORDS names their folder"]
fn the_hydraulic_actuator_is_modelled_as_well_as_published() {
    let folder = measured("hydraulic_actuator.csv");
    let arguments = ["hydraulic_actuator.csv", "--train", "512", "--period", "1", "--horizon", "10"];
    let report = identify(&folder, &arguments);
    let error = |place: &str| number(&report, place);
    let (one_step, free_run) = (error("/classical/one_step/rmse"), error("/classical/free_run/rmse"));
    assert!(one_step <= 0.110, "one step: {one_step}");
    assert!(free_run <= 0.55, "free run: {free_run}");
    let online = error("/adaptive/one_step/rmse");
    assert!(online <= 0.102, "one step, adapted online: {online}");
}

/// The measured records whose comparison takes seconds, with the arguments for each. The horizon is half a second, or a
/// few samples where half a second is less than one.
const COMPARED: [&[&str]; 10] = [
    &["hydraulic_actuator.csv", "--period", "1", "--horizon", "10"],
    &["coupled_electric_drives.csv", "--input", "u1", "--output", "y1"],
    &["coupled_electric_drives.csv", "--input", "u2", "--output", "y2"],
    &["coupled_electric_drives.csv", "--input", "u3", "--output", "y3"],
    &["cascaded_tanks.csv", "--input", "u_train", "--output", "y_train", "--horizon", "5"],
    &["cascaded_tanks.csv", "--input", "u_test", "--output", "y_test", "--horizon", "5"],
    &["dryer.csv"],
    &["gas_furnace.csv", "--horizon", "5"],
    &["ballbeam.csv"],
    &["hydraulic_actuator.csv", "--period", "1", "--horizon", "5"],
];
/// The simulated records, which count in the mean too.
const SIMULATED: [&str; 3] = ["servo_constant.csv", "servo_warmup.csv", "servo_payload.csv"];

#[test]
#[ignore = "needs the measured records; HYDRAXIS_RECORDS names their folder"]
fn auto_is_on_average_as_good_as_the_best_constant_factor_in_hindsight() {
    let simulated = SIMULATED.iter().map(|file| expect_good_auto(&simulated(), &[file]));
    let measured = COMPARED.iter().map(|typed| expect_good_auto(&measured(typed[0]), typed));
    let ratios: Vec<f64> = simulated.chain(measured).collect();
    let mean = (ratios.iter().map(|ratio| ratio.ln()).sum::<f64>() / ratios.len() as f64).exp();
    assert!(mean <= 1.0, "{mean}");
}

#[test]
#[ignore = "needs the measured records; HYDRAXIS_RECORDS names their folder"]
fn estimators_of_a_short_memory_stay_finite() {
    for file in ["emps_train.csv", "emps_test.csv"] {
        expect_finite_with_short_memory(&measured(file), file);
    }
}

#[test]
#[ignore = "needs the measured records; HYDRAXIS_RECORDS names their folder"]
fn every_record_with_time_input_and_output_is_identified() {
    let folder = measured("emps_train.csv");
    let mut identified = 0;
    for file in fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()) {
        let has_columns = || {
            let text = fs::read_to_string(folder.join(&file)).unwrap();
            let names: Vec<&str> = text.lines().next().unwrap_or("").split(',').map(str::trim).collect();
            ["t", "u", "y"].iter().all(|name| names.contains(name))
        };
        if file.ends_with(".csv") && has_columns() {
            expect_identified(&folder, &file);
            identified += 1;
        }
    }
    assert!(identified > 0, "no record with columns t, u, y in {}", folder.display());
}

/// Reference states of an excavator: what another library for multibody dynamics makes of given states.
#[test]
#[ignore = "needs the measured records; HYDRAXIS_RECORDS names their folder"]
fn the_mechanism_agrees_with_reference_states() {
    let file = "excavator_reference.json";
    let folder = measured(file);
    let reference: Value = serde_json::from_str(&fs::read_to_string(folder.join(file)).unwrap()).unwrap();
    let answer = success(&folder, &["mechanism", "--states", file, "--json", "-"]);
    let answer: Value = serde_json::from_str(&answer).unwrap();
    let expected = reference["states"].as_array().unwrap();
    assert_eq!(answer["states"].as_array().unwrap().len(), expected.len());
    for (number, expected) in expected.iter().enumerate() {
        for (key, value) in expected.as_object().unwrap() {
            let (found, expected) = (numbers(&answer["states"][number][key]), numbers(value));
            let largest = expected.iter().fold(f64::MIN_POSITIVE, |most, value| most.max(value.abs()));
            assert_eq!(found.len(), expected.len(), "state {number}, {key}");
            let worst = found.iter().zip(&expected).map(|(a, b)| (a - b).abs() / largest).fold(0.0, f64::max);
            assert!(worst < 1e-12, "state {number}, {key}: {found:?} instead of {expected:?}");
        }
    }
}

/// All numbers of a value, row by row.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(list) => list.iter().flat_map(numbers).collect(),
        value => vec![value.as_f64().unwrap()],
    }
}

#[test]
#[ignore = "needs the measured records; HYDRAXIS_RECORDS names their folder"]
fn the_positioning_benchmark_has_the_same_bits_in_four_processes_and_in_one() {
    let file = "emps_train.csv";
    expect_same_bits(&measured(file).join(file), "1ms", 10_000);
}
