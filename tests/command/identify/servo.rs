//! The simulated records of a servo axis, see `tests/data`.

use crate::harness::records::{
    expect_finite_with_short_memory, expect_good_auto, expect_identified, identify, number, row, simulated,
};

const RECORDS: [&str; 3] = ["servo_constant.csv", "servo_warmup.csv", "servo_payload.csv"];

#[test]
fn adaptation_pays_on_the_servo_that_warms_up() {
    let report = identify(&simulated(), &["servo_warmup.csv", "--train", "0.4", "--horizon", "0.5s"]);
    let reduction = number(&report, "/reduction_percent/h_step");
    assert!(reduction >= 84.0, "{reduction} %");
}

#[test]
fn adaptation_pays_on_the_servo_that_is_loaded() {
    let report = identify(&simulated(), &["servo_payload.csv", "--train", "0.4", "--horizon", "0.5s"]);
    // Both models are judged as they are handed over.
    let reduction = number(&report, "/reduction_percent/h_step");
    assert!(reduction >= 19.5, "{reduction} %");
}

#[test]
fn auto_is_nearly_as_good_as_the_best_constant_factor_and_as_the_held_model() {
    for file in RECORDS {
        expect_good_auto(&simulated(), &[file]);
    }
}

#[test]
fn estimators_of_a_short_memory_stay_finite() {
    for file in RECORDS {
        expect_finite_with_short_memory(&simulated(), file);
    }
}

#[test]
fn every_servo_record_is_identified() {
    for file in RECORDS {
        expect_identified(&simulated(), file);
    }
}

#[test]
fn the_best_constant_factor_beats_the_held_model_of_the_servo_that_warms_up() {
    let report = identify(&simulated(), &["servo_warmup.csv", "--train", "0.4", "--compare"]);
    let best = row(&report, |row| row["best_constant"] == true);
    assert!(number(best, "/to_classical") < 0.25, "{best}");
}
