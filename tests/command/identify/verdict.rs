//! The verdict before the figures: whether the model is usable, and why not.

use std::path::Path;

use serde_json::Value;

use super::plant::{PERIOD, changing_plant, csv, figures, folder_with, number, simulate};
use crate::harness::{cli::success, hydraxis};

const OPTIONS: [&str; 4] = ["--horizon", "10", "--train", "0.5"];

/// Expects these reasons, in the JSON and on the first line of the text, and returns the report.
fn expect_reasons(folder: &Path, typed: &[&str], reasons: &[(&str, &str)]) -> Value {
    let options = [&OPTIONS[..], typed].concat();
    let figures = figures(folder, &options);
    let text = success(folder, &[&["identify", "r.csv"], &options[..]].concat());
    let names: Vec<&str> = reasons.iter().map(|(name, _)| *name).collect();
    assert_eq!(figures["verdict"]["reasons"], serde_json::json!(names), "{text}");
    assert_eq!(figures["verdict"]["usable"], reasons.is_empty());
    let line = text.lines().next().unwrap();
    assert!(line.starts_with(if reasons.is_empty() { "usable: " } else { "not usable: " }), "{line}");
    assert!(reasons.iter().all(|(_, words)| line.contains(words)), "{line}");
    figures
}

/// Rows (t, u, y) of y(k) = pole y(k-1) + gain(k) u(k-1) + e(k) with small e, for these commands.
fn first_order(pole: f64, rows: usize, command: impl Fn(usize) -> f64, gain: impl Fn(usize) -> f64) -> Vec<[f64; 3]> {
    let (mut y, mut record) = (0.0, Vec::new());
    for k in 0..rows {
        record.push([k as f64 * PERIOD, command(k), y]);
        y = pole * y + gain(k) * command(k) + 1e-4 * (91.7 * k as f64).sin();
    }
    record
}

fn sines(k: usize) -> f64 {
    0.6 * (0.31 * k as f64).sin() + 0.3 * (1.1 * k as f64).cos()
}

#[test]
fn a_model_that_predicts_better_than_holding_still_is_usable() {
    let figures = expect_reasons(changing_plant().path(), &[], &[]);
    let [model, still] = ["/adaptive/h_step/rmse", "/persistence/h_step/rmse"].map(|place| number(&figures, place));
    assert_eq!(number(&figures, "/verdict/to_holding_still"), model / still);
    assert!(number(&figures, "/persistence/one_step/rmse") < still);
}

#[test]
fn a_model_whose_predictions_grow_is_unstable() {
    let record = first_order(1.15, 200, sines, |_| 1.0);
    expect_reasons(
        folder_with(&csv("t,u,y", &record)).path(),
        &["--na", "1", "--nb", "0", "--order", "1", "--estimator", "constant:1"],
        &[("unstable", "unstable")],
    );
}

#[test]
fn a_model_that_has_lost_the_axis_is_worse_than_holding_still_and_reduces_nothing() {
    // After the training the valve moves the other way: the held model runs away from an axis that nearly rests.
    let record = first_order(0.99, 2000, sines, |k| if k < 1000 { 1.0 } else { -0.2 });
    let folder = folder_with(&csv("t,u,y", &record));
    let options = ["--na", "1", "--nb", "0", "--order", "1", "--estimator", "constant:1"];
    let figures = expect_reasons(folder.path(), &options, &[("worse-than-holding-still", "worse than holding still")]);
    assert!(number(&figures, "/classical/h_step/rmse") > number(&figures, "/persistence/h_step/rmse"));
    assert!(figures["reduction_percent"]["h_step"].is_null(), "{}", figures["reduction_percent"]);
    let text = success(folder.path(), &[&["identify", "r.csv"], &OPTIONS[..], &options].concat());
    let row = text.lines().find(|line| line.trim_start().starts_with("h steps")).unwrap();
    assert!(!row.split_whitespace().take(6).any(|word| word == "%") && row.contains(" - "), "{row}");
}

#[test]
fn a_period_that_changes_is_told_with_its_place() {
    let mut record = simulate(2000, |_| 1.0);
    let time = |k: usize| 0.014 * k.min(1200) as f64 + 0.020 * k.saturating_sub(1200) as f64;
    record.iter_mut().enumerate().for_each(|(k, row)| row[0] = time(k));
    let folder = folder_with(&csv("t,u,y", &record));
    let figures = expect_reasons(folder.path(), &[], &[("irregular-time", "irregular time")]);
    let change = &figures["recordings"][0]["gaps"]["period_change"];
    assert_eq!(change["line"], 1203, "{change}");
    assert!((number(change, "/before_s") - 0.014).abs() < 1e-9 && (number(change, "/after_s") - 0.020).abs() < 1e-9);
    let text = success(folder.path(), &[&["identify", "r.csv"], &OPTIONS[..]].concat());
    assert!(text.contains("warning: r.csv: the period changes from 0.014000 s to 0.020000 s at line 1203, "), "{text}");
}

#[test]
fn a_verdict_does_not_rest_on_what_gaps_have_left() {
    // After the training every fifth row is missing, and predictions over 10 rows cross a gap, but for 30 rows.
    let is_kept = |k: usize| k < 880 || !k.is_multiple_of(5) || (1500..1530).contains(&k);
    let all = simulate(2000, |_| 1.0);
    let record: Vec<_> = all.into_iter().enumerate().filter(|(k, _)| is_kept(*k)).map(|(_, row)| row).collect();
    let folder = folder_with(&csv("t,u,y", &record));
    expect_reasons(folder.path(), &[], &[("few-predictions", "fewer than 30 predictions 10")]);
}

#[test]
fn a_position_that_is_frozen_makes_no_model_usable() {
    let mut record = simulate(3000, |_| 1.0);
    let frozen = record[2000][2];
    record.iter_mut().skip(2000).for_each(|row| row[2] = frozen);
    let folder = folder_with(&csv("t,u,y", &record));
    expect_reasons(folder.path(), &[], &[("standing-output", "the output stands while it is driven")]);
    // Nor does it in the record that a model is applied to.
    let sound = folder_with(&csv("t,u,y", &simulate(3000, |_| 1.0)));
    let model = sound.path().join("m.toml");
    let out = ["--model-out", model.to_str().unwrap()];
    success(sound.path(), &[&["identify", "r.csv"], &OPTIONS[..], &out].concat());
    let text = success(folder.path(), &["predict", model.to_str().unwrap(), "r.csv"]);
    assert!(text.contains("not usable: ") && text.contains("the output stands"), "{text}");
}

#[test]
fn the_command_of_another_axis_has_no_effect() {
    let other = |k: usize| 0.5 * (0.17 * k as f64 + 1.0).sin() + 0.4 * (0.71 * k as f64).cos();
    let mut record = simulate(2000, |_| 1.0);
    record.iter_mut().enumerate().for_each(|(k, row)| row[1] = other(k));
    let expected = [("no-effect", "is it the command of this axis?")];
    let figures = expect_reasons(folder_with(&csv("t,u,y", &record)).path(), &[], &expected);
    assert!(number(&figures, "/verdict/to_past_outputs") > 0.95);
    assert!(number(&figures, "/verdict/to_holding_still") < 1.0, "holding still does not tell");
}

#[test]
fn a_record_without_motion_is_not_excited() {
    let record = first_order(0.9, 600, |_| 0.0, |_| 1.0).into_iter().map(|[t, u, _]| [t, u, 0.3]).collect::<Vec<_>>();
    let folder = folder_with(&csv("t,u,y", &record));
    expect_reasons(folder.path(), &[], &[("not-excited", "not excited"), ("rank-deficient", "rank-deficient")]);
}

#[test]
fn commands_of_two_levels_leave_the_model_rank_deficient() {
    let levels = |k: usize| if (1.7 * k as f64).sin() + (0.23 * k as f64).sin() > 0.0 { 0.5 } else { -0.5 };
    let folder = folder_with(&csv("t,u,y", &first_order(0.9, 1000, levels, |_| 1.0)));
    expect_reasons(folder.path(), &[], &[("rank-deficient", "rank-deficient")]);
}

#[test]
fn a_record_with_many_outliers_is_not_usable() {
    let mut record = simulate(2000, |_| 1.0);
    record.iter_mut().skip(1010).step_by(40).for_each(|row| row[2] += 1000.0);
    expect_reasons(folder_with(&csv("t,u,y", &record)).path(), &[], &[("outliers", "outliers")]);
}

#[test]
fn a_wild_command_is_named_by_its_row() {
    let mut record = simulate(2000, |_| 1.0);
    record[1998][1] = -70.0;
    let words = "a wild command (-70.000 in row 1999, nearly all others within ";
    let figures = expect_reasons(
        folder_with(&csv("t,u,y", &record)).path(),
        &[],
        &[("wild-command", words), ("worse-than-holding-still", "worse than")],
    );
    assert_eq!(figures["verdict"]["wild_command"]["row"], 1999);
}

#[test]
fn a_record_with_an_irregular_time_is_not_usable() {
    let mut record = simulate(2000, |_| 1.0);
    record.iter_mut().skip(49).step_by(50).for_each(|row| row[0] -= 0.7 * PERIOD);
    expect_reasons(folder_with(&csv("t,u,y", &record)).path(), &[], &[("irregular-time", "irregular time")]);
}

#[test]
fn missing_rows_are_gaps_and_no_irregular_time() {
    let mut record = simulate(2000, |_| 1.0);
    let mut k = 0;
    record.retain(|_| {
        k += 1;
        k % 50 != 0
    });
    expect_reasons(folder_with(&csv("t,u,y", &record)).path(), &[], &[]);
}

#[test]
fn the_verdict_has_a_colour_on_a_terminal_only() {
    let folder = changing_plant();
    let first_line = |variable: &str| {
        let mut command = hydraxis();
        command.current_dir(folder.path()).env(variable, "1").args(["identify", "r.csv"]).args(OPTIONS);
        String::from_utf8(command.output().unwrap().stdout).unwrap().lines().next().unwrap().to_owned()
    };
    assert!(first_line("NO_COLOR").starts_with("usable: "));
    // This variable asks for colours in a pipe as well.
    let coloured = first_line("CLICOLOR_FORCE");
    assert!(coloured.starts_with("\x1b[32m") && coloured.contains("usable"), "{coloured:?}");
}
