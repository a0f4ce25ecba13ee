//! Options for columns, period, training and horizon, and the two outputs.

use std::fs;

use crate::{
    harness::cli::{expect_refusal, success},
    identify::plant::{
        PERIOD, changing_plant, constant_plant, csv, expect_coefficients, figures, folder_with, number, simulate,
        timeless,
    },
};

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
    let usual = figures(constant_plant().path(), &[]);
    let [chosen, usual] = [chosen, usual].map(|mut figures| {
        // The names of the columns.
        figures.as_object_mut().unwrap().remove("recordings").unwrap();
        timeless(figures)
    });
    assert_eq!(chosen, usual);
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

#[test]
fn a_closed_standard_output_is_no_panic() {
    let folder = constant_plant();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_hydraxis"));
    let output = command.current_dir(folder.path()).args(["identify", "r.csv"]).stdout(writer).output().unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert!(!errors.contains("panicked"), "{errors}");
}

#[test]
fn the_horizon_is_half_a_second_and_at_least_one_sample_unless_it_is_typed() {
    let folder = constant_plant();
    for (period, horizon) in [("10ms", 50), ("0.4s", 1), ("1", 1), ("60", 1)] {
        assert_eq!(figures(folder.path(), &["--period", period])["horizon"], horizon, "{period}");
    }
    let typed = ["identify", "r.csv", "--period", "2s", "--horizon", "0.5s"];
    expect_refusal(folder.path(), &typed, &["--horizon: found 0 samples; allowed: at least one sample"]);
}
