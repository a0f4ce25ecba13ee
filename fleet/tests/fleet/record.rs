//! What a recorder at the site writes is what was heard, also when it is killed, and what is missing is said.

use std::{
    collections::BTreeMap,
    fs,
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{ChildStderr, Command, Stdio},
    time::Duration,
};

use hydraxis_fleet::{content, kernel::utc_ns, stamp::Stamp};
use mcap::{MessageStream, read::Options};
use pipeline::{cdr, message::EncoderSample};
use serde_json::{Value, json};
use zenoh::Wait;

use crate::harness::{Bridge, Group, Router, Running, fleet, heard::Heard, hydraxis, wait_for};

const SAMPLES: &str = "telemetry/encoder-sample";

/// A recorder of the site of all tests.
struct Recorder {
    process: Running,
    said: BufReader<ChildStderr>,
    folder: tempfile::TempDir,
}

impl Recorder {
    fn new(router: &Router) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (process, said) = started(folder.path(), router);
        let mut recorder = Self { process, said, folder };
        recorder.await_line("records to");
        recorder
    }

    /// Waits until it says this.
    fn await_line(&mut self, what: &str) {
        let mut line = String::new();
        while !line.contains(what) {
            line.clear();
            assert!(self.said.read_line(&mut line).unwrap() > 0, "the recorder has ended");
        }
    }

    /// Ends it in order; what it has said last.
    fn end(&mut self) -> String {
        self.process.end();
        let status = self.process.0.wait().unwrap();
        let said = std::io::read_to_string(&mut self.said).unwrap();
        assert_eq!(status.code(), Some(0), "{said}");
        said
    }

    fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> =
            fs::read_dir(self.folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files
    }
}

fn command(folder: &Path, router: &Router) -> Command {
    let mut command = fleet();
    command.arg("record").arg(folder).args(["--router", &router.address, "--site", "quarry"]);
    command.stderr(Stdio::piped());
    command
}

fn started(folder: &Path, router: &Router) -> (Running, BufReader<ChildStderr>) {
    let mut process = Running(command(folder, router).spawn().unwrap());
    let said = BufReader::new(process.0.stderr.take().unwrap());
    (process, said)
}

/// A message of a file.
#[derive(Debug, Clone)]
struct Read {
    topic: String,
    sequence: u32,
    log_ns: u64,
    publish_ns: u64,
    bytes: Vec<u8>,
}

/// All messages of a file, also of one without an end.
fn read(file: &Path) -> Vec<Read> {
    let bytes = fs::read(file).unwrap();
    let Ok(messages) = MessageStream::new_with_options(&bytes, Options::IgnoreEndMagic.into()) else {
        return Vec::new();
    };
    let one = |message: mcap::Message<'_>| Read {
        topic: message.channel.topic.clone(),
        sequence: message.sequence,
        log_ns: message.log_time,
        publish_ns: message.publish_time,
        bytes: message.data.into_owned(),
    };
    messages.map_while(Result::ok).map(one).collect()
}

fn of<'a>(messages: &'a [Read], topic: &str) -> Vec<&'a Read> {
    messages.iter().filter(|message| message.topic == topic).collect()
}

/// Puts samples of a machine that is made up.
struct Machine {
    session: zenoh::Session,
    run: u64,
}

impl Machine {
    fn new(router: &Router) -> Self {
        Self { session: router.connection().open().unwrap(), run: utc_ns() as u64 }
    }

    fn put(&self, number: u64, age: Duration) {
        let sample = EncoderSample { emergency_stop: number as u32, ..EncoderSample::default() };
        let mut payload = Vec::new();
        cdr::encode(&sample, &mut payload);
        let stamp = Stamp { run: self.run, number, utc_ns: utc_ns() - age.as_nanos() as i64, clock_error_ns: 0 };
        let key = format!("hydraxis/v1/quarry/ex-07/{SAMPLES}");
        let put = self.session.put(key, payload).encoding(content::name_of::<EncoderSample>());
        put.attachment(&stamp.to_bytes()[..]).wait().unwrap();
    }

    /// Puts fresh samples until the recorder has written one. The number of the last one.
    fn put_until_recorded(&self, recorder: &Recorder) -> u64 {
        let mut number = 0;
        wait_for("a recording", || {
            self.put(number, Duration::ZERO);
            number += 1;
            let written = recorder.files().iter().map(|file| read(file).len()).sum::<usize>();
            (written > 0).then_some(number - 1)
        })
    }
}

#[test]
fn a_recording_is_what_another_subscriber_has_heard() {
    let router = Router::new();
    let heard = Heard::new(&router.connection());
    let mut recorder = Recorder::new(&router);
    let group = Group::run("recorded", &["--duration", "10min"]);
    let mut bridge = Bridge::new(&router.address, &group.prefix, "");
    wait_for("samples", || (heard.all().of(SAMPLES).len() > 60).then_some(()));
    wait_for("an event", || (!heard.all().of("events").is_empty()).then_some(()));
    bridge.process.end();
    std::thread::sleep(Duration::from_secs(1));
    let said = recorder.end();

    let files = recorder.files();
    let [file] = &files[..] else { panic!("one closed file: {files:?}; {said}") };
    let name = file.file_name().unwrap().to_str().unwrap();
    assert!(name.starts_with("quarry-ex-07-20") && name.ends_with("Z.mcap"), "{name}");
    let messages = read(file);
    let all = heard.all();
    let mut compared = 0;
    for key in [SAMPLES, "telemetry/valve-command", "telemetry/machine-state", "model", "status", "events"] {
        let mut stamps = BTreeMap::new();
        let payloads = all.payloads.iter().filter(|(of, _)| of == key).map(|(_, payload)| payload);
        for (message, payload) in all.of(key).iter().zip(payloads) {
            stamps.insert(message.stamp.number as u32, (message.stamp.utc_ns as u64, payload));
        }
        // What is late on a busy computer is beside what is fresh.
        let recorded =
            messages.iter().filter(|message| message.topic.strip_prefix("late/").unwrap_or(&message.topic) == key);
        let mut count = 0;
        for message in recorded {
            let (utc_ns, payload) = stamps[&message.sequence];
            assert_eq!((message.publish_ns, &message.bytes), (utc_ns, payload), "{key} {}", message.sequence);
            assert!(message.log_ns >= message.publish_ns || key != SAMPLES, "{message:?}");
            count += 1;
        }
        assert_eq!(count, stamps.len(), "{key}: {said}");
        compared += count;
    }
    assert!(compared > 120, "{compared}");
    // The bridge numbers from 0 on, and nothing was lost on the way.
    assert!(said.contains("0 refused, 0 dropped, 0 unwritten"), "{said}");
    expect_hydraxis_reads(file);
}

/// The program of a machine reads the recording of a site as well.
fn expect_hydraxis_reads(file: &Path) {
    let info = hydraxis().args(["info", "--json", "-"]).arg(file).output().unwrap();
    assert!(info.status.success(), "{}", String::from_utf8_lossy(&info.stderr));
    let info: Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!((&info["facts"]["machine"], &info["damage"]), (&"ex-07".into(), &Value::Null));
    let channels = info["channels"].as_array().unwrap();
    assert!(channels.iter().any(|channel| channel["channel"] == SAMPLES), "{info}");
    let export =
        hydraxis().arg("export").arg(file).args(["--csv", "-", "--channel", "encoder-sample"]).output().unwrap();
    assert!(export.status.success(), "{}", String::from_utf8_lossy(&export.stderr));
    let table = String::from_utf8(export.stdout).unwrap();
    assert!(table.lines().count() > 50 && table.lines().next().unwrap().contains("bucket.position"), "{table}");
}

#[test]
fn a_killed_recorder_leaves_what_it_has_written_and_the_next_one_closes_it() {
    let router = Router::new();
    let mut recorder = Recorder::new(&router);
    let machine = Machine::new(&router);
    machine.put_until_recorded(&recorder);
    // A second recorder would remove files of the first.
    let other = command(recorder.folder.path(), &router).output().unwrap();
    let said = String::from_utf8(other.stderr).unwrap();
    assert!(other.status.code() == Some(2) && said.contains("another recorder writes to it"), "{said}");
    recorder.process.0.kill().unwrap();
    recorder.process.0.wait().unwrap();
    let [left] = &recorder.files()[..] else { panic!("one file") };
    assert!(left.to_str().unwrap().ends_with(".mcap.part"), "{left:?}");
    let before = read(left).len();
    assert!(before > 1);

    (recorder.process, recorder.said) = started(recorder.folder.path(), &router);
    recorder.await_line("was left open, and has no end");
    recorder.end();
    assert_eq!(recorder.files(), [left.with_extension("")]);
    assert_eq!(read(&recorder.files()[0]).len(), before);
}

#[test]
fn what_is_late_lost_or_refused_is_said_in_the_file() {
    let router = Router::new();
    let mut recorder = Recorder::new(&router);
    let machine = Machine::new(&router);
    let last = machine.put_until_recorded(&recorder);
    machine.put(last + 1, Duration::ZERO);
    machine.put(last + 11, Duration::ZERO);
    machine.put(last + 11, Duration::ZERO);
    machine.put(last + 12, Duration::from_secs(20));
    let key = format!("hydraxis/v1/quarry/ex-07/{SAMPLES}");
    machine.session.put(&key, "foreign").encoding("application/cdr").wait().unwrap();
    // Longer than any message: it is refused without its bytes.
    let json = content::name_of_json(content::STATUS);
    machine.session.put(key.replace(SAMPLES, "status"), vec![b' '; 1 << 20]).encoding(json).wait().unwrap();
    let is_noted = |messages: &[Read]| {
        let notes = of(messages, "recorder").into_iter();
        let notes: Vec<Value> = notes.map(|note| serde_json::from_slice(&note.bytes).unwrap()).collect();
        let count = |what: &str, cause: &str| -> u64 {
            notes.iter().filter(|note| note["what"] == what).filter_map(|note| note[cause].as_u64()).sum()
        };
        let refused = ["unknown", "malformed", "repeated"].map(|cause| count("refused", cause));
        (refused == [1, 1, 1]).then_some(notes)
    };
    let notes =
        wait_for("the notes", || is_noted(&recorder.files().iter().flat_map(|file| read(file)).collect::<Vec<_>>()));
    let gap = json!({ "what": "gap", "key": SAMPLES, "run": machine.run, "first": last + 2, "last": last + 10 });
    assert!(notes.contains(&gap) && notes[0] == json!({ "what": "run", "run": machine.run }), "{notes:?}");
    let said = recorder.end();
    assert!(said.contains("9 lost, 1 late, 3 refused, 0 dropped, 0 unwritten, 0 of no machine"), "{said}");
    let messages = read(&recorder.files()[0]);
    let late = of(&messages, "late/telemetry/encoder-sample");
    assert_eq!(late.iter().map(|message| u64::from(message.sequence)).collect::<Vec<_>>(), [last + 12]);
    let fresh = of(&messages, SAMPLES);
    assert_eq!(fresh.last().map(|message| u64::from(message.sequence)), Some(last + 11));
    assert!(fresh.iter().all(|message| message.log_ns - message.publish_ns <= 1_000_000_000));
}

#[test]
fn the_oldest_recordings_make_room_for_new_ones() {
    let router = Router::new();
    let folder = tempfile::tempdir().unwrap();
    let old = |name: &str, bytes: u64| {
        let path = folder.path().join(name);
        fs::File::create(&path).unwrap().set_len(bytes).unwrap();
        path
    };
    let oldest = old("quarry-ex-08-2026-01-31T10-20-30.125Z.mcap", 60_000_000);
    let younger = old("quarry-ex-07-2026-01-31T11-20-30.125Z.mcap", 60_000_000);
    let foreign = old("record-2026-01-31T10-20-30.125Z-demo.mcap", 60_000_000);
    let _process = Running(command(folder.path(), &router).args(["--limit", "100MB"]).spawn().unwrap());
    wait_for("room", || (!oldest.exists()).then_some(()));
    assert!(younger.exists() && foreign.exists());
}

#[test]
fn a_folder_that_cannot_be_written_is_said_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let router = Router::new();
    let done = command(&file, &router).output().unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    assert!(done.status.code() == Some(2) && said.contains(file.to_str().unwrap()), "{said}");
    for wrong in ["1MB", "10", "1e30GB", "NaNGB"] {
        let done = fleet().args(["record", "x", "--router", &router.address, "--limit", wrong]).output().unwrap();
        let said = String::from_utf8(done.stderr).unwrap();
        assert!(done.status.code() == Some(2) && said.contains("100MB or more"), "{said}");
    }
}
