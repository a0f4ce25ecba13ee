//! Models of a known plant, and their errors.

use super::plant::{
    A, PERIOD, changing_plant, constant_plant, csv, expect_coefficients, figures, folder_with, number, simulate,
};

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
fn the_paper_has_its_own_separation_and_universes() {
    let folder = constant_plant();
    let universes =
        |figures: &serde_json::Value| ["error", "variation"].map(|of| figures[format!("{of}_universe")].as_f64());
    let paper = figures(folder.path(), &["--horizon", "10", "--estimator", "paper"]);
    assert_eq!((&paper["split"], &paper["form"]), (&"paper".into(), &"linear".into()));
    assert_eq!(universes(&paper), [Some(4e-3), Some(2e-3)]);
    expect_coefficients(&paper, "adaptive");
    let rules = figures(folder.path(), &["--horizon", "10", "--estimator", "rules", "--error-universe", "3"]);
    assert_eq!((&rules["split"], universes(&rules)), (&"als".into(), [Some(3.0), Some(1.5)]));
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
    assert_eq!((&figures["form"], &figures["estimator"]), (&"linear".into(), &"auto".into()));
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
fn no_figure_is_reported_under_two_names() {
    let figures = figures(changing_plant().path(), &["--horizon", "10"]);
    let errors = ["one_step", "h_step", "free_run", "unseparated_h_step"];
    for (name, value) in figures["adaptive"].as_object().unwrap() {
        assert!(value.get("rmse").is_none() || errors.contains(&name.as_str()), "{name}");
    }
}

#[test]
fn reductions_are_finite_or_null_when_there_is_no_error_to_reduce() {
    // A constant output leaves errors of exactly 0, so that a reduction would be 0 / 0.
    let rows: String = simulate(600, |_| 1.0).iter().map(|[t, u, _]| format!("{t},{u},1\n")).collect();
    let figures = figures(folder_with(&format!("t,u,y\n{rows}")).path(), &["--horizon", "10"]);
    for kind in ["one_step", "h_step", "free_run"] {
        let reduction = &figures["reduction_percent"][kind];
        assert!(reduction.is_null() || reduction.as_f64().is_some_and(f64::is_finite), "{kind}: {reduction}");
    }
}

#[test]
fn a_constant_forgetting_factor_follows_a_gain_that_changes() {
    let figures = figures(changing_plant().path(), &["--horizon", "10", "--estimator", "constant:0.98"]);
    assert_eq!(figures["estimator"], "constant:0.98");
    assert!(number(&figures, "/adaptive/h_step/sigma") < 0.5 * number(&figures, "/classical/h_step/sigma"));
    assert!(number(&figures, "/reduction_percent/h_step") > 50.0);
}

#[test]
fn the_default_estimator_follows_a_gain_that_changes() {
    let figures = figures(changing_plant().path(), &["--horizon", "10"]);
    assert_eq!(figures["estimator"], "auto");
    assert!(number(&figures, "/adaptive/h_step/sigma") < 0.5 * number(&figures, "/classical/h_step/sigma"));
    assert!(number(&figures, "/reduction_percent/h_step") > 50.0);
}

#[test]
fn every_estimator_follows_a_gain_that_changes() {
    let folder = changing_plant();
    for estimator in ["constant:0.98", "rules", "fuzzy:0.9", "fortescue:100", "directional:0.95", "window:200"] {
        let figures = figures(folder.path(), &["--horizon", "10", "--estimator", estimator]);
        assert_eq!(figures["estimator"], estimator);
        assert_eq!(figures["error_universe"].is_null(), !["rules", "fuzzy:0.9"].contains(&estimator), "{estimator}");
        // The columns of a position are nearly equal; along them directional forgetting is slow.
        let least = if estimator.starts_with("directional") { 30.0 } else { 50.0 };
        let reduction = number(&figures, "/reduction_percent/h_step");
        assert!(reduction > least, "{estimator}: {reduction}");
    }
}

#[test]
fn the_full_form_follows_a_gain_that_changes() {
    let figures = figures(changing_plant().path(), &["--horizon", "10", "--form", "full", "--estimator", "rules"]);
    assert_eq!(figures["form"], "full");
    assert!(number(&figures, "/adaptive/h_step/sigma") < 0.5 * number(&figures, "/classical/h_step/sigma"));
}

#[test]
fn the_full_form_keeps_the_coefficients_of_a_constant_plant() {
    let figures = figures(constant_plant().path(), &["--horizon", "10", "--form", "full", "--estimator", "rules"]);
    expect_coefficients(&figures, "adaptive");
}

#[test]
fn the_residuals_and_the_spread_of_the_coefficients_are_judged() {
    // White noise on the difference equation: the residuals of the right model are white, those of a model with a wrong
    // delay are not.
    let mut noise = 88_172_645_463_325_252u64;
    let mut random = || {
        noise ^= noise << 13;
        noise ^= noise >> 7;
        noise ^= noise << 17;
        (noise >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    };
    let mut rows: Vec<[f64; 3]> = simulate(4000, |_| 1.0);
    let mut past = [0.0; 3];
    for row in &mut rows {
        // The noise is filtered by 1 / A.
        let e = 0.01 * random() - A.iter().zip(past).map(|(a, e)| a * e).sum::<f64>();
        past = [e, past[0], past[1]];
        row[2] += e;
    }
    let folder = folder_with(&csv("t,u,y", &rows));
    let figures = figures(folder.path(), &["--horizon", "10"]);
    let validation = &figures["validation"];
    assert_eq!(validation["classical"]["whiteness"]["white"], true, "{validation}");
    assert!(number(validation, "/classical/cross_correlation/model/p_value") > 0.01);
    assert!((number(validation, "/deviations/noise_sigma") / (0.01 / 12f64.sqrt()) - 1.0).abs() < 0.05);
    for (place, a) in A.iter().enumerate() {
        let (found, sigma) = (
            number(&figures, &format!("/classical/coefficients/a/{place}")),
            number(validation, &format!("/deviations/a/{place}")),
        );
        assert!((found - a).abs() < 4.0 * sigma && sigma < 0.05, "{place}: {found} +- {sigma} for {a}");
    }
    let late = super::plant::figures(folder.path(), &["--horizon", "10", "--nk", "3"]);
    assert_eq!(late["validation"]["classical"]["whiteness"]["white"], false);
}

#[test]
fn auto_tells_what_it_is_made_of() {
    let figures = figures(constant_plant().path(), &["--horizon", "10"]);
    let members = figures["adaptive"]["members"].as_array().unwrap();
    let total: f64 = members.iter().map(|member| member["weight"].as_f64().unwrap()).sum();
    assert!((total - 1.0).abs() < 1e-9 && members.len() > 5, "{members:?}");
    assert_eq!(members[0]["family"], "held");
    assert_eq!(figures["outliers"], 0);
    assert!(number(&figures, "/adaptive/h_step/sigma") <= 1e-6);
}
