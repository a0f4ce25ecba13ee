//! `hydraxis identify` as a user runs it: the figures of records whose plant the test knows, the choice of columns,
//! period, training and horizon, the two outputs, every refusal, and the public records where they are present.

mod cli;

use std::{
    fs,
    path::{Path, PathBuf},
};

use cli::{expect_refusal, success};
use serde_json::Value;
use tempfile::TempDir;

const A: [f64; 3] = [-1.5, 0.7, -0.1];
const B: [f64; 2] = [0.5, 0.3];
const F: [f64; 3] = [1.0, 0.4, -0.2];
const G: [f64; 3] = [0.8, -0.3, 0.15];
/// Sample period of the test's own records, s.
const PERIOD: f64 = 0.01;

/// (t, u, y) of the plant A, B, F, G, driven by three sines; B is multiplied by `gain` of the row.
fn simulate(rows: usize, gain: impl Fn(usize) -> f64) -> Vec<[f64; 3]> {
    let input = |k: usize| {
        let k = k as f64;
        0.5 * (0.085 * k).sin() + 0.35 * (0.61 * k + 1.0).sin() + 0.3 * (1.37 * k + 2.0).sin()
    };
    let valve = |u: f64| {
        let c = if u >= 0.0 { F } else { G };
        c[0] * u + c[1] * u.powi(2) + c[2] * u.powi(3)
    };
    let mut record: Vec<[f64; 3]> = Vec::with_capacity(rows);
    for k in 0..rows {
        let past = |lag: usize| k.checked_sub(lag).map_or([0.0; 3], |row| record[row]);
        let autoregressive: f64 = (1..=3).map(|i| A[i - 1] * past(i)[2]).sum();
        let driven: f64 = (1..=2).map(|j| B[j - 1] * valve(past(j)[1])).sum();
        record.push([k as f64 * PERIOD, input(k), gain(k) * driven - autoregressive]);
    }
    record
}

fn csv(header: &str, record: &[[f64; 3]]) -> String {
    let rows: String = record.iter().map(|[t, u, y]| format!("{t},{u},{y}\n")).collect();
    format!("{header}\n{rows}")
}

/// A folder with the text as `r.csv`.
fn folder_with(text: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("r.csv"), text).unwrap();
    folder
}

/// 600 rows of the plant as it is, `r.csv` in a folder.
fn constant_plant() -> TempDir {
    folder_with(&csv("t,u,y", &simulate(600, |_| 1.0)))
}

/// 2000 rows of a plant that is half as strong again from the middle on, `r.csv` in a folder.
fn changing_plant() -> TempDir {
    folder_with(&csv("t,u,y", &simulate(2000, |k| if k < 1000 { 1.0 } else { 1.5 })))
}

/// The JSON on standard output, which has to hold nothing else.
fn figures(folder: &Path, arguments: &[&str]) -> Value {
    let text = success(folder, &[&["identify", "r.csv", "--json", "-"], arguments].concat());
    serde_json::from_str(&text).unwrap()
}

/// The same without the wall time, which differs from run to run.
fn timeless(mut figures: Value) -> Value {
    let adaptive = figures["adaptive"].as_object_mut().unwrap();
    adaptive.remove("ns_per_update").unwrap();
    figures
}

fn number(figures: &Value, pointer: &str) -> f64 {
    let value = figures.pointer(pointer).unwrap_or_else(|| panic!("no {pointer} in {figures}"));
    value.as_f64().unwrap_or_else(|| panic!("{pointer} is {value}"))
}

fn expect_coefficients(figures: &Value, model: &str) {
    for (name, expected) in [("a", &A[..]), ("b", &B[..]), ("f", &F[..]), ("g", &G[..])] {
        let found: Vec<f64> = serde_json::from_value(figures[model]["coefficients"][name].clone()).unwrap();
        assert_eq!(found.len(), expected.len(), "{model} {name}");
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() <= 1e-6, "{model} {name}: {found} for {expected}");
        }
    }
}

#[test]
fn als_finds_the_coefficients_of_a_known_plant() {
    let figures = figures(constant_plant().path(), &["--train", "0.5", "--horizon", "10"]);
    assert_eq!(figures["split"], "als");
    expect_coefficients(&figures, "classical");
    expect_coefficients(&figures, "adaptive");
}

#[test]
fn the_formula_of_the_paper_finds_the_coefficients_of_a_known_plant() {
    let figures = figures(constant_plant().path(), &["--train", "0.5", "--horizon", "10", "--split", "paper"]);
    assert_eq!(figures["split"], "paper");
    expect_coefficients(&figures, "classical");
    expect_coefficients(&figures, "adaptive");
}

#[test]
fn the_json_tells_what_was_identified() {
    let figures = figures(constant_plant().path(), &["--train", "0.5", "--horizon", "10"]);
    let structure = serde_json::json!({
        "na": 3, "nb": 1, "nk": 1, "order": 3,
        "integrator": false, "drift": false, "dead_band": [0.0, 0.0], "knots": null
    });
    assert_eq!((&figures["structure"], &figures["output"]), (&structure, &"position".into()));
    for (name, expected) in [("rows", 600), ("train", 300), ("horizon", 10), ("irregular_steps", 0)] {
        assert_eq!(figures[name], expected, "{name}");
    }
    assert!((number(&figures, "/period_s") - PERIOD).abs() <= 1e-12);
    assert_eq!((&figures["form"], &figures["forgetting"]), (&"linear".into(), &"paper".into()));
    assert_eq!(figures["faults"], serde_json::json!([]));
}

#[test]
fn a_model_of_the_true_plant_predicts_without_error() {
    let figures = figures(constant_plant().path(), &["--train", "0.5", "--horizon", "10"]);
    for model in ["classical", "adaptive"] {
        for kind in ["one_step", "h_step", "free_run"] {
            let sigma = number(&figures, &format!("/{model}/{kind}/sigma"));
            assert!(sigma <= 1e-9, "{model} {kind}: {sigma}");
        }
    }
}

#[test]
fn reductions_are_finite_or_null_when_there_is_no_error_to_reduce() {
    // An output that stays where it is leaves errors of exactly 0, and 0 / 0.
    let rows: String = simulate(600, |_| 1.0).iter().map(|[t, u, _]| format!("{t},{u},1\n")).collect();
    let figures = figures(folder_with(&format!("t,u,y\n{rows}")).path(), &["--horizon", "10"]);
    for kind in ["one_step", "h_step", "free_run"] {
        let reduction = &figures["reduction_percent"][kind];
        assert!(reduction.is_null() || reduction.as_f64().is_some_and(f64::is_finite), "{kind}: {reduction}");
    }
}

#[test]
fn constant_forgetting_follows_a_gain_that_changes() {
    let figures = figures(changing_plant().path(), &["--horizon", "10", "--forgetting", "constant:0.98"]);
    assert_eq!(figures["forgetting"], "constant:0.98");
    assert!(number(&figures, "/adaptive/h_step/sigma") < 0.5 * number(&figures, "/classical/h_step/sigma"));
    assert!(number(&figures, "/reduction_percent/h_step") > 50.0);
}

#[test]
fn the_default_forgetting_follows_a_gain_that_changes() {
    let figures = figures(changing_plant().path(), &["--horizon", "10"]);
    assert_eq!(figures["forgetting"], "paper");
    assert!(number(&figures, "/adaptive/h_step/sigma") < 0.5 * number(&figures, "/classical/h_step/sigma"));
    assert!(number(&figures, "/reduction_percent/h_step") > 50.0);
}

#[test]
fn every_forgetting_follows_a_gain_that_changes() {
    let folder = changing_plant();
    for forgetting in ["constant:0.98", "fuzzy:0.9", "fortescue:100", "directional:0.95", "window:200", "auto"] {
        let figures = figures(folder.path(), &["--horizon", "10", "--forgetting", forgetting]);
        assert_eq!(figures["forgetting"], forgetting);
        assert_eq!(figures["error_universe"].is_null(), forgetting != "fuzzy:0.9", "{forgetting}");
        // Along nearly equal columns, as those of a position are, directional forgetting is slow.
        let least = if forgetting.starts_with("directional") { 30.0 } else { 50.0 };
        let reduction = number(&figures, "/reduction_percent/h_step");
        assert!(reduction > least, "{forgetting}: {reduction}");
    }
}

#[test]
fn a_window_with_fewer_samples_than_the_full_form_has_coefficients_is_refused() {
    let arguments = ["identify", "r.csv", "--form", "full", "--forgetting", "window:14"];
    let expected = ["--forgetting: found \"window:14\" for 15 coefficients; allowed: \"window:N\" with N from 15"];
    expect_refusal(constant_plant().path(), &arguments, &expected);
}

#[test]
fn the_full_form_follows_a_gain_that_changes() {
    let figures = figures(changing_plant().path(), &["--horizon", "10", "--form", "full"]);
    assert_eq!(figures["form"], "full");
    assert!(number(&figures, "/adaptive/h_step/sigma") < 0.5 * number(&figures, "/classical/h_step/sigma"));
}

#[test]
fn the_full_form_keeps_the_coefficients_of_a_constant_plant() {
    let figures = figures(constant_plant().path(), &["--horizon", "10", "--form", "full"]);
    expect_coefficients(&figures, "adaptive");
}

/// The record with another output: what `change` makes of it, row by row.
fn with_output(record: &[[f64; 3]], mut change: impl FnMut(f64) -> f64) -> TempDir {
    let changed: Vec<[f64; 3]> = record.iter().map(|[t, u, y]| [*t, *u, change(*y)]).collect();
    folder_with(&csv("t,u,y", &changed))
}

/// Sums the values up and adds `each` at every row.
fn summed(each: f64) -> impl FnMut(f64) -> f64 {
    let mut sum = 0.0;
    move |value| {
        sum += value + each;
        sum
    }
}

fn expect_list(figures: &Value, model: &str, name: &str, expected: &[f64]) {
    let found: Vec<f64> = serde_json::from_value(figures[model]["coefficients"][name].clone()).unwrap();
    assert_eq!(found.len(), expected.len(), "{model} {name}: {found:?}");
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() <= 1e-6, "{model} {name}: {found} for {expected}");
    }
}

/// A(z) (1 - z^-1) of the plant.
const A_INTEGRATED: [f64; 4] = [A[0] - 1.0, A[1] - A[0], A[2] - A[1], -A[2]];

#[test]
fn an_integrator_and_a_drift_are_found() {
    let folder = with_output(&simulate(600, |_| 1.0), summed(0.02));
    for form in ["linear", "full"] {
        let figures = figures(folder.path(), &["--horizon", "10", "--integrator", "--drift", "--form", form]);
        assert_eq!((&figures["structure"]["integrator"], &figures["structure"]["drift"]), (&true.into(), &true.into()));
        // The drift of the increments: what A makes of a constant 0.02.
        let drift = 0.02 * (1.0 + A.iter().sum::<f64>());
        for model in ["classical", "adaptive"] {
            expect_list(&figures, model, "a", &A_INTEGRATED);
            expect_list(&figures, model, "b", &B);
            let found = number(&figures, &format!("/{model}/coefficients/drift"));
            assert!((found - drift).abs() <= 1e-6, "{model}: {found} for {drift}");
            assert!(number(&figures, &format!("/{model}/h_step/sigma")) <= 1e-9);
        }
    }
}

#[test]
fn a_velocity_is_identified_and_a_model_of_the_output_told() {
    let mut sum = summed(0.0);
    let folder = with_output(&simulate(600, |_| 1.0), move |velocity| PERIOD * sum(velocity));
    let figures = figures(folder.path(), &["--horizon", "10", "--velocity"]);
    assert_eq!(figures["output"], "velocity");
    for model in ["classical", "adaptive"] {
        expect_list(&figures, model, "a", &A_INTEGRATED);
        expect_list(&figures, model, "b", &B.map(|b| PERIOD * b));
        assert!(number(&figures, &format!("/{model}/h_step/sigma")) <= 1e-9);
    }
}

#[test]
fn a_dead_band_and_knots_are_taken_as_they_are_typed() {
    let folder = constant_plant();
    let typed = ["--dead-band", "0.05,0.1", "--knots", "0,0.2,0.5,0.7"];
    let figures = figures(folder.path(), &typed);
    assert_eq!(figures["structure"]["dead_band"], serde_json::json!([0.05, 0.1]));
    assert_eq!(figures["structure"]["knots"], serde_json::json!([0.0, 0.2, 0.5, 0.7]));
    assert_eq!(figures["structure"]["order"], 4);
    let both = self::figures(folder.path(), &["--dead-band", "0.05", "--knots", "0.3", "--order", "1"]);
    assert_eq!(both["structure"]["dead_band"], serde_json::json!([0.05, 0.05]));
}

#[test]
fn the_table_names_the_options_that_were_chosen() {
    let folder = constant_plant();
    let plain = success(folder.path(), &["identify", "r.csv"]);
    assert!(plain.contains("nk 1, order 3; 500ms"), "{plain}");
    let options = ["--integrator", "--drift", "--dead-band", "0.05,0.1", "--knots", "0,0.25", "--velocity"];
    let text = success(folder.path(), &[&["identify", "r.csv"], &options[..]].concat());
    let expected = "nk 1, order 2, integrator, drift, dead band -0.05 to 0.1, knots 0 0.25, velocity; 500ms";
    assert!(text.contains(expected) && text.contains("   c "), "{text}");
}

#[test]
fn an_order_that_is_not_the_number_of_knots_is_refused() {
    let arguments = ["identify", "r.csv", "--knots", "0,0.2", "--order", "3"];
    let expected = ["--order: found 3 with 2 --knots; allowed: 2, the number of knots, or no --order"];
    expect_refusal(constant_plant().path(), &arguments, &expected);
}

#[test]
fn the_options_need_rows_of_their_own() {
    // 4 + 12 + 1 coefficients, one more with the drift, and a past of na + 2 outputs.
    let arguments = ["identify", "r.csv", "--train", "5", "--na", "4", "--integrator", "--drift", "--velocity"];
    let expected = ["r.csv: --train: found 5 of the 600 rows; allowed: at least 23, to determine 17 coefficients"];
    expect_refusal(constant_plant().path(), &arguments, &expected);
}

#[test]
fn json_to_a_file_has_the_same_numbers() {
    let folder = changing_plant();
    success(folder.path(), &["identify", "r.csv", "--json", "out.json"]);
    let file = fs::read_to_string(folder.path().join("out.json")).unwrap();
    assert_eq!(timeless(serde_json::from_str(&file).unwrap()), timeless(figures(folder.path(), &[])));
}

#[test]
fn json_to_a_file_leaves_the_table_on_standard_output() {
    let folder = changing_plant();
    let table = success(folder.path(), &["identify", "r.csv", "--json", "out.json"]);
    let figures = figures(folder.path(), &[]);
    for (name, kind) in [("one step", "one_step"), ("h steps", "h_step"), ("free run", "free_run")] {
        let row = table.lines().find(|line| line.trim_start().starts_with(name)).expect(name);
        let reduction = format!("{:.2} %", number(&figures, &format!("/reduction_percent/{kind}")));
        assert!(row.contains(&reduction), "{reduction} in {row}");
    }
}

#[test]
fn a_period_replaces_the_column_of_time() {
    let record: String = simulate(600, |_| 1.0).iter().map(|[_, u, y]| format!("{u},{y}\n")).collect();
    let folder = folder_with(&format!("u,y\n{record}"));
    for period in ["0.01", "10ms"] {
        let figures = figures(folder.path(), &["--period", period]);
        assert_eq!(number(&figures, "/period_s"), PERIOD, "{period}");
        expect_coefficients(&figures, "classical");
    }
}

#[test]
fn a_period_takes_the_place_of_the_times_in_the_record() {
    let figures = figures(constant_plant().path(), &["--period", "20ms", "--horizon", "0.5s"]);
    assert_eq!(number(&figures, "/period_s"), 0.02);
    assert_eq!(figures["horizon"], 25);
}

#[test]
fn columns_are_chosen_by_name() {
    let record = simulate(600, |_| 1.0);
    let named = folder_with(&csv("t,duty,position", &record));
    let chosen = figures(named.path(), &["--input", "duty", "--output", "position"]);
    assert_eq!(timeless(chosen), timeless(figures(constant_plant().path(), &[])));
}

#[test]
fn training_is_a_number_of_rows_or_the_same_part_of_all() {
    let folder = changing_plant();
    let (count, part) = (figures(folder.path(), &["--train", "500"]), figures(folder.path(), &["--train", "0.25"]));
    assert_eq!(count["train"], 500);
    assert_eq!(timeless(count), timeless(part));
}

#[test]
fn a_horizon_is_a_number_of_samples_or_the_same_time() {
    let folder = changing_plant();
    let (count, time) = (figures(folder.path(), &["--horizon", "50"]), figures(folder.path(), &["--horizon", "0.5s"]));
    assert_eq!(time["horizon"], 50);
    assert_eq!(timeless(count), timeless(time));
}

/// Rows 1 to 3 are good, row 4 on line 5 is given, and rows 5 and 6 are good again.
fn expect_row_refusal(row: &str, expected: &str) {
    let folder = folder_with(&format!("t,u,y\n0,0.1,1\n1,0.2,2\n2,0.3,3\n{row}\n4,0.5,5\n5,0.6,6\n"));
    expect_refusal(folder.path(), &["identify", "r.csv"], &[&format!("r.csv:5: row 4, column {expected}")]);
}

#[test]
fn an_empty_field_is_refused() {
    expect_row_refusal("3,,4", "\"u\": found an empty field; allowed: a finite number");
}

#[test]
fn not_a_number_is_refused() {
    expect_row_refusal("3,0.4,nan", "\"y\": found \"nan\"; allowed: a finite number");
}

#[test]
fn infinity_is_refused() {
    expect_row_refusal("3,inf,4", "\"u\": found \"inf\"; allowed: a finite number");
}

#[test]
fn minus_infinity_is_refused() {
    expect_row_refusal("3,0.4,-inf", "\"y\": found \"-inf\"; allowed: a finite number");
}

#[test]
fn text_is_refused() {
    expect_row_refusal("3,0.4,four", "\"y\": found \"four\"; allowed: a finite number");
}

#[test]
fn time_that_runs_backwards_is_refused() {
    expect_row_refusal("1.5,0.4,4", "\"t\": found 1.5 after 2; allowed: a time later than the row before");
}

#[test]
fn time_that_stands_still_is_refused() {
    expect_row_refusal("2,0.4,4", "\"t\": found 2 after 2; allowed: a time later than the row before");
}

#[test]
fn a_row_with_too_few_fields_is_refused_with_its_line() {
    let folder = folder_with("t,u,y\n0,0.1,1\n1,0.2\n2,0.3,3\n");
    expect_refusal(folder.path(), &["identify", "r.csv"], &["r.csv:3: row 2, column \"y\": found an empty field"]);
}

#[test]
fn a_bad_field_keeps_its_line_after_lines_that_end_in_carriage_returns() {
    let folder = folder_with("t,u,y\r\n0,0.1,1\r\n1,0.2,two\r\n2,0.3,3\r\n");
    expect_refusal(folder.path(), &["identify", "r.csv"], &["r.csv:3: row 2, column \"y\""]);
}

#[test]
fn a_bad_field_keeps_its_line_after_empty_lines() {
    let folder = folder_with("t,u,y\n0,0.1,1\n\n\n1,0.2,two\n2,0.3,3\n");
    expect_refusal(folder.path(), &["identify", "r.csv"], &["r.csv:5: row 2, column \"y\""]);
}

#[test]
fn a_training_part_with_fewer_rows_than_coefficients_is_refused() {
    let folder = folder_with(&csv("t,u,y", &simulate(20, |_| 1.0)));
    let expected = ["r.csv: --train: found 10 of the 20 rows; allowed: at least 18, to determine 15 coefficients"];
    expect_refusal(folder.path(), &["identify", "r.csv"], &expected);
}

#[test]
fn a_test_part_shorter_than_the_horizon_is_refused() {
    let arguments = ["identify", "r.csv", "--train", "595", "--horizon", "10"];
    let expected = ["r.csv: found 600 rows; allowed: at least 606 to test 10 samples ahead after 595 for training"];
    expect_refusal(constant_plant().path(), &arguments, &expected);
}

#[test]
fn a_missing_column_is_refused_with_those_that_are_there() {
    let folder = folder_with("t,u,z\n0,1,2\n1,3,4\n");
    let expected = ["r.csv:1: found no column \"y\"; the columns are: t, u, z", "--output"];
    expect_refusal(folder.path(), &["identify", "r.csv"], &expected);
}

#[test]
fn a_chosen_column_that_is_missing_is_refused() {
    let arguments = ["identify", "r.csv", "--input", "duty"];
    let expected = ["r.csv:1: found no column \"duty\"; the columns are: t, u, y", "--input"];
    expect_refusal(constant_plant().path(), &arguments, &expected);
}

#[test]
fn a_record_without_time_is_refused_without_a_period() {
    let folder = folder_with("u,y\n1,2\n3,4\n");
    let expected = ["r.csv:1: found no column \"t\"; the columns are: u, y", "--period"];
    expect_refusal(folder.path(), &["identify", "r.csv"], &expected);
}

#[test]
fn an_empty_file_is_refused() {
    let expected = ["r.csv: found an empty file; allowed: a CSV file with a header"];
    expect_refusal(folder_with("").path(), &["identify", "r.csv"], &expected);
}

#[test]
fn a_header_alone_is_refused() {
    let expected = ["r.csv: found 0 rows; allowed: at least 2"];
    expect_refusal(folder_with("t,u,y\n").path(), &["identify", "r.csv"], &expected);
}

#[test]
fn a_file_that_is_not_there_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    expect_refusal(folder.path(), &["identify", "r.csv"], &["r.csv: ", "No such file or directory"]);
}

#[test]
fn a_folder_in_the_place_of_a_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("r.csv")).unwrap();
    expect_refusal(folder.path(), &["identify", "r.csv"], &["r.csv: ", "Is a directory"]);
}

#[test]
fn values_that_a_flag_does_not_take_are_refused_with_what_it_takes() {
    let folder = constant_plant();
    for (flag, value, allowed) in [
        ("--train", "0", "allowed: at least 18"),
        ("--train", "1.5", "allowed: a whole number of rows, or a fraction between 0 and 1"),
        ("--train", "nan", "allowed: a whole number of rows, or a fraction between 0 and 1"),
        ("--na", "9", "allowed: a whole number from 1 to 5"),
        ("--nk", "0", "allowed: a whole number from 1 to 64"),
        ("--order", "6", "allowed: a whole number from 1 to 5"),
        (
            "--forgetting",
            "constant:2",
            "found \"constant:2\"; allowed: \"auto\", \"paper\", \"constant:L\" with L from 0.5 to 1",
        ),
        ("--forgetting", "constant:nan", "\"constant:L\" with L from 0.5 to 1"),
        ("--forgetting", "constant", "\"constant:L\" with L from 0.5 to 1"),
        ("--forgetting", "paper:1", "allowed: \"auto\", \"paper\""),
        ("--forgetting", "auto:3", "allowed: \"auto\", \"paper\""),
        ("--forgetting", "fuzzy:1", "\"fuzzy:LOW\" with LOW from 0.5 to below 1"),
        ("--forgetting", "fuzzy:0.4", "\"fuzzy:LOW\" with LOW from 0.5 to below 1"),
        ("--forgetting", "fortescue:1", "\"fortescue:N0\" with N0 of 2 samples or more"),
        ("--forgetting", "fortescue:2.5", "\"fortescue:N0\" with N0 of 2 samples or more"),
        ("--forgetting", "directional:inf", "\"directional:L\" with L from 0.5 to 1"),
        ("--forgetting", "window:100001", "\"window:N\" with N from 2 to 100000 samples"),
        ("--forgetting", "window:-5", "\"window:N\" with N from 2 to 100000 samples"),
        (
            "--forgetting",
            "window:4",
            "found \"window:4\" for 5 coefficients; allowed: \"window:N\" with N from 5, one sample for each",
        ),
        ("--train", "-3", "allowed: a whole number of rows, or a fraction between 0 and 1"),
        ("--nb", "-1", "allowed: a whole number from 0 to 4"),
        ("--horizon", "0", "allowed: at least one sample"),
        ("--horizon", "x", "allowed: a whole number of samples, or a duration with its unit"),
        ("--period", "0", "allowed: seconds from 1e-9 to 1.6e7, or a duration with its unit"),
        ("--period", "nan", "allowed: seconds from 1e-9 to 1.6e7, or a duration with its unit"),
        ("--split", "qr", "possible values: als, paper"),
        ("--dead-band", "-0.1", "allowed: one number of at least 0 for both directions, or two, LOW,HIGH"),
        ("--dead-band", "0.1,nan", "allowed: one number of at least 0 for both directions, or two, LOW,HIGH"),
        ("--dead-band", "0.1,0.2,0.3", "allowed: one number of at least 0 for both directions, or two, LOW,HIGH"),
        ("--knots", "0.2,0.1", "allowed: 1 to 5 rising numbers of at least 0, K1,K2,.."),
        ("--knots", "0,inf", "allowed: 1 to 5 rising numbers of at least 0, K1,K2,.."),
        ("--knots", "0,1,2,3,4,5", "allowed: 1 to 5 rising numbers of at least 0, K1,K2,.."),
        ("--knots", "a", "allowed: 1 to 5 rising numbers of at least 0, K1,K2,.."),
        ("--form", "half", "possible values: linear, full"),
    ] {
        expect_refusal(folder.path(), &["identify", "r.csv", flag, value], &[flag, allowed]);
    }
}

#[test]
fn more_rows_for_training_than_a_number_holds_with_the_horizon_are_refused() {
    let arguments = ["identify", "r.csv", "--train", "18446744073709551615"];
    expect_refusal(constant_plant().path(), &arguments, &["18446744073709551615"]);
}

#[test]
fn a_horizon_beyond_what_a_number_holds_with_the_training_is_refused() {
    let arguments = ["identify", "r.csv", "--horizon", "18446744073709551615"];
    expect_refusal(constant_plant().path(), &arguments, &["18446744073709551615"]);
}

#[test]
fn times_too_far_apart_for_a_period_are_refused() {
    let record: Vec<[f64; 3]> = simulate(600, |_| 1.0).iter().map(|[t, u, y]| [t * 1e300, *u, *y]).collect();
    let folder = folder_with(&csv("t,u,y", &record));
    expect_refusal(folder.path(), &["identify", "r.csv", "--horizon", "10"], &["r.csv", "\"t\""]);
}

#[test]
fn times_too_close_for_a_period_are_refused() {
    let record: Vec<[f64; 3]> = simulate(600, |_| 1.0).iter().map(|[t, u, y]| [t * 1e-12, *u, *y]).collect();
    let folder = folder_with(&csv("t,u,y", &record));
    expect_refusal(folder.path(), &["identify", "r.csv"], &["r.csv", "\"t\""]);
}

/// The folder of the public records, or nothing, said on standard error, when the record is absent.
fn public(record: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    if folder.join(record).exists() {
        return Some(folder);
    }
    eprintln!("skipped: {} is absent", folder.join(record).display());
    None
}

/// The JSON for a file in `folder`.
fn public_figures(folder: &Path, arguments: &[&str]) -> Value {
    let text = success(folder, &[&["identify", "--json", "-"], arguments].concat());
    serde_json::from_str(&text).unwrap()
}

#[test]
fn the_hydraulic_actuator_is_modelled_as_well_as_published() {
    let Some(folder) = public("hydraulic_actuator.csv") else { return };
    let arguments = ["hydraulic_actuator.csv", "--train", "512", "--period", "1", "--horizon", "10"];
    let figures = public_figures(&folder, &arguments);
    let (one_step, free_run) =
        (number(&figures, "/classical/one_step/rmse"), number(&figures, "/classical/free_run/rmse"));
    assert!(one_step <= 0.110, "one step: {one_step}");
    assert!(free_run <= 0.60, "free run: {free_run}");
}

#[test]
fn adaptation_pays_on_the_servo_that_warms_up() {
    let Some(folder) = public("servo_warmup.csv") else { return };
    let figures = public_figures(&folder, &["servo_warmup.csv", "--train", "0.4", "--horizon", "0.5s"]);
    let reduction = number(&figures, "/reduction_percent/h_step");
    assert!(reduction >= 40.11, "{reduction} %");
}

#[test]
fn every_public_record_with_time_input_and_output_is_identified() {
    let Some(folder) = public("") else { return };
    let mut identified = 0;
    for file in fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()) {
        let has_columns = || {
            let text = fs::read_to_string(folder.join(&file)).unwrap();
            let names: Vec<&str> = text.lines().next().unwrap_or("").split(',').map(str::trim).collect();
            ["t", "u", "y"].iter().all(|name| names.contains(name))
        };
        if !file.ends_with(".csv") || !has_columns() {
            continue;
        }
        let figures = public_figures(&folder, &[&file, "--train", "0.4", "--horizon", "10"]);
        for kind in ["one_step", "h_step", "free_run"] {
            for figure in ["sigma", "rmse", "max", "fit_percent"] {
                let value = number(&figures, &format!("/classical/{kind}/{figure}"));
                assert!(value.is_finite(), "{file} {kind} {figure}: {value}");
            }
        }
        identified += 1;
    }
    assert!(identified > 0, "no record with columns t, u, y in {}", folder.display());
}

#[test]
fn a_reader_that_has_gone_is_no_panic() {
    let folder = constant_plant();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_hydraxis"));
    let output = command.current_dir(folder.path()).args(["identify", "r.csv"]).stdout(writer).output().unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(!errors.contains("panicked"), "{errors}");
}

#[test]
fn json_that_cannot_be_written_is_refused_before_the_work_with_its_file() {
    let folder = constant_plant();
    let expected = ["--json: absent/out.json cannot be written"];
    expect_refusal(folder.path(), &["identify", "r.csv", "--json", "absent/out.json"], &expected);
}
