//! Options of the structure that the paper does not have.

use crate::{
    harness::cli::{expect_refusal, success},
    identify::plant::{
        A, A_INTEGRATED, B, PERIOD, constant_plant, expect_list, figures, number, simulate, summed, with_output,
    },
};

#[test]
fn an_integrator_and_a_drift_are_found() {
    let folder = with_output(&simulate(600, |_| 1.0), summed(0.02));
    for form in ["linear", "full"] {
        let figures = figures(folder.path(), &["--horizon", "10", "--integrator", "--drift", "--form", form]);
        assert_eq!((&figures["structure"]["integrator"], &figures["structure"]["drift"]), (&true.into(), &true.into()));
        // Drift of the increments: A applied to a constant of 0.02.
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
    let both = super::plant::figures(folder.path(), &["--dead-band", "0.05", "--knots", "0.3", "--order", "1"]);
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
    // na = 4, 12 of the input and the drift make 17 coefficients; na + 2 outputs of the past come before the first row.
    let arguments = ["identify", "r.csv", "--train", "5", "--na", "4", "--integrator", "--drift", "--velocity"];
    let expected = ["r.csv: --train: found 5 of the 600 rows; allowed: at least 23, to determine 17 coefficients"];
    expect_refusal(constant_plant().path(), &arguments, &expected);
}
