//! Recordings of runs in lock-step made again, bit for bit, and recordings with another estimator beside what was.

use std::{
    collections::{BTreeMap, HashMap},
    fs::{self, File},
    io::BufWriter,
    path::{Path, PathBuf},
    process::{Output, Stdio},
};

use mcap::{
    Attachment, WriteOptions, Writer,
    read::ChunkFlattener,
    records::{MessageHeader, Record},
};
use pipeline::{
    channel::{Board, Group, Publisher, Reader},
    message::{AxisMode, EncoderSample, Reference, Request, ValveCommand, command_event, control_flag},
    stage::StageKind,
};
use serde_json::Value;

use crate::harness::{
    Dice, FOUR_AXES,
    channel::{AXES, send},
    hydraxis, report,
    running::Running,
    shared, succeed, variable,
};

/// Channels that are computed again.
const COMPUTED: [&str; 5] =
    ["encoder-reading", "encoder-sample", "coefficient-snapshot", "valve-command", "machine-state"];
/// Channels of which only the checksums are compared.
const CHECKED: [&str; 4] = ["reference", "request", "stage-health", "controller-state"];
/// Axes of the built-in machines.
const AXIS_NAMES: [&str; AXES] = ["boom", "arm", "telescope", "bucket"];
/// Bytes of CDR before the first field.
const ENCAPSULATION: usize = 4;
/// Ticks between two stops: a model has taken over before.
const STOPS_APART: u64 = 900;

fn replay(file: &Path, options: &[&str]) -> Output {
    hydraxis().arg("replay").arg(file).args(options).output().unwrap()
}

/// The report of `--verify`; its exit code must tell the same.
fn verify(file: &Path) -> Value {
    let output = replay(file, &["--verify", "--json", "-"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {said}"));
    let is_identical = report["identical"].as_bool().unwrap();
    assert_eq!(output.status.code(), Some(i32::from(!is_identical)), "{said}");
    report
}

/// A recording of a run in lock-step with these arguments.
fn recorded(folder: &Path, arguments: &[&str]) -> PathBuf {
    let file = folder.join("run.mcap");
    report(&[&["run", "--lockstep", "--record", file.to_str().unwrap()], arguments].concat());
    file
}

/// The rows of a table, by the names of their columns.
fn rows(output: &Output) -> Vec<BTreeMap<String, String>> {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    csv::Reader::from_reader(&*output.stdout).deserialize().map(Result::unwrap).collect()
}

/// Operates a group in lock-step: it arms and releases, holds and tracks, sends references and stops.
struct Operator {
    samples: Reader<EncoderSample>,
    commands: Reader<ValveCommand>,
    requests: Publisher<Request>,
    references: Publisher<Reference>,
    board: Board,
    enable: u32,
    stops: u32,
    /// Tick of the last stop.
    stopped: u64,
    /// Mode that is asked for.
    mode: AxisMode,
    // After its readers and publishers.
    _channels: Group,
}

impl Operator {
    fn new(running: &Running) -> Self {
        let channels = running.group.join();
        Self {
            samples: channels.reader().unwrap(),
            commands: channels.reader().unwrap(),
            requests: channels.publisher().unwrap(),
            references: channels.publisher().unwrap(),
            board: Board::find(&running.group.prefix).unwrap().unwrap(),
            enable: 0,
            stops: 0,
            stopped: 0,
            mode: AxisMode::Track,
            _channels: channels,
        }
    }

    /// Answers the newest sample, if one has come.
    fn step(&mut self, dice: &mut Dice) {
        if self.samples.newest().unwrap().if_new().is_none() {
            return;
        }
        let Some(sample) = self.samples.last().copied() else { return };
        self.commands.newest().unwrap();
        let last = self.commands.last().copied().unwrap_or_default();
        let is_latched = last.axes[..AXES].iter().any(|axis| axis.flags & control_flag::LATCHED != 0);
        self.enable += u32::from(last.axes[0].operation == AxisMode::Off as u32 && dice.once_in(5));
        let modes = [AxisMode::Track, AxisMode::Track, AxisMode::Track, AxisMode::Hold, AxisMode::Unchanged];
        if dice.once_in(300) {
            self.mode = dice.one_of(&modes);
        }
        let mode = if is_latched && dice.once_in(2) { AxisMode::Off } else { self.mode };
        let mut request = Request { session: 7, ..Request::default() };
        for axis in &mut request.axes[..AXES] {
            (axis.mode, axis.enable) = (mode as u32, self.enable);
        }
        // Some make no sense, and are refused.
        request.axes[1].command = if dice.once_in(50) { 3.0 } else { 0.0 };
        request.header.machine = sample.header.machine;
        send(&self.requests, request, sample.header.sequence);
        let mut reference = Reference { preview: 1, ..Reference::default() };
        reference.header.machine = sample.header.machine;
        reference.positions.iter_mut().zip(&sample.axes).for_each(|(positions, axis)| positions[0] = axis.position);
        send(&self.references, reference, sample.header.sequence);
        if sample.header.sequence > self.stopped + STOPS_APART {
            (self.stopped, self.stops) = (sample.header.sequence, self.stops + 1);
            let board = &self.board;
            if self.stops.is_multiple_of(3) {
                board.emergency_stop()
            } else {
                board.stop([self.stops as usize % AXES])
            };
        }
    }
}

/// Records the four axes with all that can come to a controller, and with everything that a scenario changes.
fn operated(folder: &Path, test: &str, duration: &str) -> PathBuf {
    let file = folder.join("run.mcap");
    let run = ["--lockstep", "--duration", duration, "--seed", "11", "--scenario", "everything", "--off"];
    let set = ["--set", "axis.arm.reference.kind=channel", "--record", file.to_str().unwrap()];
    let mut running = Running::spawn(test, &[&run[..], &set].concat(), &[StageKind::ControlProc], |_| ());
    let mut operator = Operator::new(&running);
    let mut dice = Dice::new("replay", "HYDRAXIS_REPLAY_SEED", "");
    while running.supervisor.try_wait().unwrap().is_none() {
        operator.step(&mut dice);
    }
    drop(operator);
    running.expect_orderly_end();
    file
}

#[test]
fn a_run_with_requests_references_stops_and_faults_is_made_again_bit_for_bit() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = operated(folder.path(), "replay", "60s");
    let export = hydraxis().arg("export").arg(&file).args(["--channel", "valve-command", "--csv", "-"]).output();
    let commands = rows(&export.unwrap());
    let number = |row: &BTreeMap<String, String>, column: &str| row[column].parse::<f64>().unwrap();
    let last = commands.last().unwrap();
    let counts = ["boom.taken_requests", "arm.refused_requests", "boom.latches", "inputs.reference_number"]
        .map(|column| number(last, column));
    println!("requests taken, refused, latches, references: {counts:?}");
    assert!(counts.iter().zip([50.0, 1.0, 1.0, 100.0]).all(|(count, least)| *count >= least), "{counts:?}");
    let has = |event: u32| commands.iter().any(|row| number(row, "inputs.events") as u32 & event != 0);
    assert!(has(command_event::STOPPED) && has(command_event::EMERGENCY_STOP) && has(command_event::NEUTRAL));
    let modes = |mode: f64| commands.iter().filter(|row| number(row, "telescope.mode") == mode).count();
    println!("commands of the telescope: {} neutral, {} fallback, {} model", modes(0.0), modes(1.0), modes(2.0));
    assert!(modes(1.0) > 0 && modes(2.0) > 0, "the model took over");
    let report = verify(&file);
    assert_eq!(
        (&report["identical"], &report["ticks"], &report["lost"]),
        (&true.into(), &6000.into(), &0.into()),
        "{report}"
    );
}

/// All records of a recording.
struct Copied {
    records: Vec<Record<'static>>,
    topics: HashMap<u16, String>,
    /// Indices of the messages of each channel, without those that have none.
    messages: Vec<Vec<usize>>,
}

impl Copied {
    fn read(file: &Path) -> Self {
        let bytes = fs::read(file).unwrap();
        let records: Vec<_> = ChunkFlattener::new(&bytes).unwrap().map(|record| record.unwrap().into_owned()).collect();
        let mut topics = HashMap::new();
        let channels = [&COMPUTED[..], &CHECKED].concat();
        let mut messages = vec![Vec::new(); channels.len()];
        for (i, record) in records.iter().enumerate() {
            match record {
                Record::Channel(channel) => drop(topics.insert(channel.id, channel.topic.clone())),
                Record::Message { header, .. } => {
                    let topic = &topics[&header.channel_id];
                    messages[channels.iter().position(|name| name == topic).expect("a channel")].push(i);
                }
                _ => {}
            }
        }
        messages.retain(|of_channel| !of_channel.is_empty());
        Self { records, topics, messages }
    }

    /// Writes the recording with one bit of one message flipped.
    fn write_flipped(&self, file: &Path, message: usize, bit: usize) {
        self.write(file, |i, _, data| {
            if i == message {
                data[bit / 8] ^= 1 << (bit % 8);
            }
            1
        });
    }

    /// Writes the recording. `change` gets index, channel and bytes of each message; it says how often it is written.
    fn write(&self, file: &Path, change: impl Fn(usize, &str, &mut [u8]) -> usize) {
        let options = WriteOptions::new().compression(None).compression_threads(0).profile("ros2");
        let mut writer: Writer<_> = options.create(BufWriter::new(File::create(file).unwrap())).unwrap();
        let (mut schemas, mut channels) = (HashMap::new(), HashMap::new());
        for (i, record) in self.records.iter().enumerate() {
            match record {
                Record::Schema { header, data } => {
                    let schema = writer.add_schema(&header.name, &header.encoding, data).unwrap();
                    schemas.insert(header.id, schema);
                }
                Record::Channel(channel) if !channels.contains_key(&channel.id) => {
                    let (schema, none) = (schemas[&channel.schema_id], BTreeMap::new());
                    let added = writer.add_channel(schema, &channel.topic, &channel.message_encoding, &none).unwrap();
                    channels.insert(channel.id, added);
                }
                Record::Message { header, data } => {
                    let mut data = data.to_vec();
                    let times = change(i, &self.topics[&header.channel_id], &mut data);
                    let header = MessageHeader { channel_id: channels[&header.channel_id], ..*header };
                    (0..times).for_each(|_| writer.write_to_known_channel(&header, &data).unwrap());
                }
                Record::Metadata(metadata) => writer.write_metadata(metadata).unwrap(),
                Record::Attachment { header, data, .. } => {
                    let (name, media_type) = (header.name.clone(), header.media_type.clone());
                    let attachment = Attachment { log_time: 0, create_time: 0, name, media_type, data: data.clone() };
                    writer.attach(&attachment).unwrap();
                }
                _ => {}
            }
        }
        writer.finish().unwrap();
    }

    fn data(&self, message: usize) -> (&str, &[u8]) {
        match &self.records[message] {
            Record::Message { header, data } => (&self.topics[&header.channel_id], data),
            other => panic!("{other:?}"),
        }
    }
}

/// Flips random bits, one at a time, and expects that each is found and named.
fn expect_found(file: &Path, flips: u64) {
    let copied = Copied::read(file);
    let folder = tempfile::tempdir().unwrap();
    let flipped = folder.path().join("flipped.mcap");
    let mut dice = Dice::new("flips", "HYDRAXIS_FLIP_SEED", "");
    let mut found: BTreeMap<String, u64> = BTreeMap::new();
    for _ in 0..flips {
        let of_channel = &copied.messages[dice.below(copied.messages.len() as u64) as usize];
        let message = of_channel[dice.below(of_channel.len() as u64) as usize];
        let (channel, data) = copied.data(message);
        let bit = 8 * ENCAPSULATION + dice.below(8 * (data.len() - ENCAPSULATION) as u64) as usize;
        copied.write_flipped(&flipped, message, bit);
        let report = verify(&flipped);
        let place = format!("{channel}, message {message}, byte {}, bit {}: {report}", bit / 8, bit % 8);
        let difference = &report["difference"];
        assert_eq!((&report["identical"], &difference["channel"]), (&false.into(), &channel.into()), "{place}");
        let tick = u64::from_le_bytes(data[ENCAPSULATION..ENCAPSULATION + 8].try_into().unwrap());
        // A state that names another tick is looked at with that tick, and a tick that nothing computes is not known.
        if channel != "machine-state" && !(CHECKED.contains(&channel) && bit / 8 < ENCAPSULATION + 8) {
            assert_eq!(difference["tick"], tick, "{place}");
        }
        assert!(difference["field"].as_str().is_some_and(|field| !field.is_empty()), "{place}");
        assert_ne!(difference["recorded"], difference["replayed"], "{place}");
        *found.entry(channel.to_owned()).or_default() += 1;
    }
    println!("found: {found:?}");
}

#[test]
fn the_table_of_a_run_in_lock_step_has_the_time_of_the_machine() {
    let folder = tempfile::tempdir().unwrap();
    let file = recorded(folder.path(), &[FOUR_AXES, "--duration", "2s"]);
    let table = rows(&hydraxis().arg("export").arg(&file).args(["--csv", "-"]).output().unwrap());
    assert_eq!(table.len(), 200);
    for (k, row) in table.iter().enumerate() {
        let [t, tick] = ["t", "tick"].map(|column| row[column].parse::<f64>().unwrap());
        assert!((t - 0.01 * k as f64).abs() < 1e-9 && tick == k as f64, "row {k}: {row:?}");
    }
}

#[test]
fn a_table_has_the_axes_that_were_asked_for_and_what_has_none_of_them_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = recorded(folder.path(), &[FOUR_AXES, "--duration", "1s"]);
    let export = |options: &[&str]| hydraxis().arg("export").arg(&file).args(options).output().unwrap();
    for channel in ["controller-state", "valve-command", "encoder-reading"] {
        let table = rows(&export(&["--channel", channel, "--csv", "-", "--axis", "arm", "--from", "0"]));
        let has = |axis: &str| table[0].keys().any(|column| column.starts_with(&format!("{axis}.")));
        assert_eq!(AXIS_NAMES.map(has), [false, true, false, false], "{channel}");
        assert!(table[0].contains_key("header.sequence"), "{channel}");
    }
    let refused = export(&["--channel", "stage-health", "--csv", "-", "--axis", "arm"]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(2), "{said}");
    assert!(said.contains("--axis: found a channel without axes, stage-health; allowed: "), "{said}");
}

#[test]
fn an_export_without_a_row_leaves_the_table_of_before() {
    let folder = tempfile::tempdir().unwrap();
    let file = recorded(folder.path(), &[FOUR_AXES, "--duration", "1s"]);
    let table = folder.path().join("table");
    fs::write(&table, "a table").unwrap();
    for format in ["--csv", "--parquet"] {
        let mut export = hydraxis();
        let output =
            export.arg("export").arg(&file).arg(format).arg(&table).args(["--from", "1000s"]).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(1) && said.contains("found no row"), "{format}: {said}");
        assert_eq!(fs::read_to_string(&table).unwrap(), "a table", "{format}");
    }
}

/// As `head` does.
#[test]
fn a_reader_that_closes_its_end_ends_an_export_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let file = recorded(folder.path(), &[FOUR_AXES, "--duration", "2s"]);
    let mut export = hydraxis();
    export.arg("export").arg(&file).args(["--channel", "valve-command", "--csv", "-"]);
    let mut export = export.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(export.stdout.take());
    let output = export.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && said.is_empty(), "{said}");
}

#[test]
fn a_flipped_bit_is_found_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = recorded(folder.path(), &[FOUR_AXES, "--duration", "2s"]);
    expect_found(&file, variable("HYDRAXIS_FLIPS", 40));
}

/// Minutes.
#[test]
#[ignore = "500 recordings of 60 s"]
fn five_hundred_flipped_bits_in_60_s_are_found_and_named() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    expect_found(&operated(folder.path(), "flips", "60s"), variable("HYDRAXIS_FLIPS", 500));
}

/// A replay keeps messages of a few hundred samples. An encoder can be read many times between two samples, and a table
/// in the place of the plant has no controller whose states could be computed again.
#[test]
fn messages_that_a_replay_does_not_use_need_no_room() {
    /// Copies of each message: 200 ticks of them are more than a replay keeps of a channel.
    const COPIES: usize = 100;
    let folder = tempfile::tempdir().unwrap();
    let file = recorded(folder.path(), &[FOUR_AXES, "--duration", "2s"]);
    let many = folder.path().join("many.mcap");
    let repeated = |channels: &'static [&str]| {
        move |_: usize, of: &str, _: &mut [u8]| if channels.contains(&of) { COPIES } else { 1 }
    };
    let replayed = |file: &Path| -> Value {
        let output = succeed(&["replay", file.to_str().unwrap(), "--json", "-"]);
        serde_json::from_slice(&output.stdout).unwrap()
    };
    Copied::read(&file).write(&many, repeated(&["encoder-reading", "machine-state"]));
    let report = replayed(&many);
    assert_eq!(report["ticks"], 200);
    assert_eq!(report["axes"], replayed(&file)["axes"]);

    let source = format!("source.file=\"{}\"", file.display());
    let settings = ["--set", "source.kind=\"replay\"", "--set", &source];
    let table = folder.path().join("table");
    fs::create_dir(&table).unwrap();
    let of_table = recorded(&table, &[&[FOUR_AXES], &settings[..]].concat());
    Copied::read(&of_table).write(&many, repeated(&["machine-state"]));
    let report = verify(&many);
    assert_eq!((&report["identical"], &report["ticks"]), (&true.into(), &200.into()), "{report}");
}

#[test]
fn another_estimator_and_controller_are_shown_beside_what_was() {
    let folder = tempfile::tempdir().unwrap();
    let file = recorded(folder.path(), &[FOUR_AXES, "--duration", "12s", "--seed", "3"]);
    let file = file.to_str().unwrap();
    let json = |options: &[&str]| -> Value {
        let output = succeed(&[&["replay", file, "--json", "-"], options].concat());
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let same = json(&[]);
    for axis in same["axes"].as_array().unwrap() {
        assert_eq!((&axis["command"]["ticks"], &axis["command"]["different"]), (&1200.into(), &0.into()), "{axis}");
        for steps in ["one_step", "h_step"] {
            assert!(axis[steps]["ticks"].as_u64().unwrap() > 300, "{axis}");
            assert_eq!(axis[steps]["was_rms"], axis[steps]["now_rms"], "{axis}");
        }
    }
    let other = json(&["--set", "axis.boom.identification.estimator=constant:0.98", "--set", "axis.arm.control.kp=1"]);
    let axes = other["axes"].as_array().unwrap();
    assert_eq!(axes[0]["axis"], "boom");
    assert_ne!(axes[0]["h_step"]["was_rms"], axes[0]["h_step"]["now_rms"], "{}", axes[0]);
    assert_eq!(axes[0]["h_step"]["was_rms"], same["axes"][0]["h_step"]["was_rms"], "what was stays");
    // Another model commands otherwise; another gain of the fallback changes nothing that is predicted.
    assert!(axes[0]["command"]["different"].as_u64().unwrap() > 100, "{}", axes[0]);
    assert_eq!(axes[1]["h_step"], same["axes"][1]["h_step"]);
    assert!(axes[1]["command"]["max"].as_f64().unwrap() > 0.01, "{}", axes[1]);
    assert_eq!(axes[2], same["axes"][2]);

    let table = rows(&replay(Path::new(file), &["--csv", "-", "--set", "axis.arm.control.kp=1"]));
    assert_eq!(table.len(), 1200);
    let difference = |row: &BTreeMap<String, String>| {
        let number = |column: &str| row[column].parse::<f64>().unwrap();
        (number("arm.command_now") - number("arm.command_was")).abs()
    };
    let largest = table.iter().map(difference).fold(0.0, f64::max);
    assert_eq!(largest, axes[1]["command"]["max"].as_f64().unwrap());
}

/// The commands of a recording without times, sessions and numbers of programs.
fn commands(file: &Path) -> Vec<BTreeMap<String, String>> {
    let export = hydraxis().arg("export").arg(file).args(["--channel", "valve-command", "--csv", "-"]).output();
    let is_of_run = |name: &str| {
        ["_ns", "session", "machine", "operator", "checksum", "log_time"].iter().any(|end| name.ends_with(end))
            || name == "t"
    };
    let rows = rows(&export.unwrap()).into_iter();
    rows.map(|row| row.into_iter().filter(|(name, _)| !is_of_run(name)).collect()).collect()
}

#[test]
fn living_stages_command_the_same_on_a_recording_as_in_the_run() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = recorded(folder.path(), &[FOUR_AXES, "--duration", "15s", "--scenario", "payload", "--seed", "5"]);
    let again = folder.path().join("again.mcap");
    let live = |options: &[&str]| {
        let output = replay(&file, &[&["--live"], options].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    live(&["--lockstep", "--record", again.to_str().unwrap()]);
    let (was, now) = (commands(&file), commands(&again));
    assert_eq!((was.len(), now.len()), (1501, 1501));
    was.iter().zip(&now).enumerate().for_each(|(k, (was, now))| assert_eq!(was, now, "command {k}"));
    assert!(was.iter().any(|row| row["arm.mode"] == "2"), "a model controls");
    // Another estimator of an axis is seen in its commands, and in those of no other axis.
    let other = folder.path().join("other.mcap");
    live(&[
        "--lockstep",
        "--set",
        "axis.arm.identification.estimator=constant:0.99",
        "--record",
        other.to_str().unwrap(),
    ]);
    let other = commands(&other);
    let differ = |column: &str| was.iter().zip(&other).filter(|(was, other)| was[column] != other[column]).count();
    assert!(differ("arm.command") > 100 && differ("boom.command") == 0, "{}", differ("arm.command"));
}

#[test]
fn living_stages_take_the_requests_of_a_recording_in_real_time() {
    let _cores = shared();
    let folder = tempfile::tempdir().unwrap();
    let file = operated(folder.path(), "live", "6s");
    let again = folder.path().join("again.mcap");
    let output = replay(&file, &["--live", "--record", again.to_str().unwrap()]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    let (was, now) = (commands(&file), commands(&again));
    let last = |rows: &[BTreeMap<String, String>], column: &str| rows.last().unwrap()[column].parse::<f64>().unwrap();
    let [was, now] = [&was, &now].map(|rows| last(rows, "inputs.requests"));
    assert!(was > 100.0 && now > 0.9 * was, "{was} {now}: {said}");
    assert!(commands(&again).iter().any(|row| row["arm.operation"] != "0"), "{said}");
}

#[test]
fn trajectories_come_out_of_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let (file, trajectory) = (folder.path().join("run.mcap"), folder.path().join("path.csv"));
    let rows = (0..40).map(|k| format!("{:.1},{:.4}\n", 0.1 * f64::from(k), 0.65 + 0.01 * (0.3 * f64::from(k)).sin()));
    fs::write(&trajectory, format!("t,boom\n{}", rows.collect::<String>())).unwrap();
    let from = format!("axis.boom.reference.file=\"{}\"", trajectory.display());
    let set = ["--set", "axis.boom.reference.kind=trajectory", "--set", &from];
    let run = ["run", "--lockstep", "--duration", "4s", FOUR_AXES, "--record", file.to_str().unwrap()];
    report(&[&run[..], &set].concat());
    fs::remove_file(trajectory).unwrap();
    let report = verify(&file);
    assert_eq!((&report["identical"], &report["ticks"]), (&true.into(), &400.into()), "{report}");
    let info = succeed(&["info", file.to_str().unwrap(), "--json", "-"]);
    assert!(String::from_utf8_lossy(&info.stdout).contains("trajectory-boom.csv"));
}

#[test]
fn what_cannot_be_verified_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let none = folder.path().join("none.csv");
    fs::write(&none, "t,u,y\n0,1,2\n").unwrap();
    let refused = replay(&none, &["--verify"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("found no MCAP file"));
    let file = recorded(folder.path(), &[FOUR_AXES, "--duration", "4s"]);
    let refused = replay(&file, &["--verify", "--set", "axis.boom.control.kp=1"]);
    assert_eq!(refused.status.code(), Some(2));
    let refused = replay(&file, &["--set", "axis.boom.control.gain=1"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("axis.boom.control.gain"));
    // A file that was cut is verified as far as it goes.
    let bytes = fs::read(&file).unwrap();
    let cut = folder.path().join("cut.mcap");
    fs::write(&cut, &bytes[..bytes.len() * 3 / 4]).unwrap();
    let report = verify(&cut);
    assert_eq!(report["identical"], true, "{report}");
    assert!(report["damage"].as_str().unwrap().starts_with("byte "), "{report}");
}

/// Writes samples and commands of a recording as a table, with a time from the ticks.
fn write_table(file: &Path, table: &str) {
    let of = |channel: &str| {
        let output = hydraxis().arg("export").arg(file).args(["--channel", channel, "--csv", "-"]).output();
        rows(&output.unwrap())
    };
    // The last command is the neutral one at the end of the run.
    let (samples, commands) = (of("encoder-sample"), of("valve-command"));
    assert_eq!(samples.len() + 1, commands.len());
    let mut text = "t".to_owned();
    AXIS_NAMES.iter().for_each(|axis| text += &format!(",{axis}.command,{axis}.position"));
    for (k, (sample, command)) in samples.iter().zip(&commands).enumerate() {
        assert_eq!(sample["header.sequence"], command["header.sequence"]);
        text += &format!("\n{:.2}", 0.01 * k as f64);
        for axis in AXIS_NAMES {
            text += &format!(",{},{}", command[&format!("{axis}.command")], sample[&format!("{axis}.position")]);
        }
    }
    fs::write(table, text + "\n").unwrap();
}

#[test]
fn an_axis_of_a_recording_is_identified_and_replayed_as_its_table_is() {
    let folder = tempfile::tempdir().unwrap();
    let file = recorded(folder.path(), &[FOUR_AXES, "--duration", "10s", "--seed", "7"]);
    let (file, table) = (file.to_str().unwrap(), folder.path().join("run.csv"));
    let table = table.to_str().unwrap();
    write_table(Path::new(file), table);
    let identified = |data: &str| -> Value {
        let output = succeed(&["identify", data, "--axis", "boom", "--json", "-"]);
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let (of_recording, of_table) = (identified(file), identified(table));
    assert_eq!(of_recording["rows"], 1000);
    for key in ["classical", "persistence", "structure", "horizon"] {
        assert_eq!(of_recording[key], of_table[key], "{key}");
    }
    let refused = hydraxis().args(["identify", file]).output().unwrap();
    assert_eq!(refused.status.code(), Some(2));
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(said.contains("--axis: found none; allowed: one of boom, arm, telescope, bucket"), "{said}");

    let settings = |data: &str, columns: bool| {
        let mut settings = vec!["source.kind=\"replay\"".to_owned(), format!("source.file=\"{data}\"")];
        for axis in AXIS_NAMES.into_iter().filter(|_| columns) {
            settings.push(format!("axis.{axis}.columns=[\"{axis}.command\", \"{axis}.position\"]"));
        }
        settings
    };
    let replayed = |command: &[&str], data: &str, columns: bool| {
        let settings = settings(data, columns);
        let settings: Vec<&str> = settings.iter().flat_map(|setting| ["--set", setting.as_str()]).collect();
        report(&[command, &[FOUR_AXES], &settings].concat())
    };
    let simulated = replayed(&["simulate"], file, false);
    assert_eq!(simulated["ticks"], 1000);
    assert_eq!(replayed(&["run", "--lockstep"], file, false), simulated);
    assert_eq!(replayed(&["simulate"], table, true)["axes"], simulated["axes"]);
}
