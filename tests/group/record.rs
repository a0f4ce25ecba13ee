//! Recordings of a running group.

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    process::{Child, Stdio},
};

use mcap::MessageStream;
use pipeline::message::CHANNELS;
use rustix::process::Signal;
use serde_json::Value;

use crate::harness::{
    hydraxis, is_running,
    place::{FullMemory, in_own_place},
    running::{Running, text},
    shared, signal, wait_for,
};

/// Starts `hydraxis record` on a group, and waits until its file is there.
fn record(running: &Running, file: &Path) -> Child {
    let mut command = hydraxis();
    command.args(["record", "--prefix", &running.group.prefix.to_string(), "--output"]).arg(file);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for("a recording", || file.exists().then_some(()));
    child
}

/// Waits until a file has grown by so many bytes.
fn await_growth(file: &Path, by: u64) {
    let length = || fs::metadata(file).map_or(0, |data| data.len());
    let begin = length();
    wait_for("a longer recording", || (length() > begin + by).then_some(()));
}

/// Ends a recorder in order. What it has said.
fn end(mut recorder: Child) -> String {
    signal(recorder.id(), Signal::INT);
    let said = text(recorder.stdout.take()) + &text(recorder.stderr.take());
    assert!(recorder.wait().unwrap().success(), "{said}");
    said
}

fn info(file: &Path) -> Value {
    let output = hydraxis().args(["info", "--json", "-"]).arg(file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The rows of an export, by the names of their columns.
fn exported(file: &Path, options: &[&str]) -> Vec<BTreeMap<String, String>> {
    let output = hydraxis().arg("export").arg(file).args(["--csv", "-"]).args(options).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut reader = csv::Reader::from_reader(&*output.stdout);
    reader.deserialize().map(Result::unwrap).collect()
}

fn value(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap()
}

#[test]
fn a_running_group_is_recorded_whole_and_exported() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let mut running = Running::start("record");
    let recorder = record(&running, &file);
    await_growth(&file, 200_000);
    let said = end(recorder);
    assert!(said.contains(" 0 lost"), "{said}");
    running.interrupt();

    let bytes = fs::read(&file).unwrap();
    let mut counts: BTreeMap<String, u64> = BTreeMap::new();
    for message in MessageStream::new(&bytes).unwrap() {
        *counts.entry(message.unwrap().channel.topic.clone()).or_default() += 1;
    }
    let info = info(&file);
    assert_eq!(info["damage"], Value::Null);
    assert_eq!(info["facts"]["axes"], "boom arm telescope bucket");
    assert_eq!(info["attached"], serde_json::json!(["machine.toml", "settings.json"]));
    let channels = info["channels"].as_array().unwrap();
    let names: Vec<&str> = channels.iter().map(|channel| channel["channel"].as_str().unwrap()).collect();
    assert_eq!(names, CHANNELS);
    for channel in channels {
        let name = channel["channel"].as_str().unwrap();
        assert_eq!(channel["messages"], counts.get(name).copied().unwrap_or_default(), "{name}");
        let publishers = if name == "stage-health" { 4 } else { channel["messages"].as_u64().unwrap().min(1) };
        assert_eq!((&channel["missing"], &channel["publishers"]), (&0.into(), &publishers.into()), "{name}");
        assert_eq!(info["facts"][format!("{name} lost")], "0");
    }

    let rows = exported(&file, &[]);
    let samples = counts["encoder-sample"];
    assert_eq!(rows.len() as u64, samples);
    // The first commands and the last ones may answer samples from before and after.
    let answered: Vec<_> = rows.iter().filter(|row| !row["arm.command"].is_empty()).collect();
    assert!(answered.len() as u64 + 10 > samples && samples > 50, "{} {samples}", answered.len());
    for row in &answered {
        let error = value(row, "boom.reference") - value(row, "boom.position");
        assert!((value(row, "boom.error") - error).abs() < 1e-12 || value(row, "boom.faults") != 0.0, "{row:?}");
    }
    let ticks: Vec<f64> = rows.iter().map(|row| value(row, "tick")).collect();
    assert!(ticks.windows(2).all(|pair| pair[1] > pair[0]));
    let part = exported(&file, &["--axis", "arm", "--every", "10"]);
    assert_eq!(part.len() as u64, samples.div_ceil(10));
    assert!(part[0].contains_key("arm.position") && !part[0].contains_key("boom.position"));
    let health = exported(&file, &["--channel", "stage-health"]);
    assert_eq!(health.len() as u64, counts["stage-health"]);
    assert!(health.iter().all(|row| value(row, "stage") < 4.0));
}

#[test]
fn a_recorder_ends_with_its_group_and_leaves_none_of_its_files() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let mut running = Running::start("record-end");
    let mut recorder = record(&running, &file);
    await_growth(&file, 50_000);
    running.interrupt();
    let status = wait_for("the end of the recorder", || recorder.try_wait().unwrap());
    assert!(status.success(), "{}", text(recorder.stderr.take()));
    assert_eq!(info(&file)["damage"], Value::Null);
    assert!(!running.group.prefix.folder().exists());
}

#[test]
fn a_killed_recorder_leaves_a_file_that_is_read_as_far_as_it_goes() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let mut running = Running::start("record-killed");
    let mut recorder = record(&running, &file);
    await_growth(&file, 100_000);
    signal(recorder.id(), Signal::KILL);
    recorder.wait().unwrap();
    let length = fs::metadata(&file).unwrap().len();
    let info = info(&file);
    // A chunk that was being written has no length yet: the file is read up to there.
    let damage = info["damage"].as_str().and_then(|damage| damage.strip_prefix("byte ")?.split_once(": "));
    let place: u64 = damage.expect("a place").0.parse().unwrap();
    assert!((100_000..=length).contains(&place), "{info} {length}");
    assert!(info["channels"][1]["messages"].as_u64().unwrap() > 20, "{info}");
    assert_eq!(exported(&file, &[]).len() as u64, info["channels"][1]["messages"].as_u64().unwrap());

    let clean = folder.path().join("clean.mcap");
    let recover = || hydraxis().arg("recover").arg(&file).arg(&clean).output().unwrap();
    let output = recover();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let whole = self::info(&clean);
    assert_eq!((&whole["damage"], &whole["channels"]), (&Value::Null, &info["channels"]));
    assert_eq!(whole["attached"], info["attached"]);
    assert_eq!(exported(&clean, &[]), exported(&file, &[]));
    let refused = String::from_utf8(recover().stderr).unwrap();
    assert!(refused.contains("clean.mcap") && refused.contains("exists"), "{refused}");
    running.interrupt();
}

#[test]
fn a_full_disk_disturbs_no_stage_and_the_recording_goes_on_when_there_is_room() {
    let _cores = shared();
    in_own_place("record::a_full_disk_disturbs_no_stage_and_the_recording_goes_on_when_there_is_room", |is_private| {
        if !is_private {
            return;
        }
        let folder = Path::new("/dev/shm/recordings");
        fs::create_dir(folder).unwrap();
        let mut running = Running::start("record-full");
        let mut recorder = record(&running, &folder.join("run.mcap"));
        await_growth(&folder.join("run.mcap"), 50_000);
        let full = FullMemory::take();
        std::thread::sleep(std::time::Duration::from_secs(1));
        drop(full);
        let next = folder.join("run-1.mcap");
        wait_for("the recording that goes on", || next.exists().then_some(()));
        await_growth(&next, 50_000);
        signal(recorder.id(), Signal::INT);
        let said = text(recorder.stdout.take()) + &text(recorder.stderr.take());
        assert!(recorder.wait().unwrap().success(), "{said}");
        assert_eq!(said.matches("nothing is recorded until").count(), 1, "{said}");
        assert_eq!(said.matches("recording goes on: ").count(), 1, "{said}");
        let facts = info(&next)["facts"].clone();
        let lost: u64 = facts["encoder-sample lost"].as_str().unwrap().parse().unwrap();
        assert!(said.contains(&format!("warning: encoder-sample: {lost} lost")) && lost > 10, "{said}");
        // What is missing between the two files is what was lost.
        let number = |file: &Path, last: bool| {
            let rows = exported(file, &["--channel", "encoder-sample"]);
            let row = if last { rows.last() } else { rows.first() };
            value(row.unwrap(), "header.number") as u64
        };
        assert_eq!(number(&next, false) - number(&folder.join("run.mcap"), true) - 1, lost, "{said}");
        let stages = running.pids;
        assert!(stages.iter().all(|pid| is_running(*pid)));
        running.interrupt();
        fs::remove_dir_all(folder).unwrap();
    });
}
