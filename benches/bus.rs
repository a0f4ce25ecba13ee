//! Time from the text of an slcan adapter to the published reading of four encoders: lines decoded, positions unpacked
//! and checked, the message filled and sent. Beside it the time of sending the message alone.
//!
//! `cargo bench --bench bus`. What the kernel needs to hand the text over is not in it.

use std::{hint::black_box, path::Path, time::Instant};

use can::{
    Received,
    bus::{Decoded, Decoder, MAX_TEXT, encode},
    canopen::NodeId,
    device::{Network, Outbox, PositionObject},
    simulated::SimulatedEncoder,
};
use hdrhistogram::Histogram;
use pipeline::{
    channel::{Group, Prefix, Publisher, remove_leftovers},
    machine::{FOUR_AXES, Machine},
    message::EncoderReading,
};

/// Period of SYNC, ns.
const SYNC_NS: u64 = 5_000_000;
const AXES: usize = 4;
const CYCLES: usize = 100_000;
/// What the median may be, ns.
const BOUND_NS: u64 = 5_000;

/// Four encoders and their master, in simulated time.
struct Bench {
    network: Network,
    encoders: Vec<SimulatedEncoder>,
    now_ns: u64,
}

impl Bench {
    fn new() -> Self {
        let mut settings = vec![("source.kind".to_owned(), "can".to_owned())];
        settings.push(("drive.kind".to_owned(), "none".to_owned()));
        settings.push(("can.interface".to_owned(), "\"can0\"".to_owned()));
        for (i, axis) in ["boom", "arm", "telescope", "bucket"].iter().enumerate() {
            settings.push((format!("axis.{axis}.can.encoder"), format!("{}", 11 + i)));
        }
        let machine = Machine::parse(FOUR_AXES, "m.toml", Path::new("."), &settings).expect("the machine is sound");
        let encoders = machine.axes.iter().enumerate().map(|(i, axis)| {
            let node = NodeId::new(11 + i as u8).expect("a number of a node");
            SimulatedEncoder::new(node, PositionObject::Position, can_proc::step(axis).unwrap_or(1))
        });
        let encoders = encoders.collect();
        let mut bench =
            Self { network: can_proc::network(&machine).expect("devices"), encoders, now_ns: 1_000_000_000 };
        while !bench.network.was_ready() {
            let answers = bench.cycle();
            answers.frames().iter().for_each(|frame| bench.take(Received { frame: *frame, time_ns: bench.now_ns }));
        }
        bench
    }

    fn take(&mut self, received: Received) {
        self.network.take(&received, self.now_ns);
    }

    /// Sends SYNC, and what else is due: what the encoders answer.
    fn cycle(&mut self) -> Outbox {
        self.now_ns += SYNC_NS;
        self.network.begin(self.now_ns);
        let mut answers = Outbox::default();
        for (i, encoder) in self.encoders.iter_mut().enumerate() {
            encoder.set_counts((self.now_ns / SYNC_NS) as i64 + i as i64);
            encoder.step(self.now_ns, &mut answers);
            self.network.outbox().frames().iter().for_each(|frame| encoder.take(frame, &mut answers));
        }
        self.network.outbox().clear();
        answers
    }

    fn publish(&mut self, number: u64, readings: &Publisher<EncoderReading>) {
        let mut reading = EncoderReading::default();
        reading.header.acquired_ns = self.network.take_sample(self.now_ns);
        for (i, value) in reading.encoders.iter_mut().enumerate().take(AXES) {
            let (counts, error) = self.network.reading(i).unwrap_or_default();
            (value.counts, value.error) = (counts.unwrap_or_default(), error);
        }
        (reading.header.axis_count, reading.header.sequence) = (AXES as u32, number);
        readings.send(&reading).expect("the channel takes it");
    }
}

fn main() {
    let prefix: Prefix = format!("b{}-bus", std::process::id()).parse().expect("letters and digits");
    let group = Group::join(&prefix, "bench").expect("the group can be joined");
    let readings = group.publisher::<EncoderReading>().expect("a channel");
    let mut reader = group.reader::<EncoderReading>().expect("a channel");
    let mut bench = Bench::new();
    let histogram = || Histogram::<u64>::new_with_bounds(1, 1_000_000_000, 3).expect("bounds");
    let (mut all, mut alone) = (histogram(), histogram());
    let (mut decoder, mut text, mut line) = (Decoder::default(), Vec::with_capacity(4096), [0; MAX_TEXT]);
    for number in 0..CYCLES {
        let answers = bench.cycle();
        text.clear();
        for frame in answers.frames() {
            let length = encode(frame, &mut line).expect("a classical frame");
            text.extend_from_slice(&line[..length]);
        }
        let begun = Instant::now();
        for byte in black_box(&text) {
            if let Some(Decoded::Frame(frame)) = decoder.take(*byte) {
                bench.take(Received { frame, time_ns: bench.now_ns });
            }
        }
        assert!(bench.network.is_ready(bench.now_ns, SYNC_NS), "all positions have come");
        bench.publish(number as u64, &readings);
        all.saturating_record(begun.elapsed().as_nanos() as u64);
        let begun = Instant::now();
        readings.send(black_box(&EncoderReading::default())).expect("the channel takes it");
        alone.saturating_record(begun.elapsed().as_nanos() as u64);
    }
    let last = reader.newest().expect("the channel can be read").if_new().copied();
    assert!(last.is_some(), "readings have come");
    drop((reader, readings, group));
    remove_leftovers(&prefix).expect("nobody else has the group");
    for (name, times) in [("decode and publish", &all), ("publish alone", &alone)] {
        let at = |quantile| times.value_at_quantile(quantile) as f64 * 1e-3;
        println!("{name}, {AXES} encoders, {CYCLES} times: p50 {:.2} us, p99 {:.2} us", at(0.5), at(0.99));
    }
    let verdict = if all.value_at_quantile(0.5) < BOUND_NS { "holds" } else { "missed" };
    println!("p50 under {} us: {verdict}", BOUND_NS / 1000);
}
