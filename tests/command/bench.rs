//! `hydraxis bench control`: figures, options and refusals.

use std::{fs, path::Path};

use serde_json::Value;

use crate::harness::{
    FOUR_AXES,
    cli::{expect_refusal, success},
};

/// The smallest comparison: two controllers, one scenario, one seed, one dead time.
const SMALL: [&str; 14] = [
    "bench",
    "control",
    FOUR_AXES,
    "--controller",
    "pi-feedforward",
    "--controller",
    "mpc-adaptive",
    "--scenario",
    "payload",
    "--dead-time",
    "10ms",
    "--seeds",
    "1",
    "--json",
];

fn small(folder: &Path, file: &str) -> String {
    let tables = success(folder, &[&SMALL[..], &[file]].concat());
    assert!(file == "-" || tables.contains("pi-feedforward"), "{tables}");
    if file == "-" { tables } else { fs::read_to_string(folder.join(file)).unwrap() }
}

#[test]
fn the_figures_are_there_in_metres_and_the_same_every_time() {
    let folder = tempfile::tempdir().unwrap();
    let text = small(folder.path(), "out.json");
    assert_eq!(small(folder.path(), "-"), text);
    let figures: Value = serde_json::from_str(&text).unwrap();
    let rows = figures["rows"].as_array().unwrap();
    let controllers: Vec<&str> = rows.iter().map(|row| row["controller"].as_str().unwrap()).collect();
    assert_eq!(controllers, ["pi-feedforward", "mpc-adaptive"]);
    for row in rows {
        assert_eq!((row["scenario"].as_str(), row["dead_time_s"].as_f64()), (Some("payload"), Some(0.01)));
        let [rms, sigma, max] = ["rms", "sigma", "max"].map(|key| row[key].as_f64().unwrap());
        assert!(1e-5 < sigma && sigma <= rms && rms < max && max < 0.1, "{row}");
        assert_eq!(row["axes"].as_object().unwrap().len(), 4);
        assert_eq!(row["latched"], 0);
    }
    assert_eq!(rows[0]["by_model"], 0.0);
    assert!(rows[1]["by_model"].as_f64().unwrap() > 0.9, "{}", rows[1]);
    assert!(rows[0]["rms"].as_f64().unwrap() < 2e-3, "{}", rows[0]);
    assert_eq!(figures["gains"].as_array().unwrap().len(), 8);
}

#[test]
fn a_model_file_takes_the_place_of_what_is_known_of_the_plant() {
    let folder = tempfile::tempdir().unwrap();
    // A boom that is half as fast as the simulated one: tuning for it gives higher gains.
    let model = "[axis.boom.commissioned]\ndead_time = 0.02\ntime_constant = 0.05\ndead_band_extend = 0.105\n\
                 dead_band_retract = 0.085\nopenings = [0.1, 0.9]\nspeeds_extend = [0.02, 0.2]\n\
                 speeds_retract = [0.02, 0.2]\nfit_percent = 97.5\n";
    fs::write(folder.path().join("model.toml"), model).unwrap();
    let gain = |more: &[&str]| {
        let common = ["--controller", "pi-deadband", "--scenario", "nominal", "--dead-time", "20ms", "--seeds", "1"];
        let arguments = [&["bench", "control", FOUR_AXES], &common[..], more, &["--json", "-"]].concat();
        let figures: Value = serde_json::from_str(&success(folder.path(), &arguments)).unwrap();
        [0, 1].map(|axis| figures["gains"][axis]["kp"].as_f64().unwrap())
    };
    let (known, given) = (gain(&[]), gain(&["--model", "model.toml"]));
    assert!(given[0] > 1.4 * known[0] && given[1] == known[1], "{known:?} {given:?}");
}

#[test]
fn invalid_options_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refuse = |arguments: &[&str], expected: &[&str]| {
        expect_refusal(folder.path(), &[&["bench", "control"], arguments].concat(), expected);
    };
    refuse(&["--controller", "pid"], &["pid", "pi-feedforward", "mpc-adaptive"]);
    refuse(&["--scenario", "earthquake"], &["found earthquake", "\"payload\""]);
    refuse(&["--scenario", "open-loop"], &["found \"open-loop\"", "allowed: scenarios without commands"]);
    refuse(&["--dead-time", "10ms,700ms"], &["--dead-time: found 700ms; allowed: up to 500ms"]);
    refuse(&["--dead-time", "fast"], &["--dead-time", "allowed: a duration"]);
    refuse(&["--seeds", "0"], &["--seeds", "1..=1000"]);
    refuse(&["--json", "no/such/folder.json", "--scenario", "nominal"], &["--json: no/such/folder.json"]);
    let record = "t,u,y\n0,0,0\n";
    fs::write(folder.path().join("r.csv"), record).unwrap();
    refuse(&["--set", "source.kind=replay", "--set", "source.file=r.csv"], &["source.kind: found \"replay\""]);
}
