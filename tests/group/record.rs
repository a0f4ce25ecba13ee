//! Recordings of a running group.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Child, Stdio},
};

use mcap::{MessageStream, Summary};
use parquet::{
    file::reader::{FileReader, SerializedFileReader},
    record::Field,
};
use pipeline::{message::CHANNELS, stage::StageKind};
use rustix::process::Signal;
use serde_json::Value;

use crate::harness::{
    hydraxis, is_running,
    place::{FullMemory, in_own_place},
    running::{Running, text},
    shared, signal, wait_for,
};

/// The channel that only recordings have.
const STATES: &str = "controller-state";

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

/// Expects each command of a recording once more, under the names of ROS and of the axes.
fn expect_states(file: &Path, rows: &[BTreeMap<String, String>]) {
    let (commands, states) = (exported(file, &["--channel", "valve-command"]), exported(file, &["--channel", STATES]));
    assert_eq!(commands.len(), states.len());
    for (command, state) in commands.iter().zip(&states) {
        assert_eq!(command["header.number"], state["header.number"]);
        for (name, field) in [("reference", "reference"), ("error", "error"), ("output", "command")] {
            assert_eq!(state[&format!("bucket.{name}")], command[&format!("bucket.{field}")]);
        }
    }
    let positions: BTreeMap<&str, &str> = rows.iter().map(|row| (&*row["tick"], &*row["boom.position"])).collect();
    let measured = states.iter().filter(|state| state["boom.feedback"] != "NaN");
    let known = measured.inspect(|state| assert_eq!(state["boom.feedback"], positions[&*state["header.sequence"]]));
    assert!(known.count() + 10 > states.len());
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
    assert_eq!(info["attached"], serde_json::json!(["machine.toml", "settings.json", "latency.hlog"]));
    let channels = info["channels"].as_array().unwrap();
    let names: Vec<&str> = channels.iter().map(|channel| channel["channel"].as_str().unwrap()).collect();
    assert_eq!(names, [&CHANNELS[..3], &[STATES], &CHANNELS[3..]].concat());
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
    expect_states(&file, &rows);
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
    // The kill may have come between a chunk and its length, which is written last.
    let damage = info["damage"].as_str().unwrap();
    let byte: u64 = damage.strip_prefix("byte ").unwrap().split(':').next().unwrap().parse().unwrap();
    assert!(byte <= length && byte > 50_000, "{length}: {damage}");
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
    assert!(refused.contains("clean.mcap: found a file; allowed: a new one"), "{refused}");
    let again = record(&running, &clean).wait_with_output().unwrap();
    let refused = String::from_utf8(again.stderr).unwrap();
    assert!(refused.contains("clean.mcap: found a file; allowed: a new one"), "{refused}");
    running.interrupt();
}

#[test]
fn nothing_is_recovered_from_a_file_without_a_message_that_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let (file, clean) = (folder.path().join("run.mcap"), folder.path().join("clean.mcap"));
    for bytes in [&b""[..], b"\x89MCAP0\r\n", b"\x89MCAP0\r\n\x01\xff\xff\xff"] {
        fs::write(&file, bytes).unwrap();
        let output = hydraxis().arg("recover").arg(&file).arg(&clean).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("run.mcap: found no message that can be read"), "{said}");
        assert!(!clean.exists());
    }
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

/// Starts a run that is recorded into `folder`, and waits until its recorder has attached. The recorder's process id.
fn recorded_run(test: &str, folder: &Path) -> (Running, u32) {
    let running = Running::spawn(test, &["--duration", "60s", "--no-black-box"], &StageKind::ALL, |command| {
        command.env("HYDRAXIS_RECORDINGS", folder);
    });
    let recorder = recorder(&running, 0);
    (running, recorder)
}

/// The process id of the living recorder of a run, which is another one than `before`.
fn recorder(running: &Running, before: u32) -> u32 {
    let group = running.group.join();
    wait_for("the recorder", || {
        let members = group.members();
        let found = members.iter().find(|member| member.name == "record" && member.is_alive && member.pid != before);
        found.map(|member| member.pid)
    })
}

/// Recordings in a folder, the oldest first.
fn recordings(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<_> = fs::read_dir(folder).into_iter().flatten().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn a_run_in_real_time_is_recorded_from_its_first_sample_to_its_last_and_says_where() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let (mut running, recorder) = recorded_run("run-recorded", folder.path());
    let file = wait_for("a recording", || recordings(folder.path()).pop());
    await_growth(&file, 100_000);
    let said = running.interrupt().stderr;
    assert!(!is_running(recorder));
    assert!(said.contains(&format!("record | recording: {}; ", file.display())), "{said}");
    assert!(said.contains(" messages recorded, 0 lost\n"), "{said}");
    assert_eq!(recordings(folder.path()), std::slice::from_ref(&file));
    let bytes = fs::read(&file).unwrap();
    assert!(Summary::read(&bytes).unwrap().is_some());
    let info = info(&file);
    assert_eq!((&info["damage"], &info["facts"]["clock"]), (&Value::Null, &"real time".into()));
    let rows = exported(&file, &["--channel", "encoder-sample"]);
    assert_eq!(rows[0]["header.number"], "0");
    // The last command of the controller, on its way out, is neutral.
    let commands = exported(&file, &["--channel", "valve-command"]);
    assert_eq!(value(commands.last().unwrap(), "boom.command"), 0.0);
    assert_eq!(info["facts"]["seed"], "1");
}

#[test]
fn a_killed_recorder_ends_no_run_and_another_one_goes_on() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let (mut running, first) = recorded_run("run-rec-killed", folder.path());
    let file = wait_for("a recording", || recordings(folder.path()).pop());
    await_growth(&file, 50_000);
    signal(first, Signal::KILL);
    recorder(&running, first);
    let next = wait_for("the next recording", || recordings(folder.path()).pop().filter(|next| *next != file));
    await_growth(&next, 50_000);
    assert!(running.pids.iter().all(|pid| is_running(*pid)));
    let said = running.interrupt().stderr;
    assert_eq!(said.matches("warning: recording: record killed by SIGKILL; starts again").count(), 1, "{said}");
    assert!(info(&file)["damage"].is_string());
    assert_eq!(info(&next)["damage"], Value::Null);
}

#[test]
fn a_killed_supervisor_leaves_a_whole_recording_and_no_recorder() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let (mut running, recorder) = recorded_run("run-sup-killed", folder.path());
    let file = wait_for("a recording", || recordings(folder.path()).pop());
    await_growth(&file, 50_000);
    signal(running.supervisor.id(), Signal::KILL);
    running.supervisor.wait().unwrap();
    wait_for("the end of the recorder", || (!is_running(recorder)).then_some(()));
    assert_eq!(info(&file)["damage"], Value::Null);
}

#[test]
fn a_run_whose_recordings_cannot_be_written_goes_on_with_one_warning() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let mut running = recorded_run("run-no-place", &file).0;
    let said = running.interrupt().stderr;
    // What no file has is lost, and not recorded too.
    assert!(said.contains("recording: no file; 0 messages recorded, ") && !said.contains(" 0 lost"), "{said}");
    assert_eq!(said.matches("nothing is recorded until it can be written again").count(), 1, "{said}");
    let refused = hydraxis().args(["run", "--record"]).arg(&file).output().unwrap();
    assert_eq!(refused.status.code(), Some(1));
    let said = String::from_utf8(refused.stderr).unwrap();
    assert!(said.contains("--record") && said.contains("allowed: a new one"), "{said}");
}

#[test]
fn a_table_is_the_same_in_parquet_with_units_and_facts() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.mcap");
    let group = crate::harness::TestGroup::new("record-parquet");
    let prefix = group.prefix.to_string();
    let run = hydraxis()
        .args(["run", "--duration", "1s", "--no-black-box", "--prefix", &prefix, "--record"])
        .arg(&file)
        .output();
    let said = String::from_utf8(run.unwrap().stderr).unwrap();
    assert!(said.contains(" messages recorded, 0 lost"), "{said}");
    for options in [&[][..], &["--channel", "stage-health"], &["--channel", "encoder-reading", "--every", "3"]] {
        let table = folder.path().join("table.parquet");
        let output = hydraxis().arg("export").arg(&file).arg("--parquet").arg(&table).args(options).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let reader = SerializedFileReader::new(fs::File::open(&table).unwrap()).unwrap();
        let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
        let expected = exported(&file, options);
        assert_eq!(rows.len(), expected.len());
        for (row, expected) in rows.iter().zip(&expected) {
            assert_eq!(row.get_column_iter().count(), expected.len());
            for (name, field) in row.get_column_iter() {
                let text = &expected[name];
                let same = match field {
                    Field::Null => text.is_empty(),
                    Field::Double(value) if name == "t" => (text.parse::<f64>().unwrap() - value).abs() < 1e-9,
                    Field::Double(value) => text.parse::<f64>().unwrap().to_bits() == value.to_bits() || value.is_nan(),
                    Field::ULong(value) => *text == value.to_string(),
                    Field::UInt(value) => *text == value.to_string(),
                    Field::UByte(value) => *text == value.to_string(),
                    Field::Long(value) => *text == value.to_string(),
                    other => panic!("{name}: {other:?}"),
                };
                assert!(same, "{name}: {field:?} and {text}");
            }
        }
        let metadata = reader.metadata().file_metadata().key_value_metadata().unwrap();
        let of = |key: &str| metadata.iter().find(|pair| pair.key == key).unwrap().value.clone().unwrap();
        let units: Value = serde_json::from_str(&of("hydraxis.units")).unwrap();
        assert_eq!((&units["t"], &of("hydraxis.fact.axes")[..]), (&"s".into(), "boom arm telescope bucket"));
        if options.is_empty() {
            assert_eq!((&units["boom.velocity"], &units["arm.error"]), (&"m/s".into(), &"m".into()));
        }
    }
}
