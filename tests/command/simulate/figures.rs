//! The lines about figures below the tables.

use super::{cli::success, harness::report};

#[test]
fn the_model_is_compared_with_the_fallback_where_both_have_controlled() {
    let folder = tempfile::tempdir().unwrap();
    // The commissioned model is of new valves: it loses control of worn ones for a while.
    let worn = ["simulate", "--scenario", "valve-wear", "--duration"];
    let text = success(folder.path(), &[&worn[..], &["40s"]].concat());
    let figures = report(&[&worn[..], &["40s"]].concat());
    let (_, lines) = text.split_once("Tracking error in this run").unwrap();
    let arm = &figures["axes"]["arm"];
    let [model, fallback] =
        [&arm["tracking_by_model"]["rmse"], &arm["rmse_by_fallback"]].map(|rmse| 1e3 * rmse.as_f64().unwrap());
    let line = format!("\n arm: model {model:.1} mm, fallback {fallback:.1} mm\n");
    assert!(lines.contains(&line), "{line}{text}");
    assert!(!lines.contains(" boom: "), "no model controls it: {text}");
    let short = success(folder.path(), &[&worn[..], &["5s"]].concat());
    assert!(!short.contains("Tracking error in this run"), "{short}");
}

#[test]
fn a_commissioned_model_controls_before_the_training_has_ended() {
    let folder = tempfile::tempdir().unwrap();
    let arguments = ["simulate", "--scenario", "nominal", "--duration", "6s"];
    let figures = report(&arguments);
    for axis in ["arm", "telescope", "bucket"] {
        // Errors count once the reference has come into its course, which takes 2 s.
        let figures = &figures["axes"][axis];
        assert!(figures["tracking"]["count"].as_u64().unwrap() > 300, "{figures}");
        assert_eq!(figures["tracking_by_model"], figures["tracking"], "{axis}");
    }
    let text = success(folder.path(), &arguments);
    assert!(text.contains("arm: errors of models are counted after 12.000 s of motion"), "{text}");
    assert!(!text.contains("arm: no model yet"), "{text}");
}

#[test]
fn a_negative_reduction_is_explained() {
    let folder = tempfile::tempdir().unwrap();
    let negative = success(folder.path(), &["simulate", "--duration", "20s", "--scenario", "valve-wear"]);
    let is_negative = |word: &str| word.parse::<f64>().is_ok_and(|value| value < 0.0);
    let is_explained = negative.contains("A negative reduction: ");
    assert!(negative.split_whitespace().any(is_negative) && is_explained, "{negative}");
    let without = success(folder.path(), &["simulate", "--duration", "3s"]);
    assert!(!without.contains("A negative reduction: "), "{without}");
}
