//! Records and options that are refused, and the messages.

use std::fs;

use crate::{
    harness::cli::expect_refusal,
    identify::plant::{constant_plant, csv, folder_with, simulate},
};

/// Expects a refusal of a record whose row 4, on line 5, is `row`. All other rows are good.
fn expect_row_refusal(row: &str, expected: &str) {
    let folder = folder_with(&format!("t,u,y\n0,0.1,1\n1,0.2,2\n2,0.3,3\n{row}\n4,0.5,5\n5,0.6,6\n"));
    expect_refusal(folder.path(), &["identify", "r.csv"], &[&format!("r.csv:5: row 4, column {expected}")]);
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
    let expected = ["r.csv:1: found no column with the time; the columns are: u, y", "--period"];
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
    expect_refusal(
        folder.path(),
        &["identify", "r.csv"],
        &["r.csv: found a folder; allowed: files, or a folder with --jsonl OUT"],
    );
}

#[test]
fn the_paper_is_not_changed_by_options() {
    let folder = constant_plant();
    let cases: [(&[&str], &str); 6] = [
        (&["--split", "als"], "--estimator: found \"paper\" with form \"linear\", split \"als\", output \"position\""),
        (&["--form", "full"], "--estimator: found \"paper\" with form \"full\", split \"paper\", output \"position\""),
        (&["--velocity"], "--estimator: found \"paper\" with form \"linear\", split \"paper\", output \"velocity\""),
        (&["--error-universe", "1"], "--error-universe: found with `--estimator paper`"),
        (&["--variation-universe", "1"], "--variation-universe: found with `--estimator paper`"),
        (&["--fuzzy", "f.toml"], "--fuzzy: found with `--estimator paper`"),
    ];
    for (typed, expected) in cases {
        let arguments = [&["identify", "r.csv", "--horizon", "10", "--estimator", "paper"], typed].concat();
        expect_refusal(folder.path(), &arguments, &[expected, "allowed: ", "rules"]);
    }
}

#[test]
fn values_that_a_flag_does_not_take_are_refused_with_what_it_takes() {
    let folder = constant_plant();
    for (flag, value, allowed) in [
        ("--train", "0", "allowed: at least 18"),
        ("--train", "1.5", "allowed: a whole number of rows, or a fraction between 0 and 1"),
        ("--train", "nan", "allowed: a whole number of rows, or a fraction between 0 and 1"),
        ("--na", "9", "allowed: a whole number from 1 to 5"),
        ("--nk", "0", "allowed: a whole number from 1 to 1024"),
        ("--order", "6", "allowed: a whole number from 1 to 5"),
        (
            "--estimator",
            "constant:2",
            "found \"constant:2\"; allowed: \"auto\", \"paper\", \"rules\", \"constant:L\" with L from 0.5 to 1",
        ),
        ("--forgetting", "paper", "allowed: `--estimator`, its new name"),
        ("--estimator", "constant:nan", "\"constant:L\" with L from 0.5 to 1"),
        ("--estimator", "constant", "\"constant:L\" with L from 0.5 to 1"),
        ("--estimator", "paper:1", "allowed: \"auto\", \"paper\""),
        ("--estimator", "auto:3", "allowed: \"auto\", \"paper\""),
        ("--estimator", "fuzzy:1", "\"fuzzy:LOW\" with LOW from 0.5 to below 1"),
        ("--estimator", "fuzzy:0.4", "\"fuzzy:LOW\" with LOW from 0.5 to below 1"),
        ("--estimator", "fortescue:1", "\"fortescue:N0\" with N0 of 2 samples or more"),
        ("--estimator", "fortescue:2.5", "\"fortescue:N0\" with N0 of 2 samples or more"),
        ("--estimator", "directional:inf", "\"directional:L\" with L from 0.5 to 1"),
        ("--estimator", "window:100001", "\"window:N\" with N from 2 to 100000 samples"),
        ("--estimator", "window:-5", "\"window:N\" with N from 2 to 100000 samples"),
        (
            "--estimator",
            "window:4",
            "found \"window:4\" for 5 coefficients; allowed: \"window:N\" with N from 5, one sample for each",
        ),
        ("--train", "-3", "allowed: a whole number of rows, or a fraction between 0 and 1"),
        ("--nb", "-1", "allowed: a whole number from 0 to 4"),
        ("--horizon", "0", "allowed: at least one sample"),
        ("--horizon", "x", "allowed: a whole number of samples, or a duration with its unit"),
        ("--period", "0", "allowed: seconds from 1e-9 to 1.6e7, or a duration with its unit"),
        ("--period", "nan", "allowed: seconds from 1e-9 to 1.6e7, or a duration with its unit"),
        ("--split", "qr", "allowed: one of als, paper"),
        ("--dead-band", "-0.1", "allowed: one number of at least 0 for both directions, or two, LOW,HIGH"),
        ("--dead-band", "0.1,nan", "allowed: one number of at least 0 for both directions, or two, LOW,HIGH"),
        ("--dead-band", "0.1,0.2,0.3", "allowed: one number of at least 0 for both directions, or two, LOW,HIGH"),
        ("--knots", "0.2,0.1", "allowed: 1 to 5 rising numbers of at least 0, K1,K2,.."),
        ("--knots", "0,inf", "allowed: 1 to 5 rising numbers of at least 0, K1,K2,.."),
        ("--knots", "0,1,2,3,4,5", "allowed: 1 to 5 rising numbers of at least 0, K1,K2,.."),
        ("--knots", "a", "allowed: 1 to 5 rising numbers of at least 0, K1,K2,.."),
        ("--form", "half", "allowed: one of linear, full"),
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

#[test]
fn json_that_cannot_be_written_is_refused_before_the_work_with_its_file() {
    let folder = constant_plant();
    let expected = ["--json: absent/out.json cannot be written"];
    expect_refusal(folder.path(), &["identify", "r.csv", "--json", "absent/out.json"], &expected);
}

#[test]
fn a_window_with_fewer_samples_than_the_full_form_has_coefficients_is_refused() {
    let arguments = ["identify", "r.csv", "--form", "full", "--estimator", "window:14"];
    let expected = ["--estimator: found \"window:14\" for 15 coefficients; allowed: \"window:N\" with N from 15"];
    expect_refusal(constant_plant().path(), &arguments, &expected);
}
