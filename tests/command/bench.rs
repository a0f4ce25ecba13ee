//! `hydraxis bench`: figures, options and refusals.

mod tip;

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
    "smith-adaptive",
    "--scenario",
    "payload",
    "--dead-time",
    "100ms",
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
    assert_eq!(controllers, ["pi-feedforward", "smith-adaptive"]);
    for row in rows {
        assert_eq!((row["scenario"].as_str(), row["dead_time_s"].as_f64()), (Some("payload"), Some(0.1)));
        let [rms, sigma, max] = ["rms", "sigma", "max"].map(|key| row[key].as_f64().unwrap());
        assert!(1e-5 < sigma && sigma <= rms && rms < max && max < 0.1, "{row}");
        assert_eq!(row["axes"].as_object().unwrap().len(), 4);
        assert_eq!(row["latched"].as_array().map(Vec::len), Some(0), "{row}");
    }
    assert_eq!(rows[0]["by_model"], 0.0);
    assert!(rows[1]["by_model"].as_f64().unwrap() > 0.9, "{}", rows[1]);
    // The fallback follows as well at the telescope.
    for (axis, part) in [("boom", 1.0), ("arm", 1.0), ("telescope", 1.02), ("bucket", 1.0)] {
        let rms = |row: usize| rows[row]["axes"][axis]["rms"].as_f64().unwrap();
        assert!(rms(1) < part * rms(0), "{axis}: {rows:?}");
    }
    let rms = |row: usize| rows[row]["rms"].as_f64().unwrap();
    assert!(rms(1) < 0.9 * rms(0), "{rows:?}");
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
    let (boom_and_arm, _) = pipeline::machine::FOUR_AXES.split_once("[axis.telescope]").unwrap();
    fs::write(folder.path().join("two-axes.toml"), boom_and_arm).unwrap();
    let gain = |more: &[&str]| {
        let common = ["--controller", "pi-deadband", "--scenario", "nominal", "--dead-time", "20ms", "--seeds", "1"];
        let arguments = [&["bench", "control", "two-axes.toml"], &common[..], more, &["--json", "-"]].concat();
        let figures: Value = serde_json::from_str(&success(folder.path(), &arguments)).unwrap();
        [0, 1].map(|axis| figures["gains"][axis]["kp"].as_f64().unwrap())
    };
    let (known, given) = (gain(&[]), gain(&["--model", "model.toml"]));
    assert!(given[0] > 1.4 * known[0] && given[1] == known[1], "{known:?} {given:?}");
}

#[test]
fn drawn_machines_are_commissioned_driven_and_told() {
    let folder = tempfile::tempdir().unwrap();
    // One that commissioning takes at the second try, and one whose model controls throughout.
    let chosen = ["bench", "control", "--machines", "60", "--half", "design", "--only", "16", "--only", "4"];
    let tables = success(folder.path(), &[&chosen[..], &["--json", "out.json"]].concat());
    assert!(tables.starts_with("2 machines of seed 1: 2 commissioned (100.00 %), 1 of them at the second"), "{tables}");
    let text = fs::read_to_string(folder.path().join("out.json")).unwrap();
    assert_eq!(success(folder.path(), &[&chosen[..], &["--threads", "1", "--json", "-"]].concat()), text);
    let figures: Value = serde_json::from_str(&text).unwrap();
    assert_eq!((figures["set"].as_u64(), figures["drawn"].as_u64()), (Some(60), Some(2)));
    assert_eq!(figures["half"], "design");
    let machines = figures["machines"].as_array().unwrap();
    assert_eq!([0, 1].map(|i| machines[i]["machine"].as_u64().unwrap()), [4, 16]);
    assert!(machines.iter().all(|machine| machine.get("model").is_some()));
    assert_eq!((figures["commissioned"].as_u64(), figures["second_try"].as_u64()), (Some(2), Some(1)));
    for task in ["sines", "ramps", "steps", "hold"] {
        let pair = &machines[0]["tasks"][task];
        let [fallback, adaptive] = ["fallback", "adaptive"].map(|run| pair[run]["rms_m"].as_f64().unwrap());
        assert!(1e-6 < fallback && fallback < 0.01 && adaptive < 0.1, "{task}: {pair}");
        assert_eq!(pair["fallback"]["by_model"], 0.0);
        assert!(pair["adaptive"]["by_model"].as_f64().unwrap() > 0.5, "{task}: {pair}");
        assert_eq!(pair["fallback"].get("hold").is_some(), task == "hold");
    }
    assert_eq!(figures["tasks"].as_array().unwrap().len(), 4);
}

#[test]
fn a_drawn_machine_that_commissioning_refuses_is_told_with_the_reason() {
    let refused = ["bench", "control", "--machines", "300", "--seed", "6", "--only", "15", "--json", "-"];
    let figures: Value = serde_json::from_str(&success(Path::new("."), &refused)).unwrap();
    assert_eq!((figures["commissioned"].as_u64(), figures["drawn"].as_u64()), (Some(0), Some(1)));
    assert_eq!(figures["refusals"][0]["reason"], "no motion");
    assert_eq!(figures["refusals"][0]["machines"][0], 15);
    assert!(figures["machines"][0]["refusal"].as_str().unwrap().contains("command_limit"), "{figures}");
}

#[test]
fn the_file_of_a_drawn_machine_is_one_that_the_other_commands_read() {
    let folder = tempfile::tempdir().unwrap();
    let drawn = ["bench", "control", "--machines", "10", "--seed", "4"];
    success(folder.path(), &[&drawn[..], &["--only", "3", "--write", "rigs"]].concat());
    let mut files: Vec<_> =
        fs::read_dir(folder.path().join("rigs")).unwrap().map(|file| file.unwrap().file_name()).collect();
    files.sort();
    assert_eq!(files, ["3-hold.toml", "3-ramps.toml", "3-sines.toml", "3-steps.toml"]);
    for file in files {
        let file = format!("rigs/{}", file.to_str().unwrap());
        let shown = success(folder.path(), &["check", &file, "--scenario", "change"]);
        assert!(shown.starts_with("machine 3: 1 axis (rig)"), "{shown}");
    }
    success(folder.path(), &["simulate", "rigs/3-hold.toml", "--duration", "1s"]);
}

#[test]
fn invalid_options_of_drawn_machines_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refuse = |arguments: &[&str], expected: &[&str]| {
        expect_refusal(folder.path(), &[&["bench", "control"], arguments].concat(), expected);
    };
    refuse(&["--machines", "0"], &["--machines", "from 1 to 100000"]);
    refuse(&["--machines", "5", "--only", "5"], &["--only: found 5; allowed: 0 to 4"]);
    refuse(&["--machines", "5", "--half", "judge", "--only", "2"], &["--only, --half: found no machine"]);
    refuse(&["--machines", "5", "--half", "third"], &["third", "design", "judge"]);
    refuse(&["--machines", "5", "--scenario", "payload"], &["--machines", "--scenario"]);
    refuse(&[FOUR_AXES, "--machines", "5"], &["--machines", "MACHINE.toml"]);
    refuse(&["--half", "judge"], &["--machines"]);
    refuse(&["--wrong-models"], &["--machines"]);
    refuse(&["--machines", "5", "--wrong-models", "--write", "rigs"], &["--wrong-models", "--write"]);
    refuse(&["--machines", "5", "--json", "no/such/folder.json"], &["--json: no/such/folder.json"]);
    fs::write(folder.path().join("file"), "").unwrap();
    refuse(&["--machines", "5", "--write", "file"], &["--write: file cannot be written"]);
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
    refuse(&["--dead-time", "10ms,1100ms"], &["--dead-time: found 1s 100ms; allowed: up to 1s"]);
    refuse(&["--dead-time", "fast"], &["--dead-time", "allowed: a duration"]);
    refuse(&["--seeds", "0"], &["--seeds", "from 1 to 1000"]);
    refuse(&["--json", "no/such/folder.json", "--scenario", "nominal"], &["--json: no/such/folder.json"]);
    let record = "t,u,y\n0,0,0\n";
    fs::write(folder.path().join("r.csv"), record).unwrap();
    refuse(&["--set", "source.kind=replay", "--set", "source.file=r.csv"], &["source.kind: found \"replay\""]);
}

#[test]
fn generated_records_are_identified_and_compared_and_the_same_every_time() {
    let folder = tempfile::tempdir().unwrap();
    // A dropout, a rest and a record of feedback.
    let chosen = ["bench", "identify", "--records", "136", "--only", "50", "--only", "88", "--only", "24"];
    let tables = success(folder.path(), &[&chosen[..], &["--json", "out.json"]].concat());
    assert!(tables.contains("auto / best constant") && tables.contains("dropouts"), "{tables}");
    let text = fs::read_to_string(folder.path().join("out.json")).unwrap();
    assert_eq!(success(folder.path(), &[&chosen[..], &["--threads", "1", "--json", "-"]].concat()), text);
    let figures: Value = serde_json::from_str(&text).unwrap();
    let records = figures["records"].as_array().unwrap();
    let classes: Vec<&str> = records.iter().map(|record| record["class"].as_str().unwrap()).collect();
    assert_eq!(classes, ["feedback", "dropouts", "rest"]);
    let ratio = |name: &str, figure: &str| {
        let all = figures["all"].as_array().unwrap();
        all.iter().find(|ratios| ratios["name"] == name).unwrap()[figure].as_f64().unwrap()
    };
    // Wild samples, a training that nearly rests and feedback must not make auto worse than doing nothing.
    assert!(ratio("auto / still", "worst") < 1.0, "{tables}");
    assert!(ratio("auto / held", "worst") < 1.1, "{tables}");
    assert!(ratio("auto / without wild", "worst") < 1.1, "{tables}");
    assert_eq!(ratio("auto / best constant", "records"), 3.0);
    for record in records {
        assert!(record["best"]["sigma"].as_f64().unwrap() > 0.0, "{record}");
    }
}

#[test]
fn the_same_plants_are_recorded_at_all_periods() {
    let small = ["bench", "identify", "--records", "2", "--half", "judge", "--plants", "2", "--quick", "--json", "-"];
    let figures: Value = serde_json::from_str(&success(Path::new("."), &small)).unwrap();
    let periods: Vec<f64> =
        figures["rates"].as_array().unwrap().iter().map(|row| row["period_s"].as_f64().unwrap()).collect();
    assert_eq!(periods, [0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1]);
    assert_eq!((figures["half"].as_str(), figures["records"][0]["number"].as_u64()), (Some("judge"), Some(1)));
    assert!(figures["records"][0].get("best").is_none(), "{figures}");
}

#[test]
fn invalid_options_of_generated_records_are_refused() {
    let refuse = |arguments: &[&str], expected: &[&str]| {
        expect_refusal(Path::new("."), &[&["bench", "identify"], arguments].concat(), expected);
    };
    refuse(&["--records", "0"], &["--records", "from 1 to 100000"]);
    refuse(&["--records", "5", "--only", "5"], &["--only: found 5; allowed: 0 to 4"]);
    refuse(&["--records", "5", "--half", "judge", "--only", "2"], &["--only, --half: found no record"]);
    refuse(&["--half", "third"], &["third", "design", "judge"]);
    refuse(&["--plants", "many"], &["--plants", "from 0 to 1000"]);
    refuse(&["--json", "no/such/folder.json"], &["--json: no/such/folder.json"]);
}
