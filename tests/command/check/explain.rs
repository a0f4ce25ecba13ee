//! `--explain`: every effective value, and where it comes from.

use std::fs;

use serde_json::Value;

use super::{EXCAVATOR, cli::success, folder_with, line_of, model_files::MODEL, replaced};

/// The entry of a key in the JSON of `check --explain` with these further arguments; `machine` is the machine file.
fn entry(machine: &str, arguments: &[&str], key: &str) -> Value {
    let folder = folder_with(machine);
    fs::write(folder.path().join("model.toml"), MODEL).unwrap();
    let text = success(folder.path(), &[&["check", "m.toml", "--explain", "--json", "-"], arguments].concat());
    let entries: Vec<Value> = serde_json::from_str(&text).unwrap();
    let mut found = entries.into_iter().filter(|entry| entry["key"] == key);
    let entry = found.next().unwrap_or_else(|| panic!("{key} is missing"));
    assert_eq!(found.next(), None, "{key} is there twice");
    entry
}

/// Value and origin of a key, as [`entry`] finds them.
pub fn value_and_origin(machine: &str, arguments: &[&str], key: &str) -> (String, Value) {
    let entry = entry(machine, arguments, key);
    (entry["value"].as_str().unwrap().to_owned(), entry["origin"].clone())
}

#[test]
fn a_value_has_its_origin_from_the_strongest_source_to_the_weakest() {
    let key = "axis.boom.control.kp";
    let line = line_of("kp = 10.0");
    let in_file = (String::from("10.0"), serde_json::json!({ "from": "machine-file", "line": line }));
    assert_eq!(value_and_origin(EXCAVATOR, &[], key), in_file);
    let (value, origin) = value_and_origin(EXCAVATOR, &["--set", "axis.boom.control.kp=8"], key);
    assert_eq!((value.as_str(), &origin["from"]), ("8.0", &Value::from("command-line")));
    let (value, origin) = value_and_origin(EXCAVATOR, &["--model", "model.toml"], "axis.boom.commissioned.dead_time");
    assert_eq!((value.as_str(), &origin["from"], &origin["line"]), ("0.02", &"model-file".into(), &2.into()));
    let (value, origin) = value_and_origin(EXCAVATOR, &[], "axis.boom.identification.form");
    assert_eq!((value.as_str(), &origin["from"]), ("\"linear\"", &Value::from("default")));
}

#[test]
fn dead_bands_and_delay_follow_from_the_commissioned_model_where_the_machine_file_leaves_them_out() {
    let lines = [
        "nk = 3                     # samples from command to motion\n",
        "dead_band_extend = 0.08    # calibrated, a little less than the valve's\n",
        "dead_band_retract = 0.07\n",
    ];
    let machine = lines.iter().fold(EXCAVATOR.to_owned(), |machine, line| replaced(&machine, line, ""));
    let arguments = ["--model", "model.toml"];
    for (key, expected) in [
        ("control.dead_band_extend", 0.9 * 0.1),
        ("control.dead_band_retract", 0.9 * 0.08),
        // 20 ms of dead time in periods of 10 ms, and the sample itself.
        ("identification.nk", 3.0),
    ] {
        let (value, origin) = value_and_origin(&machine, &arguments, &format!("axis.boom.{key}"));
        assert_eq!(origin["from"], "derived", "{key}");
        assert!((value.parse::<f64>().unwrap() - expected).abs() < 1e-12, "{key}: {value}");
    }
    // What the file says wins.
    let (value, origin) = value_and_origin(EXCAVATOR, &arguments, "axis.boom.control.dead_band_extend");
    assert_eq!((value.as_str(), &origin["from"]), ("0.08", &Value::from("machine-file")));
}

#[test]
fn a_person_gets_the_values_as_a_table() {
    let folder = folder_with(EXCAVATOR);
    let text = success(folder.path(), &["check", "m.toml", "--explain"]);
    for expected in ["timing.period", "machine file, line", "derived: 3 periods", "\"100us\" to \"10s\""] {
        assert!(text.contains(expected), "{expected} in {text}");
    }
}
