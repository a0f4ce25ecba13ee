//! A bridge takes nothing from a group: a run in lock-step gives the same bits with and without it.

use crate::harness::{
    Bridge, Group, Router,
    heard::Heard,
    results::{equal_rows, figures},
    wait_for,
};

const ARGUMENTS: [&str; 5] = ["--lockstep", "--duration", "120s", "--seed", "7"];
/// Ticks of the run.
const TICKS: usize = 12_000;

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
    // A recorder that gets no core misses messages of a run that is faster than real time.
    let whole = equal_rows(&file("alone.mcap"), &file("bridged.mcap"));
    assert!(whole > TICKS / 2, "{whole} of {TICKS} rows are whole in both recordings");
}
