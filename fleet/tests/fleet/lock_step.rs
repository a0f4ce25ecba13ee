//! A bridge takes nothing from a group: a run in lock-step gives the same bits with and without it.

use std::{fs, path::Path};

use serde_json::Value;

use crate::harness::{Bridge, Group, Router, heard::Heard, hydraxis, wait_for};

const ARGUMENTS: [&str; 5] = ["--lockstep", "--duration", "120s", "--seed", "7"];
/// Ticks of the run.
const TICKS: usize = 12_000;

/// The figures of a run, without those of the time that it took.
fn figures(file: &Path) -> Value {
    fn without_times(value: &mut Value) {
        if let Some(object) = value.as_object_mut() {
            object.retain(|key, _| !key.ends_with("_ns") && key != "wall_s");
            object.values_mut().for_each(without_times);
        }
    }
    let mut figures = serde_json::from_slice(&fs::read(file).unwrap()).unwrap();
    without_times(&mut figures);
    figures
}

/// The rows of a recording.
fn rows(recording: &Path) -> Vec<String> {
    let csv = recording.with_extension("csv");
    let export = hydraxis().arg("export").arg(recording).arg("--csv").arg(&csv).output().unwrap();
    assert!(export.status.success(), "{}", String::from_utf8_lossy(&export.stderr));
    fs::read_to_string(csv).unwrap().lines().map(str::to_owned).collect()
}

#[test]
fn a_run_in_lock_step_gives_the_same_bits_with_and_without_a_bridge() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let run = |name: &str| {
        let (recording, json) = (file(&format!("{name}.mcap")), file(&format!("{name}.json")));
        let files = ["--record", recording.to_str().unwrap(), "--json", json.to_str().unwrap()];
        Group::run(name, &[&ARGUMENTS[..], &files].concat())
    };
    run("alone").wait();

    let router = Router::new();
    let heard = Heard::new(&router.connection());
    let prefix = format!("fleet{}-bridged", std::process::id());
    let _bridge = Bridge::new(&router.address, &prefix, "");
    wait_for("the bridge", || heard.all().machine()?.is_alive.then_some(()));
    run("bridged").wait();

    let read = heard.all().of("telemetry/valve-command").len();
    assert!(read > 10, "the bridge has read the run: {read} commands");
    // Every figure is over all ticks, and is written with all its bits.
    assert_eq!(figures(&file("alone.json")), figures(&file("bridged.json")));
    // A recorder that gets no core misses messages of a run that is faster than real time. Those rows have holes.
    let (alone, bridged) = (rows(&file("alone.mcap")), rows(&file("bridged.mcap")));
    let both =
        alone.iter().zip(&bridged).filter(|(alone, bridged)| ![alone, bridged].iter().any(|row| row.contains(",,")));
    let mut whole = 0;
    both.for_each(|(alone, bridged)| {
        assert_eq!(alone, bridged);
        whole += 1;
    });
    assert!(whole > TICKS / 2, "{whole} of {TICKS} rows are whole in both recordings");
}
