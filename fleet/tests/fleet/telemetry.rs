//! What a bridge publishes is what the group has sent.

use std::{collections::BTreeMap, fs, time::Duration};

use hydraxis_fleet::{content, fleet::Verdict};
use pipeline::{
    cdr,
    channel::Reader,
    message::{AxisMode, CoefficientSnapshot, EncoderSample, Message, ValveCommand},
};
use serde_json::Value;
use zenoh::Wait;

use crate::harness::{Bridge, Group, Router, heard::Heard, wait_for};

const SAMPLES: &str = "telemetry/encoder-sample";

/// Messages of a channel as the group has sent them, by their number.
fn collect<M: Message>(reader: &mut Reader<M>, into: &mut BTreeMap<u64, M>) {
    reader.each(|message| _ = into.insert(message.header().number, *message)).unwrap();
}

/// Expects a payload to be this message, bit for bit; the number of comparisons.
fn expect_bytes<M: Message>(sent: Option<&M>, payload: &[u8]) -> usize {
    let Some(sent) = sent else { return 0 };
    let mut bytes = Vec::new();
    cdr::encode(sent, &mut bytes);
    assert_eq!(bytes, payload, "{sent:?}");
    1
}

#[test]
fn telemetry_is_what_the_group_has_sent_at_the_rate_that_is_set() {
    let router = Router::new();
    let heard = Heard::new(&router.connection());
    let group = Group::run("telemetry", &["--duration", "10min"]);
    let _bridge = Bridge::new(&router.address, &group.prefix, "[rates]\nencoder-sample = 10\n");
    wait_for("samples", || (heard.all().of(SAMPLES).len() > 5).then_some(()));
    let own = pipeline::channel::Group::join(&group.prefix.parse().unwrap(), "test").unwrap();
    let (mut samples, mut commands) = (own.reader::<EncoderSample>().unwrap(), own.reader::<ValveCommand>().unwrap());
    let (mut sent, mut commanded) = (BTreeMap::new(), BTreeMap::new());
    let before = heard.all().of(SAMPLES).len();
    let until = std::time::Instant::now() + Duration::from_secs(5);
    while std::time::Instant::now() < until {
        collect(&mut samples, &mut sent);
        collect(&mut commands, &mut commanded);
        std::thread::sleep(Duration::from_millis(20));
    }
    let all = heard.all();
    let (mut compared, mut compared_commands) = (0, 0);
    for (key, payload) in &all.payloads {
        if key == SAMPLES {
            let sample: EncoderSample = cdr::decode(payload).unwrap();
            // A position of a machine that moves, not a default.
            assert!(sample.axes[0].position > 0.1, "{sample:?}");
            compared += expect_bytes(sent.get(&sample.header.number), payload);
        } else if key == "telemetry/valve-command" {
            let command: ValveCommand = cdr::decode(payload).unwrap();
            compared_commands += expect_bytes(commanded.get(&command.header.number), payload);
        }
    }
    let came = all.of(SAMPLES).len() - before;
    assert!(compared > 20 && compared_commands > 40, "{compared} samples, {compared_commands} commands");
    // 10 a second as set, and 20 as usual, however busy the computer is: never more.
    assert!(came <= 52, "{came} samples in 5 s");
    let counts = all.counts();
    assert_eq!((counts.unknown, counts.malformed, counts.repeated), (0, 0, 0));
    let numbers: Vec<u64> = all.of(SAMPLES).iter().map(|message| message.stamp.number).collect();
    assert!(numbers.is_sorted() && all.machine().unwrap().is_alive);
}

#[test]
fn a_bridge_answers_and_tells_what_happens() {
    let router = Router::new();
    let heard = Heard::new(&router.connection());
    let group = Group::run("answers", &["--off", "--duration", "10min"]);
    let bridge = Bridge::new(&router.address, &group.prefix, "");
    let recording = bridge.folder.path().join("recordings/a.mcap");
    fs::write(&recording, "abc").unwrap();
    let long_ago = std::time::SystemTime::now() - Duration::from_secs(600);
    fs::File::options().write(true).open(&recording).unwrap().set_modified(long_ago).unwrap();

    let ask = |of: &str| {
        let key = format!("hydraxis/v1/quarry/ex-07/{of}");
        let answers = heard.session.get(key).timeout(Duration::from_secs(5)).wait().unwrap();
        let answers = std::iter::from_fn(move || answers.recv().ok());
        answers.filter_map(|answer| answer.into_result().ok()).collect::<Vec<_>>()
    };
    let json = |of: &str, schema: &str| {
        let answer = ask(of).into_iter().next()?;
        Some(content::json(schema, &answer.encoding().to_string(), &answer.payload().to_bytes()).unwrap())
    };
    // A bridge that has only just begun has not heard all stages yet.
    let is_whole = |status: &Value| status["axes"][3] == "bucket" && status["stages"][3].is_object();
    let status = wait_for("axes and stages", || json("status", content::STATUS).filter(is_whole));
    assert_eq!((&status["group"], &status["site"]), (&group.prefix.clone().into(), &"quarry".into()));
    assert_eq!(status["stages"].as_array().unwrap().len(), 4, "{status}");

    let recordings =
        wait_for("the list", || json("recordings", content::RECORDINGS).filter(|list| list[0].is_object()));
    let hash = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
    assert_eq!((&recordings[0]["name"], &recordings[0]["bytes"]), (&"a.mcap".into(), &3.into()));
    assert_eq!(recordings[0]["sha256"], hash);

    let model = wait_for("models", || ask("model").into_iter().next());
    let encoding = model.encoding().to_string();
    let current: CoefficientSnapshot = content::message(&encoding, &model.payload().to_bytes()).unwrap();
    assert_eq!(current.header.axis_count, 4);
    let earlier = wait_for("earlier models", || Some(ask("model/*")).filter(|earlier| !earlier.is_empty()));
    let key = earlier[0].key_expr().as_str().to_owned();
    let again = ask(key.strip_prefix("hydraxis/v1/quarry/ex-07/").unwrap());
    assert_eq!(again.len(), 1, "{key} is one of them");
    assert_eq!(again[0].payload().to_bytes(), earlier[0].payload().to_bytes());

    group.command(&["arm", "--axis", "boom", "--mode", "hold"]);
    let mode = AxisMode::Hold.name();
    let is_told = |event: &serde_json::Value| {
        event["axis"] == "boom" && event["kind"] == "mode" && event["text"] == format!("{mode}, after off")
    };
    wait_for("the event", || {
        let events = json("events", content::EVENT)?;
        events.as_array()?.iter().any(is_told).then_some(())
    });
    let told = wait_for("its message", || Some(heard.all().of("events").to_vec()).filter(|told| told.len() > 1));
    assert!(told.iter().all(|message| message.verdict == Verdict::Fresh), "{told:?}");
}

#[test]
fn a_message_of_another_layout_is_refused_and_counted() {
    let router = Router::new();
    let heard = Heard::new(&router.connection());
    let other = router.connection().open().unwrap();
    let sample = EncoderSample::default();
    let mut payload = Vec::new();
    cdr::encode(&sample, &mut payload);
    let put = |encoding: &str, number: u64| {
        let utc_ns = hydraxis_fleet::kernel::utc_ns();
        let stamp = hydraxis_fleet::stamp::Stamp { run: 1, number, utc_ns, clock_error_ns: 0 };
        let key = format!("hydraxis/v1/quarry/ex-07/{SAMPLES}");
        other.put(key, payload.clone()).encoding(encoding).attachment(&stamp.to_bytes()[..]).wait().unwrap();
    };
    let right = content::name_of::<EncoderSample>();
    wait_for("a message", || {
        put(&right, heard.all().counts().received);
        (heard.all().counts().received > 0).then_some(())
    });
    put(&right.replace("EncoderSample:", "EncoderSample:0"), 1000);
    put("application/cdr", 1001);
    wait_for("both", || (heard.all().counts().unknown == 2).then_some(()));
    let all = heard.all();
    let taken = |number: u64| all.of(SAMPLES).iter().find(|message| message.stamp.number == number).unwrap().verdict;
    assert_eq!((taken(1000), taken(1001)), (Verdict::Unknown, Verdict::Unknown));
    assert!(all.machine().unwrap().stamps[SAMPLES].number < 1000, "what is refused is not the newest");
}
