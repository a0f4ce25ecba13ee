//! A record in the place of the encoders: the same figures from four processes, from one process, and from `identify`.

use std::path::{Path, PathBuf};

use super::{report, succeed};

/// Writes a machine file that replays a record of a single axis.
fn machine_file(folder: &Path, record: &Path, period: &str, training: usize) -> PathBuf {
    let file = folder.join("replay.toml");
    let text = format!(
        r#"
        name = "replay"
        [timing]
        period = "{period}"
        [source]
        kind = "replay"
        file = "{}"
        [axis.slide]
        stroke = 100.0
        max_speed = 1000.0
        soft_limits = [0.0, 100.0]
        [axis.slide.encoder]
        resolution = 1e-6
        tolerance = 1.0
        [axis.slide.identification]
        training = {training}
        horizon = 10
        [axis.slide.control]
        kp = 0.0
        ki = 0.0
        dead_band_extend = 0.0
        dead_band_retract = 0.0
        command_limit = 1.0
        command_rate = 1.0
        [axis.slide.reference]
        kind = "hold"
        "#,
        record.display()
    );
    std::fs::write(&file, text).unwrap();
    file
}

/// Expects equal coefficients and errors, bit for bit, from a record that is streamed through the processes,
/// replayed in one process, and given to `identify`.
pub fn expect_same_bits(record: &Path, period: &str, training: usize) {
    let folder = tempfile::tempdir().unwrap();
    let file = machine_file(folder.path(), record, period, training);
    let file = file.to_str().unwrap();
    let streamed = report(&["run", file, "--lockstep"]);
    assert_eq!(streamed, report(&["simulate", file]));
    let training = training.to_string();
    let record = record.to_str().unwrap();
    let output = succeed(&["identify", record, "--train", &training, "--horizon", "10", "--json", "-"]);
    let identified: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let streamed = &streamed["axes"]["slide"]["identification"];
    for model in ["classical", "adaptive"] {
        for key in ["coefficients", "one_step", "h_step", "free_run"] {
            assert_eq!(streamed[model][key], identified[model][key], "{model} {key}");
        }
        let a = streamed[model]["coefficients"]["a"].as_array().unwrap();
        assert!(a.iter().all(|a| a.as_f64().is_some_and(|a| a != 0.0)), "{a:?}");
    }
}
