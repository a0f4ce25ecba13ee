//! `hydraxis identify --model-out` and `hydraxis predict`: a saved model on another recording, the same predictions
//! from its C header and its Python module, CSV files, and refusals.

use std::{
    fs,
    path::Path,
    process::{Command, Output},
};

use serde_json::Value;
use tempfile::TempDir;

use crate::harness::{
    cli::{expect_refusal, success},
    records::{number, simulated},
};

/// Relative difference of two predictions that count as the same.
const SAME: f64 = 1e-12;
/// The model is identified on the one, and applied to the other.
const RECORDS: [&str; 2] = ["servo_warmup.csv", "servo_payload.csv"];
/// The settings of the models that are exported.
const MODELS: [&[&str]; 4] = [
    &[],
    &["--nk", "3", "--na", "2", "--integrator", "--drift", "--dead-band", "0.02,0.03", "--knots", "0,0.1,0.3"],
    &["--velocity", "--na", "1", "--nb", "2", "--horizon", "7"],
    &["--estimator", "paper", "--order", "1"],
];

/// A folder with both records.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for record in RECORDS {
        fs::copy(simulated().join(record), folder.path().join(record)).unwrap();
    }
    folder
}

/// Identifies on the first record with these options, and saves the model in this file.
fn save(folder: &Path, file: &str, options: &[&str]) -> String {
    success(folder, &[&["identify", RECORDS[0], "--train", "0.4", "--model-out", file], options].concat())
}

/// The columns of a CSV file with these names; NaN for empty fields.
fn columns(text: &str, names: &[&str]) -> Vec<Vec<f64>> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place = |name: &&str| header.iter().position(|column| column == name).unwrap_or_else(|| panic!("no {name}"));
    let places: Vec<usize> = names.iter().map(place).collect();
    let mut columns = vec![Vec::new(); names.len()];
    for line in lines {
        let fields: Vec<&str> = line.split(',').collect();
        assert_eq!(fields.len(), header.len(), "{line}");
        for (column, place) in columns.iter_mut().zip(&places) {
            let field = fields[*place];
            column.push(if field.is_empty() { f64::NAN } else { field.parse().unwrap() });
        }
    }
    columns
}

/// Standard output of a program that has to succeed without a word on standard error.
fn run(program: &mut Command) -> String {
    let Output { status, stdout, stderr } = program.output().unwrap_or_else(|error| panic!("{program:?}: {error}"));
    let errors = String::from_utf8_lossy(&stderr);
    assert!(status.success() && errors.is_empty(), "{program:?}: {errors}");
    String::from_utf8(stdout).unwrap()
}

/// Expects the predictions of lines with one step and h steps; those of h steps belong to the row they were made at.
fn expect_same(language: &str, printed: &str, expected: &[Vec<f64>; 2], horizon: usize) {
    let rows = expected[0].len();
    assert_eq!(printed.lines().count(), rows, "{language}");
    let mut compared = 0;
    for (k, line) in printed.lines().enumerate() {
        for ((found, expected), steps) in line.split(',').zip(expected).zip([1, horizon]) {
            let found: f64 = found.parse().unwrap();
            // Only rows that the recording has.
            let expected = expected.get(k + steps).copied().unwrap_or(f64::NAN);
            if k + steps < rows {
                assert_eq!(found.is_nan(), expected.is_nan(), "{language}, row {k}, {steps} steps: {found} {expected}");
            }
            if !expected.is_nan() {
                let difference = (found - expected).abs();
                assert!(difference <= SAME * expected.abs(), "{language}, row {k}, {steps} steps: {found} {expected}");
                compared += 1;
            }
        }
    }
    assert!(compared > 11_000, "{language}: {compared}");
}

/// Reads rows `output,input`, and prints the predictions one step and `HORIZON` steps ahead of each row.
const C_PROGRAM: &str = r#"#include <stdio.h>
#include "model_1.h"

static double y[6000], u[6000 + HORIZON];

int main(void)
{
    model_1_state state;
    size_t k, rows = 0;
    while (rows < 6000 && scanf("%lf,%lf", &y[rows], &u[rows]) == 2)
        rows++;
    model_1_reset(&state);
    for (k = 0; k < rows; k++) {
        double next = model_1_step(&state, y[k], u[k]);
        printf("%.17g,%.17g\n", next, model_1_ahead(&state, u + k + 1, HORIZON));
    }
    return 0;
}
"#;

const PYTHON_PROGRAM: &str = r#"import sys
import model_1
rows = [[float(field) for field in line.split(",")] for line in open("rows.txt")]
horizon, model = int(sys.argv[1]), model_1.Model()
commands = [u for _, u in rows] + [0.0] * horizon
for k, (y, u) in enumerate(rows):
    following = model.step(y, u)
    print(f"{following!r},{model.ahead(commands[k + 1 : k + horizon])!r}")
"#;

#[test]
fn the_c_header_and_the_python_module_predict_as_hydraxis_does() {
    for options in MODELS {
        let folder = folder();
        let folder = folder.path();
        for ending in ["toml", "h", "py"] {
            save(folder, &format!("model_1.{ending}"), options);
        }
        let csv = success(folder, &["predict", "model_1.toml", RECORDS[1], "--csv", "-"]);
        let [outputs, inputs, one_step, h_steps] =
            columns(&csv, &["output", "input", "one_step", "h_steps"]).try_into().unwrap();
        let expected = [one_step, h_steps];
        let figures = success(folder, &["predict", "model_1.toml", RECORDS[1], "--json", "-"]);
        let figures: Value = serde_json::from_str(&figures).unwrap();
        let horizon = figures["horizon"].as_u64().unwrap();
        let rows: String = outputs.iter().zip(&inputs).map(|(y, u)| format!("{y},{u}\n")).collect();
        fs::write(folder.join("rows.txt"), rows).unwrap();

        fs::write(folder.join("main.c"), C_PROGRAM).unwrap();
        let strict = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O2"];
        let define = format!("-DHORIZON={horizon}");
        run(Command::new("cc").current_dir(folder).args(strict).args([&define, "main.c", "-o", "main"]));
        let rows = fs::File::open(folder.join("rows.txt")).unwrap();
        let printed = run(Command::new(folder.join("main")).stdin(rows));
        expect_same("C", &printed, &expected, horizon as usize);

        fs::write(folder.join("main.py"), PYTHON_PROGRAM).unwrap();
        let printed = run(Command::new("python3").current_dir(folder).args(["main.py", &horizon.to_string()]));
        expect_same("Python", &printed, &expected, horizon as usize);
    }
}

#[test]
fn the_matlab_function_has_the_numbers_of_the_model_file() {
    let folder = folder();
    save(folder.path(), "m.toml", MODELS[1]);
    save(folder.path(), "m.m", MODELS[1]);
    let read = |file| fs::read_to_string(folder.path().join(file)).unwrap();
    let (model, code) = (read("m.toml"), read("m.m"));
    assert!(code.starts_with("function model = m()\n") && !code.contains('@'.to_string().repeat(2).as_str()), "{code}");
    for key in ["a", "b", "f", "g", "knots"] {
        let line = model.lines().find(|line| line.starts_with(&format!("{key} = "))).unwrap();
        let list = line.split('#').next().unwrap().trim();
        assert!(code.contains(&format!("\n{list};\n")), "{list}\n{code}");
    }
    assert!(code.contains("\ndelay = 3;\n") && code.contains("v(u > 0.03) = u(u > 0.03) - 0.03;"), "{code}");
}

#[test]
fn a_saved_model_has_the_errors_of_its_predictions() {
    let folder = folder();
    save(folder.path(), "m.toml", &[]);
    let typed = ["predict", "m.toml", RECORDS[1], "--csv", "p.csv"];
    let text = success(folder.path(), &typed);
    let json = success(folder.path(), &[&typed[..], &["--json", "-"]].concat());
    let figures: Value = serde_json::from_str(&json).unwrap();
    let csv = fs::read_to_string(folder.path().join("p.csv")).unwrap();
    let [y, one_step, h_steps, free_run, residual] =
        columns(&csv, &["output", "one_step", "h_steps", "free_run", "residual"]).try_into().unwrap();
    let rmse = |predicted: &[f64]| {
        let squares: Vec<f64> =
            y.iter().zip(predicted).map(|(y, p)| (y - p).powi(2)).filter(|square| !square.is_nan()).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    for (place, predicted) in
        [("/prediction/one_step/rmse", &one_step), ("/prediction/h_step/rmse", &h_steps), ("/free_run/rmse", &free_run)]
    {
        assert!((number(&figures, place) / rmse(predicted) - 1.0).abs() < 1e-9, "{place}");
    }
    assert!(y.iter().zip(&one_step).zip(&residual).all(|((y, p), r)| r.is_nan() || *r == y - p));
    let ratio = number(&figures, "/prediction/h_step/rmse") / number(&figures, "/persistence/h_step/rmse");
    assert_eq!(number(&figures, "/verdict/to_holding_still"), ratio);
    assert!(text.starts_with("usable: 500ms ahead the error is "), "{text}");
    assert!(text.contains("m.toml: na 3, nb 2, nk 1, order 3; by auto on servo_warmup.csv\n"), "{text}");
    assert!(text.contains("of the commands are outside of -0.54619 to 0.51410"), "{text}");
}

#[test]
fn rows_over_a_gap_have_no_prediction() {
    let folder = folder();
    save(folder.path(), "m.toml", &[]);
    let rows = fs::read_to_string(folder.path().join(RECORDS[1])).unwrap();
    let kept: Vec<&str> =
        rows.lines().enumerate().filter(|(k, _)| !(200..300).contains(k)).map(|(_, row)| row).collect();
    fs::write(folder.path().join("gap.csv"), kept.join("\n")).unwrap();
    let csv = success(folder.path(), &["predict", "m.toml", "gap.csv", "servo_payload.csv", "--csv", "-"]);
    let [recording, one_step, h_steps] = columns(&csv, &["recording", "one_step", "h_steps"]).try_into().unwrap();
    let unknown = |values: &[f64]| values.iter().take(5950).filter(|value| value.is_nan()).count();
    // Three rows of past at the begin and after the gap, and 24 rows more of horizon; of the second recording too.
    assert_eq!((unknown(&one_step), unknown(&h_steps)), (9, 9 + 3 * 24));
    assert_eq!((recording[0], recording[5899], recording[5900]), (1.0, 1.0, 2.0));
}

#[test]
fn a_model_that_does_not_fit_is_refused() {
    let folder = folder();
    let folder = folder.path();
    save(folder, "m.toml", &["--unit", "y=m"]);
    let slow: String = fs::read_to_string(folder.join(RECORDS[1])).unwrap().replace("t,", "clock,");
    fs::write(folder.join("slow.csv"), slow).unwrap();
    let text = fs::read_to_string(folder.join("m.toml")).unwrap();
    fs::write(folder.join("nan.toml"), text.replace("b = [", "b = [nan, ")).unwrap();
    fs::write(folder.join("old.toml"), text.replace("version = 1", "version = 0")).unwrap();
    fs::write(folder.join("empty.toml"), "").unwrap();
    fs::write(folder.join("latin.toml"), [0xff, 0xfe, 0x00]).unwrap();
    let record = RECORDS[1];
    for (typed, expected) in [
        (
            &["m.toml", record, "--unit", "y=deg"][..],
            "found the unit deg for the output; allowed: m, that of the model m.toml",
        ),
        (
            &["m.toml", "slow.csv", "--period", "50ms"],
            "found a period of 0.050000 s; allowed: 0.020000 s, that of the model",
        ),
        (&["m.toml", record, "--horizon", "0"], "--horizon: found 0 samples; allowed: at least one sample"),
        (&["m.toml", record, "--horizon", "7000"], "found at most 6000 rows without a gap; allowed: at least 7003"),
        (&["nan.toml", record], "nan.toml:14: found b with NaN; allowed: finite numbers"),
        (&["old.toml", record], "old.toml:5: found version = 0; allowed: version = 1"),
        (&["empty.toml", record], "empty.toml: found a file without kind = \"identified\"; allowed: a model that"),
        (&["latin.toml", record], "latin.toml: found a file that cannot be read"),
        (&["mm.toml", record], "mm.toml: found a file that cannot be read"),
        (&[record, record], "servo_payload.csv:1: found "),
    ] {
        expect_refusal(folder, &[&["predict"], typed].concat(), &[expected]);
    }
}

#[test]
fn standard_output_has_one_of_csv_json_and_report() {
    let folder = folder();
    let folder = folder.path();
    save(folder, "m.toml", &[]);
    let identify = |typed: &[&'static str]| [&["identify", RECORDS[0], "--train", "0.4"], typed].concat();
    let predict = |typed: &[&'static str]| [&["predict", "m.toml", RECORDS[1]], typed].concat();
    for typed in [
        identify(&["--json", "-", "--csv", "-"]),
        identify(&["--report", "-", "--csv", "-"]),
        predict(&["--json", "-", "--csv", "-"]),
    ] {
        expect_refusal(folder, &typed, &["found -, as for --", "allowed: one of them on standard output"]);
    }
    assert!(success(folder, &identify(&["--csv", "-"])).starts_with("recording,t,input,output,one_step,"));
    assert!(success(folder, &identify(&["--report", "-"])).starts_with("<!DOCTYPE html>"));
    // `head` closes its end of the pipe early.
    let program = env!("CARGO_BIN_EXE_hydraxis");
    for typed in [identify(&["--csv", "-"]), predict(&["--csv", "-"])] {
        let script = format!("{{ {program} {}; echo $? >&2; }} | head -1 > first.txt", typed.join(" "));
        let output = Command::new("sh").current_dir(folder).args(["-c", &script]).output().unwrap();
        assert_eq!(String::from_utf8_lossy(&output.stderr), "0\n", "{typed:?}");
    }
}

#[test]
fn an_identified_model_is_no_model_to_control_with() {
    let folder = folder();
    save(folder.path(), "m.toml", &[]);
    let expected = ["m.toml: found a model of `hydraxis identify`, which `hydraxis predict` applies; allowed: a model"];
    for command in ["check", "run", "simulate"] {
        expect_refusal(folder.path(), &[command, "--model", "m.toml"], &expected);
    }
    let commissioned = "[axis.boom.commissioned]\ndead_time = 0.1\n";
    fs::write(folder.path().join("c.toml"), commissioned).unwrap();
    let expected = ["c.toml: found a file without kind = \"identified\"", "`hydraxis commission` writes others"];
    expect_refusal(folder.path(), &["predict", "c.toml", RECORDS[1]], &expected);
}

#[test]
fn a_file_for_a_model_needs_a_known_ending_and_a_name_for_functions() {
    let folder = folder();
    let identify = |file| ["identify", RECORDS[0], "--model-out", file];
    expect_refusal(folder.path(), &identify("model.c"), &["a file that ends with .toml, .h, .py or .m"]);
    expect_refusal(folder.path(), &identify("-"), &["a file that ends with .toml, .h, .py or .m"]);
    for file in ["boom-1.h", "1.py", ".h", "b oom.m"] {
        expect_refusal(folder.path(), &identify(file), &["--model-out", "allowed: "]);
    }
    expect_refusal(folder.path(), &identify("none/m.toml"), &["--model-out: none/m.toml cannot be written"]);
}

#[test]
fn the_rows_of_identify_have_the_errors_of_its_report() {
    let folder = folder();
    let typed = ["identify", RECORDS[0], "--train", "0.4", "--csv", "rows.csv", "--json", "-"];
    let figures: Value = serde_json::from_str(&success(folder.path(), &typed)).unwrap();
    let csv = fs::read_to_string(folder.path().join("rows.csv")).unwrap();
    let names = ["output", "h_steps", "held_one_step", "held_h_steps", "residual", "a_1", "forgetting_factor"];
    let [y, h_steps, held_one_step, held_h_steps, residual, a, factor] = columns(&csv, &names).try_into().unwrap();
    let expect = |place: &str, predicted: &[f64], count: usize| {
        let squares: Vec<f64> =
            y.iter().zip(predicted).map(|(y, p)| (y - p).powi(2)).filter(|square| !square.is_nan()).collect();
        assert_eq!(squares.len(), count, "{place}");
        let rmse = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
        assert!((number(&figures, place) / rmse - 1.0).abs() < 1e-6, "{place}: {rmse}");
    };
    expect("/adaptive/h_step/rmse", &h_steps, 3600 - 24);
    expect("/classical/one_step/rmse", &held_one_step, 3600);
    expect("/classical/h_step/rmse", &held_h_steps, 3600 - 24);
    assert!(residual[..2400].iter().all(|r| r.is_nan()) && residual[2400..].iter().all(|r| r.is_finite()));
    assert_eq!(a[5999], number(&figures, "/adaptive/coefficients/a/0"));
    let least = factor.iter().copied().fold(1.0, f64::min);
    assert!((least - number(&figures, "/adaptive/forgetting_factor/min")).abs() < 1e-12, "{least}");
}
