//! A plant on another computer: the same bits as without the network, no step twice, and an end with a reason.

use std::{path::Path, time::Duration};

use hydraxis_fleet::{
    content,
    plant::{request::Request, simulated},
};
use pipeline::{
    cdr, channel,
    machine::Machine,
    message::{EncoderReading, EncoderSample, ValveCommand},
};
use zenoh::{Session, Wait};

use crate::harness::{
    Group, PATIENCE, Plant, Router, fleet,
    results::{equal_rows, figures},
    wait_for,
};

/// A run of a minute with a scenario that changes mass and oil, and pressure transducers at one axis.
const MACHINE: [&str; 6] = [
    "--set",
    "scenario=everything",
    "--set",
    "axis.boom.pressure.range=4e7",
    "--set",
    "axis.boom.pressure.resolution=1e4",
];
const TICKS: usize = 6000;
const KEY: &str = "hydraxis/v1/quarry/ex-07/@plant";

/// Starts a run in lock-step with the seed of the plant, if no other one is given.
fn run(name: &str, duration: &str, arguments: &[&str]) -> Group {
    let seed: &[&str] = if arguments.contains(&"--seed") { &[] } else { &["--seed", "7"] };
    Group::run(name, &[&["--lockstep", "--duration", duration], seed, arguments].concat())
}

/// Starts a recorded run of [`MACHINE`] whose files are in `folder`.
fn recorded(folder: &Path, name: &str, more: &[&str]) -> Group {
    let file = |ending: &str| folder.join(format!("{name}.{ending}")).to_str().unwrap().to_owned();
    let (mcap, json) = (file("mcap"), file("json"));
    run(name, "60s", &[&MACHINE[..], &["--record", &mcap, "--json", &json], more].concat())
}

/// Waits until the group has worked this many ticks.
fn await_tick(group: &Group, tick: u64) {
    let prefix = group.prefix.parse().unwrap();
    wait_for("the group", || channel::is_joined(&prefix).then_some(()));
    let client = channel::Group::join(&prefix, "test").unwrap();
    let mut samples = client.reader::<EncoderSample>().unwrap();
    wait_for("a tick", || {
        samples.newest().unwrap();
        samples.last().filter(|sample| sample.header.sequence >= tick).map(|_| ())
    });
}

#[test]
fn a_plant_behind_a_router_that_is_suspended_gives_the_same_bits_as_one_beside_the_group() {
    let folder = tempfile::tempdir().unwrap();
    assert!(recorded(folder.path(), "local", &[]).wait());
    let router = Router::new();
    let plant = Plant::new(&router.address, "", &MACHINE);
    let stage = plant.stage(&["--recorded"]);
    for name in ["remote", "suspended"] {
        let mut group = recorded(folder.path(), name, &["--set", &stage]);
        if name == "suspended" {
            await_tick(&group, 1000);
            router.process.signal("STOP");
            std::thread::sleep(Duration::from_secs(3));
            router.process.signal("CONT");
        }
        assert!(group.wait(), "{}", group.said());
        let was_repeated = group.said().contains("requests to the plant were repeated");
        assert!(was_repeated || name == "remote", "{}", group.said());
        let file = |name: &str, ending: &str| folder.path().join(format!("{name}.{ending}"));
        assert_eq!(figures(&file("local", "json")), figures(&file(name, "json")));
        let whole = equal_rows(&file("local", "mcap"), &file(name, "mcap"));
        assert!(whole > TICKS * 9 / 10, "{whole} of {TICKS} rows are whole in both recordings");
    }
    assert_eq!(plant.said().matches("has ended with reading 5999").count(), 2, "{}", plant.said());
}

#[test]
fn a_plant_that_was_started_again_ends_the_run() {
    let router = Router::new();
    let mut plant = Plant::new(&router.address, "", &[]);
    let mut group = run("again", "10h", &["--set", &plant.stage(&[])]);
    await_tick(&group, 200);
    plant.restart();
    assert!(!group.wait());
    let said = group.said();
    assert!(said.contains(&format!("the plant at {KEY} refuses: found reading ")), "{said}");
    assert!(said.contains("of a run that is not in the plant; allowed: a new run, from reading 0 on"), "{said}");
    assert!(!plant.said().contains("has begun"), "{}", plant.said());
    // The plant takes the next run.
    assert!(run("next", "1s", &["--set", &plant.stage(&[])]).wait());
}

#[test]
fn a_plant_that_is_gone_ends_the_run_after_the_patience_of_the_settings() {
    let router = Router::new();
    let mut plant = Plant::new(&router.address, "[plant]\npatience = \"2s\"\n", &[]);
    let mut group = run("gone", "10h", &["--set", &plant.stage(&[])]);
    await_tick(&group, 200);
    plant.process.0.kill().unwrap();
    assert!(!group.wait());
    let said = group.said();
    assert!(said.contains("has not answered 4 requests for reading ") && said.contains("within 2s"), "{said}");
    drop(router);
    let mut group = run("no-router", "10h", &["--set", &plant.stage(&[])]);
    assert!(!group.wait());
    assert!(group.said().contains("not reached within 2s, plant.patience"), "{}", group.said());
}

#[test]
fn another_machine_or_seed_ends_the_run_before_it_begins_and_two_runs_do_not_share_a_plant() {
    let router = Router::new();
    let plant = Plant::new(&router.address, "", &[]);
    let stage = plant.stage(&[]);
    let refused = |name: &str, more: &[&str]| {
        let mut group = run(name, "10h", &[&["--set", &stage], more].concat());
        assert!(!group.wait());
        group.said()
    };
    let (own, other) = (Machine::load(None, &[]), Machine::load(None, &[("scenario".into(), "payload".into())]));
    let (own, other) = (simulated(&own.unwrap()), simulated(&other.unwrap()));
    let said = refused("machine", &["--scenario", "payload"]);
    assert!(said.contains(&format!("machine {other:016x}, where the plant simulates {own:016x}")), "{said}");
    let said = refused("seed", &["--seed", "8"]);
    assert!(said.contains("found seed 8, where the plant has seed 7"), "{said}");

    let first = run("first", "10h", &["--set", &stage]);
    await_tick(&first, 100);
    let said = refused("second", &[]);
    assert!(said.contains("found another run in the plant, whose last request is "), "{said}");
    let before = plant.said();
    assert_eq!(before.matches("has begun").count(), 1, "{before}");
    drop(first);
    wait_for("the end of the run", || plant.said().contains("has ended").then_some(()));
    assert!(run("third", "1s", &["--set", &stage]).wait());
}

/// The first answer of the plant.
fn ask(session: &Session, request: &Request, encoding: &str, payload: &[u8]) -> Result<EncoderReading, String> {
    let query = session.get(KEY).payload(payload).encoding(encoding).attachment(&request.to_bytes()[..]);
    let answer = query.timeout(PATIENCE).wait().unwrap().recv().unwrap();
    match answer.into_result() {
        Ok(sample) => Ok(content::message(&sample.encoding().to_string(), &sample.payload().to_bytes()).unwrap()),
        Err(error) => Err(error.payload().try_to_string().unwrap().into_owned()),
    }
}

#[test]
fn a_request_that_comes_twice_makes_one_step_and_one_of_another_layout_none() {
    let router = Router::new();
    let plant = Plant::new(&router.address, "", &[]);
    let session = router.connection().open().unwrap();
    let machine = simulated(&Machine::load(None, &[]).unwrap());
    let (layout, mut payload) = (content::name_of::<ValveCommand>(), Vec::new());
    cdr::encode(&ValveCommand::default(), &mut payload);
    let of = |reading: u64| Request { run: 1, reading, seed: 7, machine };
    let first: Vec<_> = (0..3).map(|reading| ask(&session, &of(reading), &layout, &payload).unwrap()).collect();
    assert_eq!(ask(&session, &of(2), &layout, &payload), Ok(first[2]));

    let other = layout.replace("ValveCommand:", "ValveCommand:0");
    let refusal = ask(&session, &of(3), &other, &payload).unwrap_err();
    assert_eq!(refusal, format!("found the encoding \"{other}\"; allowed: {layout}"));
    let refusal = ask(&session, &of(3), &layout, &payload[1..]).unwrap_err();
    assert!(refusal.contains("bytes that are no application/cdr;hydraxis/msg/ValveCommand:"), "{refusal}");
    let refusal = ask(&session, &of(1), &layout, &payload).unwrap_err();
    assert_eq!(refusal, "found a request for reading 1; allowed: 2, the last one, or the next one");
    assert_eq!(ask(&session, &of(3), &layout, &payload).unwrap().header.sequence, 3);
    assert_eq!(plant.said().matches("has begun").count(), 1, "{}", plant.said());
}

#[test]
fn a_stage_in_real_time_or_of_a_real_machine_is_refused() {
    let router = Router::new();
    let plant = Plant::new(&router.address, "", &[]);
    let mut group = Group::run("real-time", &["--duration", "10h", "--set", &plant.stage(&[])]);
    assert!(!group.wait());
    let said = group.said();
    assert!(said.contains("a plant on another computer; allowed: --lockstep"), "{said}");
    let mut stage = fleet();
    stage.arg("stage").arg(&plant.settings).args(["--prefix", &group.prefix, "--lockstep"]);
    let stage = stage.args(["--set", "source.kind=external", "--set", "drive.kind=external"]).output().unwrap();
    let said = String::from_utf8_lossy(&stage.stderr);
    assert!(said.contains("source.kind: found \"external\"") && stage.status.code() == Some(2), "{said}");
}
