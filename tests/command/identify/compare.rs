//! The estimators side by side.

use serde_json::Value;

use crate::{
    harness::cli::success,
    identify::plant::{changing_plant, constant_plant, figures, number},
};

const ARGUMENTS: [&str; 3] = ["--horizon", "10", "--compare"];

fn rows(figures: &Value) -> &Vec<Value> {
    figures["comparison"].as_array().unwrap()
}

fn row<'a>(figures: &'a Value, estimator: &str, form: &str) -> &'a Value {
    let found = rows(figures).iter().find(|row| row["estimator"] == estimator && row["form"] == form);
    found.unwrap_or_else(|| panic!("no {estimator}, {form} in {figures}"))
}

#[test]
fn every_estimator_has_finite_figures() {
    let figures = figures(changing_plant().path(), &ARGUMENTS);
    for row in rows(&figures) {
        let held = row["estimator"] == "classical" || row["estimator"] == "persistence";
        let mut names = vec!["h_step_sigma", "to_classical", "to_best_constant"];
        names.extend(["one_step_sigma", "free_run_rmse"].iter().filter(|_| row["estimator"] != "persistence"));
        names.extend((!held).then_some("ns_per_update"));
        for name in names {
            assert!(row[name].as_f64().is_some_and(f64::is_finite), "{name} of {row}");
        }
    }
}

#[test]
fn the_best_constant_is_the_one_with_the_least_error_in_either_form() {
    let figures = figures(changing_plant().path(), &ARGUMENTS);
    let constants: Vec<&Value> =
        rows(&figures).iter().filter(|row| row["estimator"].as_str().unwrap().starts_with("constant:")).collect();
    assert_eq!(constants.len(), 16);
    let best: Vec<&Value> = rows(&figures).iter().filter(|row| row["best_constant"] == true).collect();
    assert_eq!(best.len(), 1);
    assert_eq!(number(best[0], "/to_best_constant"), 1.0);
    assert!(constants.iter().all(|row| number(row, "/to_best_constant") >= 1.0));
    assert!(number(best[0], "/to_classical") < 0.5);
}

#[test]
fn the_rows_are_those_of_the_estimators_alone() {
    let folder = changing_plant();
    let compared = figures(folder.path(), &ARGUMENTS);
    for (estimator, form) in
        [("paper", "linear"), ("rules", "linear"), ("constant:0.98", "linear"), ("constant:0.99", "full")]
    {
        let arguments = ["--horizon", "10", "--estimator", estimator, "--form", form];
        let alone = figures(folder.path(), &arguments);
        let row = row(&compared, estimator, form);
        for (name, pointer) in [
            ("one_step_sigma", "/adaptive/one_step/sigma"),
            ("h_step_sigma", "/adaptive/h_step/sigma"),
            ("free_run_rmse", "/adaptive/free_run/rmse"),
        ] {
            assert_eq!(row[name], *alone.pointer(pointer).unwrap(), "{name} of {estimator}, {form}");
        }
    }
    let classical = row(&compared, "classical", "linear");
    assert_eq!(number(classical, "/h_step_sigma"), number(&compared, "/classical/h_step/sigma"));
    assert_eq!(number(classical, "/to_classical"), 1.0);
}

#[test]
fn the_held_model_is_that_of_the_form_that_was_typed() {
    let figures =
        figures(changing_plant().path(), &[&ARGUMENTS[..], &["--form", "full", "--estimator", "rules"]].concat());
    let classical = row(&figures, "classical", "full");
    assert_eq!(number(classical, "/h_step_sigma"), number(&figures, "/classical/h_step/sigma"));
    assert_eq!(row(&figures, "rules", "full")["h_step_sigma"], figures["adaptive"]["h_step"]["sigma"]);
}

#[test]
fn the_best_constant_is_named_below_the_table() {
    let folder = changing_plant();
    let text = success(folder.path(), &[&["identify", "r.csv"], &ARGUMENTS[..]].concat());
    let figures = figures(folder.path(), &ARGUMENTS);
    let best = rows(&figures).iter().find(|row| row["best_constant"] == true).unwrap();
    let (estimator, form) = (best["estimator"].as_str().unwrap(), best["form"].as_str().unwrap());
    assert!(text.ends_with(&format!("\nbest constant factor in hindsight: {estimator}, {form}\n")), "{text}");
}

#[test]
fn without_the_flag_there_is_no_comparison() {
    let figures = figures(constant_plant().path(), &["--horizon", "10"]);
    assert!(figures.get("comparison").is_none() && figures.get("selection").is_none());
}
