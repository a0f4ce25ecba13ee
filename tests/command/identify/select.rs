//! `--select`: the search for a structure on the training part.

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::{
    harness::cli::{expect_refusal, success},
    identify::plant::{PERIOD, constant_plant, csv, figures, folder_with, number, simulate, summed, timeless},
};

/// Samples by which the output of [`delayed_integrator`] is late. The plant itself has a delay of 1.
const LATE: usize = 5;

/// A folder with `r.csv`: 600 rows of the sum of the plant's output, which comes [`LATE`] samples late.
fn delayed_integrator() -> TempDir {
    let record = simulate(600 + LATE, |_| 1.0);
    let mut sum = summed(0.0);
    let outputs = record.iter().map(|[_, _, y]| sum(*y));
    let rows = record[LATE..].iter().zip(outputs).enumerate();
    let late: Vec<[f64; 3]> = rows.map(|(k, ([_, u, _], y))| [k as f64 * PERIOD, *u, y]).collect();
    folder_with(&csv("t,u,y", &late))
}

const ARGUMENTS: [&str; 3] = ["--select", "--horizon", "10"];

fn candidates(figures: &Value) -> &Vec<Value> {
    figures["selection"]["candidates"].as_array().unwrap()
}

#[test]
fn the_delay_the_integrator_and_the_orders_of_a_known_plant_are_found() {
    let folder = delayed_integrator();
    let found = figures(folder.path(), &ARGUMENTS);
    let structure = json!({
        "na": 3, "nb": 1, "nk": 1 + LATE, "order": 3,
        "integrator": true, "drift": false, "dead_band": [0.0, 0.0], "knots": null
    });
    assert_eq!(found["selection"]["chosen"]["structure"], structure);
    assert_eq!(found["structure"], structure);
    assert!(number(&found, "/classical/h_step/sigma") < 1e-6);
    assert!(number(&found, "/selection/chosen/score") < 1e-3);
}

#[test]
fn the_flags_that_are_shown_choose_what_was_chosen() {
    let folder = constant_plant();
    let arguments = ["--select", "--horizon", "10", "--na", "2", "--dead-band", "0.05,0.025"];
    let mut selected = figures(folder.path(), &arguments);
    let flags = selected["selection"]["chosen"]["flags"].as_str().unwrap().to_owned();
    assert!(flags.contains("--dead-band 0.05,0.025"), "{flags}");
    let typed: Vec<&str> = flags.split(' ').chain(["--horizon", "10"]).collect();
    let typed = timeless(figures(folder.path(), &typed));
    selected.as_object_mut().unwrap().remove("selection");
    assert_eq!(timeless(selected), typed);
}

#[test]
fn options_that_are_given_are_not_searched() {
    let folder = delayed_integrator();
    for (typed, pointer, expected) in [
        (&["--na", "2", "--drift"][..], "/structure/na", json!(2)),
        (&["--nb", "0", "--na", "2", "--order", "2"], "/structure/nb", json!(0)),
        (&["--nk", "50", "--na", "1", "--order", "1"], "/structure/nk", json!(50)),
        (&["--integrator=false", "--na", "2", "--nk", "6"], "/structure/integrator", json!(false)),
        (&["--drift", "--na", "2", "--nk", "6"], "/structure/drift", json!(true)),
        (&["--order", "2", "--nk", "6"], "/structure/knots", json!(null)),
        (&["--knots", "0,0.3", "--nk", "6"], "/structure/knots", json!([0.0, 0.3])),
        (&["--dead-band", "0", "--nk", "6"], "/structure/dead_band", json!([0.0, 0.0])),
    ] {
        let figures = figures(folder.path(), &[&ARGUMENTS[..], typed].concat());
        assert!(candidates(&figures).len() > 1, "{typed:?}");
        for candidate in candidates(&figures) {
            assert_eq!(candidate.pointer(pointer), Some(&expected), "{typed:?}");
        }
    }
}

#[test]
fn candidates_come_best_first_and_the_chosen_one_is_among_them() {
    let figures = figures(delayed_integrator().path(), &[&ARGUMENTS[..], &["--nk", "3"]].concat());
    let scores: Vec<f64> =
        candidates(&figures).iter().filter(|c| c["unstable"] == false).map(|c| number(c, "/score")).collect();
    assert!(scores.len() > 1 && scores.is_sorted(), "{scores:?}");
    let chosen = &figures["selection"]["chosen"];
    assert!(number(chosen, "/score") <= 1.02 * scores[0]);
    assert!(candidates(&figures).iter().any(|candidate| candidate["structure"] == chosen["structure"]));
    assert!(candidates(&figures).iter().any(|candidate| number(candidate, "/score") == 1.0));
}

#[test]
fn the_test_part_has_no_say_in_the_choice() {
    let arguments = [&ARGUMENTS[..], &["--train", "300", "--nk", "1", "--order", "3"]].concat();
    let record = simulate(600, |_| 1.0);
    let other: Vec<[f64; 3]> =
        record.iter().enumerate().map(|(k, row)| if k < 300 { *row } else { [row[0], row[1], -row[2]] }).collect();
    let selection =
        |record: &[[f64; 3]]| figures(folder_with(&csv("t,u,y", record)).path(), &arguments)["selection"].clone();
    assert_eq!(selection(&record), selection(&other));
}

#[test]
fn the_table_marks_the_chosen_one_and_shows_its_flags() {
    let folder = delayed_integrator();
    let arguments = ["--nb", "1", "--order", "3", "--dead-band", "0"];
    let text = success(folder.path(), &[&["identify", "r.csv"], &ARGUMENTS[..], &arguments].concat());
    assert_eq!(
        text.lines().filter(|line| line.starts_with(" * na 3, nb 1, nk 6, order 3, integrator ")).count(),
        1,
        "{text}"
    );
    assert!(text.contains("\n* chosen: --na 3 --nb 1 --nk 6 --order 3 --integrator\n"), "{text}");
    assert!(text.contains("r.csv: 600 rows of 0.010000 s, 300 for training, 0 outliers; na 3, nb 1, nk 6,"), "{text}");
}

#[test]
fn a_training_part_too_short_to_be_divided_is_refused() {
    let arguments = ["identify", "r.csv", "--select", "--horizon", "10", "--train", "40"];
    let expected =
        ["r.csv: --select: found 40 rows for training; allowed: at least 64, to fit 15 coefficients on the first 70 %"];
    expect_refusal(constant_plant().path(), &arguments, &expected);
    success(constant_plant().path(), &["identify", "r.csv", "--select", "--horizon", "10", "--train", "64"]);
}
