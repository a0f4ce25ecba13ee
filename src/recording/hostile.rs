//! Files that are cut, changed, or made to harm: each is read as far as it goes, or refused with its place. None ends
//! the program or takes much memory.

use std::{
    collections::BTreeMap,
    io::{Cursor, Seek, Write},
    path::Path,
};

use mcap::{
    Attachment, Compression, WriteOptions, Writer,
    records::{MessageHeader, Metadata},
};
use pipeline::message::{CoefficientSnapshot, EncoderReading, EncoderSample, Message};
use rand_pcg::{
    Pcg64Mcg,
    rand_core::{Rng, SeedableRng},
};

use super::{
    Facts, cdr,
    file::{Encoded, RecordingFile},
    reading::{Reading, ReadingError},
};

/// Length up to which the file is cut.
const CUT: usize = 64 << 10;
/// Messages of the recording.
const MESSAGES: u64 = 600;
/// Number of files with changed bits.
const FLIPS: usize = 3000;

/// A recording of some chunks, with facts, attached files and an end.
fn recording() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let facts: Facts = [("axes", "boom arm"), ("group", "t")].map(|(name, fact)| (name.into(), fact.into())).into();
    let attached = [("machine.toml".to_owned(), b"name = \"t\"\n".repeat(50))];
    let mut file = RecordingFile::create(&path, &facts, &attached, 1_000).unwrap();
    file.add_channel::<EncoderReading>().unwrap();
    file.add_channel::<EncoderSample>().unwrap();
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut noise = || (random.next_u64() >> 11) as f64;
    for number in 0..MESSAGES / 2 {
        let mut sample = EncoderSample::default();
        (sample.header.number, sample.header.sequence) = (number, number);
        for axis in &mut sample.axes {
            (axis.position, axis.velocity) = (noise(), noise());
            (axis.piston_pressure, axis.rod_pressure) = (noise(), noise());
        }
        file.write(&Encoded::new(number, &sample)).unwrap();
        file.write(&Encoded::new(number, &EncoderReading::default())).unwrap();
        if number % 25 == 0 {
            file.flush().unwrap();
        }
    }
    file.finish(&[("encoder-sample lost".to_owned(), "0".to_owned())].into()).unwrap();
    std::fs::read(&path).unwrap()
}

/// What a file was found to hold: messages, and whether it was read to its end.
fn read(bytes: Vec<u8>) -> Result<(usize, bool), ReadingError> {
    let length = bytes.len() as u64;
    let mut reading = Reading::of(Path::new("hostile.mcap"), Cursor::new(bytes));
    let mut messages = 0;
    while let Some(message) = reading.next()? {
        messages += 1;
        message.channel.columns.last().map(|column| column.value(&message.bytes));
    }
    if let Some(damage) = reading.damage() {
        assert!(damage.byte <= length && !damage.what.is_empty(), "{damage:?}");
    }
    Ok((messages, reading.damage().is_none()))
}

/// Expects a refusal or a damage, and a place in what is said about it.
fn expect_place(bytes: Vec<u8>) -> String {
    let mut reading = Reading::of(Path::new("hostile.mcap"), Cursor::new(bytes));
    loop {
        match reading.next() {
            Ok(Some(_)) => {}
            Ok(None) => {
                let damage = reading.damage().expect("a damage");
                return format!("byte {}: {}", damage.byte, damage.what);
            }
            Err(error) => {
                let said = error.to_string();
                assert!(said.starts_with("hostile.mcap: "), "{said}");
                return said;
            }
        }
    }
}

#[test]
fn a_file_that_is_cut_anywhere_is_read_up_to_there() {
    let whole = recording();
    assert!(whole.len() > CUT, "{}", whole.len());
    assert_eq!(read(whole.clone()).unwrap(), (MESSAGES as usize, true));
    let mut before = 0;
    // The later ones take long, and are places of records that come again and again.
    for length in (0..CUT / 4).chain((CUT / 4..CUT).step_by(3)) {
        match read(whole[..length].to_vec()) {
            Ok((messages, is_whole)) => {
                assert!(!is_whole && messages >= before, "{length}: {messages} after {before}");
                before = messages;
            }
            // Without its first bytes it could be any file.
            Err(error) => assert!(matches!(error, ReadingError::Foreign(_)) && length < 9, "{length}: {error}"),
        }
    }
    assert!(before > 100);
}

#[test]
fn flipped_bits_are_found_or_harmless() {
    let whole = recording();
    let mut random = Pcg64Mcg::seed_from_u64(2);
    let mut damaged = 0;
    for _ in 0..FLIPS {
        let mut bytes = whole.clone();
        for _ in 0..1 + random.next_u64() % 3 {
            let bit = random.next_u64() as usize % (8 * bytes.len());
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        match read(bytes) {
            Ok((messages, is_whole)) => {
                assert!(messages <= MESSAGES as usize);
                damaged += usize::from(!is_whole);
            }
            // A flip in the first bytes, in a schema or in an encoding.
            Err(error) => assert!(error.to_string().starts_with("hostile.mcap: "), "{error}"),
        }
    }
    assert!(damaged > FLIPS / 2, "{damaged}");
}

type Made = Writer<Cursor<Vec<u8>>>;

/// A file that another program could have made.
fn made(chunk: Option<u64>, make: impl FnOnce(&mut Made)) -> Vec<u8> {
    let options = WriteOptions::new().compression(Some(Compression::Zstd)).compression_threads(0).chunk_size(chunk);
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    make(&mut writer);
    writer.finish().unwrap();
    let mut cursor = writer.into_inner();
    cursor.flush().unwrap();
    cursor.rewind().unwrap();
    cursor.into_inner()
}

fn channel(writer: &mut Made, schema: &str, encodings: [&str; 2], topic: &str) -> u16 {
    let schema = writer.add_schema(topic, encodings[0], schema.as_bytes()).unwrap();
    writer.add_channel(schema, topic, encodings[1], &BTreeMap::new()).unwrap()
}

const ROS: [&str; 2] = ["ros2msg", "cdr"];

#[test]
fn files_of_other_programs_are_refused_with_their_channel() {
    for (schema, encodings, expected) in [
        ("{}", ["ros2msg", "json"], "found the encoding \"ros2msg\""),
        ("{}", ["jsonschema", "cdr"], "found the encoding \"jsonschema\""),
        ("uint8 a\n", ["ros1msg", "ros1"], "found the encoding \"ros1\""),
        ("uint8 a\n", ["ros2idl", "cdr"], "found the encoding \"ros2idl\""),
        ("string data\n", ROS, "schema: found the type \"string\""),
        ("uint8[] data\n", ROS, "schema: found the line"),
        ("", ROS, "schema: found the type"),
        ("uint8[99999] a\nuint8[99999] b\n", ROS, "schema: found more than"),
    ] {
        let bytes = made(Some(1000), |writer| {
            channel(writer, schema, encodings, "/odd");
        });
        let said = expect_place(bytes);
        assert!(said.contains("byte ") && said.contains("channel \"/odd\"") && said.contains(expected), "{said}");
    }
    let not_mcap: [&[u8]; 4] = [b"t,u,y\n0,1,2\n", b"PK\x03\x04 a zip file", &[0; 5000], b"\x89MCAP1\r\n\x89MCAP0\r\n"];
    for bytes in not_mcap {
        assert!(expect_place(bytes.to_vec()).contains("found no MCAP file"));
    }
}

#[test]
fn a_recording_of_a_site_has_json_and_names_of_the_network() {
    let schema = cdr::schema::<EncoderSample>();
    let bytes = made(Some(1000), |writer| {
        for (topic, schema, encodings) in [
            ("telemetry/encoder-sample", &*schema, ROS),
            ("late/telemetry/encoder-sample", &*schema, ROS),
            ("model", &*schema, ROS),
            ("status", "{}", ["jsonschema", "json"]),
        ] {
            let id = channel(writer, schema, encodings, topic);
            let header = MessageHeader { channel_id: id, sequence: 0, log_time: 0, publish_time: 0 };
            writer.write_to_known_channel(&header, b"{}").unwrap();
        }
    });
    let mut reading = Reading::of(Path::new("site.mcap"), Cursor::new(bytes));
    let mut found = Vec::new();
    while let Some(message) = reading.next().unwrap() {
        let channel = &message.channel;
        let carries = [EncoderSample::CHANNEL, CoefficientSnapshot::CHANNEL].map(|name| channel.carries(name));
        found.push((channel.columns.is_empty(), carries));
    }
    let expected = [(false, [true, false]), (false, [false, false]), (false, [false, true]), (true, [false, false])];
    assert_eq!(found, expected);
}

#[test]
fn a_message_that_does_not_fit_its_schema_has_no_values_beyond_its_end() {
    let schema = cdr::schema::<EncoderSample>();
    let bytes = made(Some(1000), |writer| {
        let id = channel(writer, &schema, ROS, EncoderSample::CHANNEL);
        for length in [0, 3, 4, 11, 12, 100_000] {
            let header = MessageHeader { channel_id: id, sequence: 0, log_time: u64::MAX, publish_time: 0 };
            writer.write_to_known_channel(&header, &vec![255; length]).unwrap();
        }
    });
    assert_eq!(read(bytes).unwrap(), (6, true));
}

#[test]
fn bombs_end_at_a_bound() {
    // Some kilobytes that become gigabytes: message by message they are read, as one chunk they are refused.
    let bomb = |chunk: Option<u64>, count: usize, length: usize| {
        made(chunk, |writer| {
            let id = channel(writer, "uint8 a\n", ROS, "/bomb");
            let zeros = vec![0; length];
            for _ in 0..count {
                let header = MessageHeader { channel_id: id, sequence: 0, log_time: 0, publish_time: 0 };
                writer.write_to_known_channel(&header, &zeros).unwrap();
            }
        })
    };
    let small = bomb(Some(1 << 20), 300, 1 << 20);
    assert!(small.len() < 200_000, "{}", small.len());
    assert_eq!(read(small).unwrap(), (300, true));
    let chunk = bomb(Some(1 << 30), 100, 1 << 20);
    assert!(expect_place(chunk).starts_with("byte "));
    // More schemas, facts or attached files than are kept.
    let schemas = made(Some(1 << 20), |writer| {
        for i in 0..1000 {
            channel(writer, &format!("uint8[1000] a{i}\n"), ROS, &format!("/{i}"));
        }
    });
    assert!(expect_place(schemas).contains("more than 256 channels"));
    let columns = made(Some(1 << 20), |writer| {
        for i in 0..20 {
            channel(writer, &format!("uint8[50000] a{i}\n"), ROS, &format!("/{i}"));
        }
    });
    assert!(expect_place(columns).contains("300000 columns"));
    let attached = made(Some(1 << 20), |writer| {
        for i in 0..5 {
            let (name, data) = (i.to_string(), vec![0; 20 << 20].into());
            let media_type = String::new();
            writer.attach(&Attachment { log_time: 0, create_time: 0, name, media_type, data }).unwrap();
        }
    });
    assert!(expect_place(attached).contains("attached files"));
    let facts = made(None, |writer| {
        let metadata = [("a".to_owned(), "b".repeat(30 << 20))].into();
        let metadata = Metadata { name: "hydraxis".to_owned(), metadata };
        (0..4).for_each(|_| writer.write_metadata(&metadata).unwrap());
    });
    assert!(expect_place(facts).contains("byte "));
}

#[test]
fn lengths_that_lie_allocate_nothing() {
    let whole = recording();
    // The length of a record follows its first byte, behind the eight bytes that every file begins with.
    for length in [u64::MAX, u64::MAX / 2, 1 << 40, 1 << 32, 64 << 20, 0] {
        let mut bytes = whole.clone();
        bytes[9..17].copy_from_slice(&length.to_le_bytes());
        let said = expect_place(bytes);
        assert!(said.contains("byte "), "{length}: {said}");
    }
}
