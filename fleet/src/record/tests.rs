//! Recordings of made-up messages, read back with the library.

use std::fs;

use mcap::MessageStream;
use pipeline::{
    cdr,
    message::{EncoderSample, MachineState, Message},
};
use serde_json::{Value, json};

use super::*;
use crate::{content, key, stamp::Stamp};

const SECOND: i64 = 1_000_000_000;
/// When all messages come.
const NOW_NS: i64 = 1_769_854_830_000_000_000;

fn recorder(folder: &std::path::Path, every: Duration) -> Recorder {
    let (folder, stale_after) = (folder.to_owned(), Duration::from_secs(1));
    Recorder::new(Settings { folder, limit: 1 << 30, every, stale_after, site: None }).unwrap()
}

fn received(of: &str, encoding: String, payload: Vec<u8>, number: u64, age_ns: i64) -> Received {
    let stamp = Stamp { run: 7, number, utc_ns: NOW_NS.wrapping_sub(age_ns), clock_error_ns: 0 };
    let key = format!("hydraxis/v1/quarry/ex-07/{of}");
    Received { key, encoding, payload, attachment: stamp.to_bytes().to_vec(), at_ns: NOW_NS }
}

fn message<M: Message>(message: &M, number: u64, age_ns: i64) -> Received {
    let mut payload = Vec::new();
    cdr::encode(message, &mut payload);
    received(&key::telemetry(M::CHANNEL), content::name_of::<M>(), payload, number, age_ns)
}

fn sample(number: u64) -> Received {
    message(&EncoderSample::default(), number, 0)
}

fn state() -> Received {
    let mut state = MachineState::default();
    state.header.axis_count = 2;
    state.axes[0].set_name("boom");
    state.axes[1].set_name("arm");
    message(&state, 0, 0)
}

fn of(messages: impl IntoIterator<Item = Received>) -> Waiting {
    let mut waiting = Waiting::default();
    messages.into_iter().for_each(|received| waiting.push(received));
    waiting
}

fn files(folder: &std::path::Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// Topic, sequence and bytes of each message of a file.
fn read(file: &std::path::Path) -> Vec<(String, u32, Vec<u8>)> {
    let bytes = fs::read(file).unwrap();
    let messages = MessageStream::new(&bytes).unwrap().map(|message| message.unwrap());
    messages.map(|message| (message.channel.topic.clone(), message.sequence, message.data.to_vec())).collect()
}

fn notes(file: &std::path::Path) -> Vec<Value> {
    let notes = read(file).into_iter().filter(|(topic, ..)| topic == file::RECORDER);
    notes.map(|(.., bytes)| serde_json::from_slice(&bytes).unwrap()).collect()
}

#[test]
fn a_file_says_what_came_what_was_late_and_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = recorder(folder.path(), Duration::from_secs(3600));
    let status = received("status", content::name_of_json(content::STATUS), b"{\"a\":1}".to_vec(), 0, 0);
    let foreign = received("status", "application/json".to_owned(), b"{}".to_vec(), 1, 0);
    let late = message(&EncoderSample::default(), 8, 20 * SECOND);
    let mut all = of([state(), status, sample(3), sample(3), foreign, sample(7), late]);
    all.machines.values_mut().for_each(|post| post.dropped = 2);
    recorder.step(all, Instant::now());
    let totals = recorder.finish(Waiting::default());
    assert_eq!((totals.messages, totals.dropped, totals.unwritten, totals.strangers), (5, 2, 0, 0));

    let [file] = &files(folder.path())[..] else { panic!("one file") };
    assert!(file.extension().unwrap() == "mcap" && file.to_str().unwrap().contains("/quarry-ex-07-20"), "{file:?}");
    let topics: Vec<(String, u32)> = read(file).into_iter().map(|(topic, number, _)| (topic, number)).collect();
    let expected = [
        ("recorder", 0),
        ("telemetry/machine-state", 0),
        ("status", 0),
        ("telemetry/encoder-sample", 3),
        ("recorder", 0),
        ("telemetry/encoder-sample", 7),
        ("late/telemetry/encoder-sample", 8),
        ("recorder", 0),
        ("recorder", 0),
    ];
    assert_eq!(topics, expected.map(|(topic, number)| (topic.to_owned(), number)));
    let expected = [
        json!({ "what": "run", "run": 7 }),
        json!({ "what": "gap", "key": "telemetry/encoder-sample", "run": 7, "first": 4, "last": 6 }),
        json!({ "what": "refused", "unknown": 1, "malformed": 0, "repeated": 1 }),
        json!({ "what": "dropped", "count": 2 }),
    ];
    assert_eq!(notes(file), expected);
    let bytes = fs::read(file).unwrap();
    let late = MessageStream::new(&bytes).unwrap().map(|message| message.unwrap()).nth(6).unwrap();
    assert_eq!((late.log_time, late.publish_time), (NOW_NS as u64, (NOW_NS - 20 * SECOND) as u64));
    let schema = late.channel.schema.as_ref().unwrap();
    assert_eq!((&*schema.name, &*schema.encoding), ("hydraxis/msg/EncoderSample", "ros2msg"));
    assert_eq!(schema.data, cdr::schema::<EncoderSample>().into_bytes());
    assert_eq!(facts(&bytes, "hydraxis")["axes"], "boom arm");
    assert_eq!(facts(&bytes, "hydraxis.end")["telemetry/encoder-sample lost"], "3");
}

/// All facts of the records with this name.
fn facts(bytes: &[u8], name: &str) -> Facts {
    let records = mcap::read::LinearReader::new(bytes).unwrap().map(|record| record.unwrap());
    let of = |record| match record {
        mcap::records::Record::Metadata(found) if found.name == name => Some(found.metadata),
        _ => None,
    };
    records.filter_map(of).flatten().collect()
}

#[test]
fn a_file_ends_after_its_time_and_the_next_one_is_as_whole() {
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = recorder(folder.path(), Duration::from_secs(60));
    let begun = Instant::now();
    recorder.step(of([state(), sample(0)]), begun);
    recorder.step(of([sample(1)]), begun + Duration::from_secs(1));
    assert!(files(folder.path())[0].to_str().unwrap().ends_with(".mcap.part"));
    // It ends also when the machine is silent.
    recorder.step(Waiting::default(), begun + Duration::from_secs(61));
    assert!(files(folder.path())[0].to_str().unwrap().ends_with(".mcap"));
    recorder.step(of([sample(2)]), begun + Duration::from_secs(70));
    recorder.finish(Waiting::default());
    let files = files(folder.path());
    assert_eq!(files.iter().map(|file| read(file).len()).collect::<Vec<_>>(), [4, 2]);
    assert_eq!(notes(&files[1]), [json!({ "what": "run", "run": 7 })]);
    assert_eq!(facts(&fs::read(&files[1]).unwrap(), "hydraxis")["axes"], "boom arm");
}

#[test]
fn the_first_file_waits_for_the_names_of_the_axes_but_not_for_ever() {
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = recorder(folder.path(), Duration::from_secs(60));
    let begun = Instant::now();
    recorder.step(of([sample(0)]), begun);
    recorder.step(Waiting::default(), begun + Duration::from_secs(1));
    assert!(files(folder.path()).is_empty());
    recorder.step(Waiting::default(), begun + Duration::from_secs(4));
    assert_eq!(files(folder.path()).len(), 1);
    assert_eq!(recorder.finish(Waiting::default()).messages, 1);
}

#[test]
fn what_the_disk_does_not_take_is_counted_in_the_next_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("site");
    let mut recorder = recorder(&path, Duration::from_secs(3600));
    let begun = Instant::now();
    let after = |seconds| begun + Duration::from_secs(seconds);
    recorder.step(of([state(), sample(0)]), begun);
    // As a disk that is taken out: the file is gone, and a new one cannot be made.
    fs::rename(&path, folder.path().join("gone")).unwrap();
    recorder.step(of([sample(1)]), after(1));
    recorder.step(of([sample(2), sample(3)]), after(2));
    recorder.step(of([sample(5)]), after(7));
    fs::create_dir(&path).unwrap();
    recorder.step(of([sample(6)]), after(8));
    assert!(files(&path).is_empty(), "it is tried again every 5 s");
    recorder.step(of([sample(7)]), after(13));
    let totals = recorder.finish(Waiting::default());
    assert_eq!((totals.messages, totals.unwritten), (3, 5));
    let [file] = &files(&path)[..] else { panic!("one file") };
    assert_eq!(notes(file), [json!({ "what": "unwritten", "count": 5 }), json!({ "what": "run", "run": 7 })]);
    assert_eq!(facts(&fs::read(file).unwrap(), "hydraxis.end")["telemetry/encoder-sample lost"], "1");
}

#[test]
fn payloads_that_nobody_sends_in_earnest_are_recorded_or_refused_and_nothing_more() {
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = recorder(folder.path(), Duration::from_secs(3600));
    let json = |of: &str, number, payload: &[u8], age_ns| {
        let name = if of == "events" { content::EVENT } else { content::STATUS };
        received(of, content::name_of_json(name), payload.to_vec(), number, age_ns)
    };
    let deep = "[".repeat(60_000);
    let mut short = sample(0);
    short.attachment.truncate(5);
    let mut all = of([
        json("status", 0, deep.as_bytes(), 0),
        json("status", 1, b"[]", 0),
        json("events", 0, b"7", i64::MIN),
        json("telemetry/status", u64::MAX, b"{}", i64::MAX),
        short,
    ]);
    (0..1000).for_each(|i| {
        let key = format!("hydraxis/v1/quarry/m-{i}/telemetry/nothing");
        all.push(Received { key, ..sample(0) });
    });
    recorder.step(all, Instant::now());
    // Every message another run.
    let runs = (0..3000).map(|run| {
        let stamp = Stamp { run, number: u64::MAX, utc_ns: NOW_NS, clock_error_ns: 0 };
        Received { attachment: stamp.to_bytes().to_vec(), ..sample(0) }
    });
    recorder.step(of(runs), Instant::now());
    assert_eq!((recorder.tracks.len(), recorder.fleet.machines().len()), (1, 1));
    let totals = recorder.finish(Waiting::default());
    assert_eq!((totals.messages, totals.unwritten), (3003, 0));
    let [file] = &files(folder.path())[..] else { panic!("one file") };
    assert_eq!(read(file).len(), 3003 + 3002, "each run has its note");
}

#[test]
fn more_machines_than_a_site_has_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let mut recorder = recorder(folder.path(), Duration::from_secs(3600));
    for begin in [0, 200] {
        let machines = (begin..begin + 200).map(|i| {
            let key = format!("hydraxis/v1/quarry/m-{i}/telemetry/encoder-sample");
            Received { key, ..sample(0) }
        });
        recorder.step(of(machines), Instant::now());
    }
    let totals = recorder.finish(Waiting::default());
    assert_eq!((totals.messages, totals.strangers), (MOST_MACHINES as u64, 400 - MOST_MACHINES as u64));
    assert_eq!(files(folder.path()).len(), MOST_MACHINES);
}
