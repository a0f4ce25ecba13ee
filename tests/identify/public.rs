//! The public records, where they are present.

use std::{
    fs,
    path::{Path, PathBuf},
};

use serde_json::Value;

use crate::{cli::success, plant::number};

/// The folder of the public records, or nothing, said on standard error, when the record is absent.
pub fn public(record: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    if folder.join(record).exists() {
        return Some(folder);
    }
    eprintln!("skipped: {} is absent", folder.join(record).display());
    None
}

/// The JSON for a file in `folder`.
pub fn public_figures(folder: &Path, arguments: &[&str]) -> Value {
    let text = success(folder, &[&["identify", "--json", "-"], arguments].concat());
    serde_json::from_str(&text).unwrap()
}

#[test]
fn the_hydraulic_actuator_is_modelled_as_well_as_published() {
    let Some(folder) = public("hydraulic_actuator.csv") else { return };
    let arguments = ["hydraulic_actuator.csv", "--train", "512", "--period", "1", "--horizon", "10"];
    let figures = public_figures(&folder, &arguments);
    let (one_step, free_run) =
        (number(&figures, "/classical/one_step/rmse"), number(&figures, "/classical/free_run/rmse"));
    assert!(one_step <= 0.110, "one step: {one_step}");
    assert!(free_run <= 0.60, "free run: {free_run}");
    let (online, frozen) =
        (number(&figures, "/adaptive/one_step/rmse"), number(&figures, "/adaptive/free_run_frozen/rmse"));
    assert!(online <= 0.102, "one step, online: {online}");
    assert!(frozen <= 0.55, "free run, frozen: {frozen}");
}

#[test]
fn adaptation_pays_on_the_servo_that_warms_up() {
    let Some(folder) = public("servo_warmup.csv") else { return };
    let figures = public_figures(&folder, &["servo_warmup.csv", "--train", "0.4", "--horizon", "0.5s"]);
    let reduction = number(&figures, "/reduction_percent/h_step");
    assert!(reduction >= 84.0, "{reduction} %");
}

#[test]
fn adaptation_pays_on_the_servo_that_is_loaded() {
    let Some(folder) = public("servo_payload.csv") else { return };
    let figures = public_figures(&folder, &["servo_payload.csv", "--train", "0.4", "--horizon", "0.5s"]);
    let reduction = number(&figures, "/reduction_percent/h_step");
    assert!(reduction >= 20.0, "{reduction} %");
}

/// The records whose comparison takes seconds, with what to type for them; horizons of half a second, or of a few
/// samples where that is less than one.
const COMPARED: [&[&str]; 13] = [
    &["servo_constant.csv"],
    &["servo_warmup.csv"],
    &["servo_payload.csv"],
    &["hydraulic_actuator.csv", "--period", "1", "--horizon", "10"],
    &["coupled_electric_drives.csv", "--input", "u1", "--output", "y1"],
    &["coupled_electric_drives.csv", "--input", "u2", "--output", "y2"],
    &["coupled_electric_drives.csv", "--input", "u3", "--output", "y3"],
    &["cascaded_tanks.csv", "--input", "u_train", "--output", "y_train", "--horizon", "5"],
    &["cascaded_tanks.csv", "--input", "u_test", "--output", "y_test", "--horizon", "5"],
    &["dryer.csv"],
    &["gas_furnace.csv", "--horizon", "5"],
    &["ballbeam.csv"],
    &["hydraulic_actuator.csv", "--period", "1", "--horizon", "5"],
];

#[test]
fn auto_is_as_good_as_the_best_constant_factor_in_hindsight_and_never_much_worse_than_holding() {
    let mut ratios = Vec::new();
    for typed in COMPARED {
        let Some(folder) = public(typed[0]) else { continue };
        let figures = public_figures(&folder, &[typed, &["--train", "0.4", "--compare"]].concat());
        let rows = figures["comparison"].as_array().unwrap();
        let auto = rows.iter().find(|row| row["estimator"] == "auto").unwrap();
        let (to_best, to_held) = (number(auto, "/to_best_constant"), number(auto, "/to_classical"));
        println!("{typed:?}: {to_best:.3} of the best constant, {to_held:.3} of the held model");
        assert!(to_best <= 1.05, "{typed:?}: {to_best}");
        assert!(to_held <= 1.03, "{typed:?}: {to_held}");
        ratios.push(to_best);
    }
    let mean = (ratios.iter().map(|ratio| ratio.ln()).sum::<f64>() / ratios.len().max(1) as f64).exp();
    assert!(mean <= 1.0, "{mean}");
}

#[test]
fn no_factor_however_short_its_memory_makes_anything_not_finite() {
    for file in ["servo_constant.csv", "servo_warmup.csv", "servo_payload.csv", "emps_train.csv", "emps_test.csv"] {
        let Some(folder) = public(file) else { continue };
        for estimator in ["constant:0.75", "paper"] {
            let figures = public_figures(&folder, &[file, "--train", "0.4", "--estimator", estimator]);
            for kind in ["one_step", "h_step", "free_run"] {
                let sigma = number(&figures, &format!("/adaptive/{kind}/sigma"));
                assert!(sigma.is_finite(), "{file} {estimator} {kind}: {sigma}");
            }
        }
    }
}

#[test]
fn every_public_record_with_time_input_and_output_is_identified() {
    let Some(folder) = public("") else { return };
    let mut identified = 0;
    for file in fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()) {
        let has_columns = || {
            let text = fs::read_to_string(folder.join(&file)).unwrap();
            let names: Vec<&str> = text.lines().next().unwrap_or("").split(',').map(str::trim).collect();
            ["t", "u", "y"].iter().all(|name| names.contains(name))
        };
        if !file.ends_with(".csv") || !has_columns() {
            continue;
        }
        let figures = public_figures(&folder, &[&file, "--train", "0.4", "--horizon", "10"]);
        for kind in ["one_step", "h_step", "free_run"] {
            for figure in ["sigma", "rmse", "max", "fit_percent"] {
                let value = number(&figures, &format!("/classical/{kind}/{figure}"));
                assert!(value.is_finite(), "{file} {kind} {figure}: {value}");
            }
        }
        identified += 1;
    }
    assert!(identified > 0, "no record with columns t, u, y in {}", folder.display());
}

#[test]
fn a_constant_factor_chosen_in_hindsight_beats_the_held_model_of_the_servo_that_warms_up() {
    let Some(folder) = public("servo_warmup.csv") else { return };
    let figures = public_figures(&folder, &["servo_warmup.csv", "--train", "0.4", "--compare"]);
    let rows = figures["comparison"].as_array().unwrap();
    let best = rows.iter().find(|row| row["best_constant"] == true).unwrap();
    assert!(number(best, "/to_classical") < 0.25, "{best}");
}
