//! The lines about figures below the tables.

use super::{cli::success, harness::report};

#[test]
fn the_model_is_compared_with_the_fallback_where_both_have_controlled() {
    let folder = tempfile::tempdir().unwrap();
    let text = success(folder.path(), &["simulate", "--duration", "20s"]);
    let figures = report(&["simulate", "--duration", "20s"]);
    let (_, lines) = text.split_once("Tracking error in this run").unwrap();
    for axis in ["arm", "telescope", "bucket"] {
        let axis_figures = &figures["axes"][axis];
        let [model, fallback] = [&axis_figures["tracking_by_model"]["rmse"], &axis_figures["rmse_by_fallback"]]
            .map(|rmse| 1e3 * rmse.as_f64().unwrap());
        let line = format!("\n {axis}: model {model:.1} mm, fallback {fallback:.1} mm\n");
        assert!(lines.contains(&line), "{line}{text}");
    }
    assert!(!lines.contains(" boom: "), "no model controls it: {text}");
    // The model controls from 12 s on, so for less than 5 s.
    let short = success(folder.path(), &["simulate", "--duration", "16s"]);
    assert!(!short.contains("Tracking error in this run"), "{short}");
}

#[test]
fn a_negative_reduction_is_explained() {
    let folder = tempfile::tempdir().unwrap();
    let negative = success(folder.path(), &["simulate", "--duration", "20s"]);
    assert!(negative.contains("-3") && negative.contains("A negative reduction: "), "{negative}");
    let without = success(folder.path(), &["simulate", "--duration", "3s"]);
    assert!(!without.contains("A negative reduction: "), "{without}");
}
