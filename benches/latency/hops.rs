//! Time from reading to command in lock-step through sensor-proc and control-proc, beside two hops between threads.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle},
};

use pipeline::{
    channel::{Group, Publisher, Reader},
    latency::{LatencyRecorder, Percentiles},
    message::{
        CoefficientSnapshot, EncoderReading, EncoderSample, Header, Message, StageHealth, ValveCommand, model_fault,
    },
    stage::{StageKind, monotonic_ns},
};
use serde_json::Value;

use crate::{
    group::{Running, await_some, health_of},
    table::{ratio, show},
};

/// Axes of the built-in machine.
const AXES: u32 = 4;

/// Times of `count` ticks through two processes, and of as many through two relays.
pub fn measure(count: u64) -> Value {
    let raw = relayed(count);
    let mut running = Running::new("hops");
    let channels = running.join();
    let snapshots: Publisher<CoefficientSnapshot> = channels.publisher().expect("a place");
    let mut health: Reader<StageHealth> = channels.reader().expect("a place");
    running.start(&["sensor-proc", "--lockstep"]);
    running.start(&["control-proc", "--lockstep", "--arm"]);
    let ours = ticks(count, &channels, |tick| {
        let mut snapshot = CoefficientSnapshot { header: header(tick), ..CoefficientSnapshot::default() };
        snapshot.axes.iter_mut().for_each(|axis| axis.faults = model_fault::TRAINING);
        snapshots.send(&snapshot).expect("memory");
    });
    let now = monotonic_ns();
    let sensor = health_of(StageKind::SensorProc, &mut health, now).work;
    let control = health_of(StageKind::ControlProc, &mut health, now).work;
    let floor = raw.p50 + sensor.p50 + control.p50;
    show(
        "Reading to command in lock-step, polling, the fallback controls",
        &[
            ("two processes", ours),
            ("two raw hops between threads", raw),
            ("work of sensor-proc", sensor),
            ("work of control-proc", control),
        ],
        &[("p50 by the sum of the others", ratio(ours.p50, floor))],
    )
}

/// Times of `count` ticks from reading to sample to command, where two threads only pass the headers on.
fn relayed(count: u64) -> Percentiles {
    let running = Running::new("raw");
    let channels = running.join();
    let stop = Arc::new(AtomicBool::new(false));
    let relays = [
        relay(&running, &stop, |reading: &EncoderReading| {
            let header = Header { sent_ns: monotonic_ns(), ..reading.header };
            EncoderSample { header, ..EncoderSample::default() }
        }),
        relay(&running, &stop, |sample: &EncoderSample| {
            let header = Header { sent_ns: monotonic_ns(), ..sample.header };
            ValveCommand { header, ..ValveCommand::default() }
        }),
    ];
    let raw = ticks(count, &channels, |_| ());
    stop.store(true, Ordering::Relaxed);
    relays.into_iter().for_each(|relay| relay.join().expect("the relay ends"));
    raw
}

/// A thread that answers every message of one channel with a message of the next one, until `stop` is set.
fn relay<From: Message, To: Message>(
    running: &Running,
    stop: &Arc<AtomicBool>,
    answer: impl Fn(&From) -> To + Send + 'static,
) -> JoinHandle<()> {
    let (prefix, stop) = (running.prefix.clone(), Arc::clone(stop));
    thread::spawn(move || {
        let group = Group::join(&prefix, "relay").expect("the group can be joined");
        let mut messages: Reader<From> = group.reader().expect("a place");
        let answers: Publisher<To> = group.publisher().expect("a place");
        while let Some(message) = poll(&mut messages, &stop) {
            answers.send(&answer(&message)).expect("memory");
            answers.greet();
        }
    })
}

/// Polls as a stage in lock-step does; `None` after `stop` is set.
fn poll<M: Message>(reader: &mut Reader<M>, stop: &AtomicBool) -> Option<M> {
    while !stop.load(Ordering::Relaxed) {
        if let Some(message) = reader.read().expect("a channel").if_new() {
            return Some(*message);
        }
        rustix::thread::sched_yield();
    }
    None
}

fn header(sequence: u64) -> Header {
    let now = monotonic_ns();
    Header { sequence, acquired_ns: now, sent_ns: now, axis_count: AXES, ..Header::default() }
}

/// Sends readings and waits for their commands; returns the times from acquisition to command. `answered` is called
/// after each command.
fn ticks(count: u64, channels: &Group, mut answered: impl FnMut(u64)) -> Percentiles {
    let readings: Publisher<EncoderReading> = channels.publisher().expect("a place");
    let mut commands: Reader<ValveCommand> = channels.reader().expect("a place");
    let mut recorder = LatencyRecorder::new();
    for tick in 0..count {
        let mut reading = EncoderReading { header: header(tick), ..EncoderReading::default() };
        // About the middle of all strokes, with noise of one count.
        reading.encoders[..AXES as usize].iter_mut().for_each(|encoder| encoder.counts = 6500 + (tick % 3) as i64);
        readings.send(&reading).expect("memory");
        let command = await_some(|| {
            if tick == 0 {
                readings.greet();
            }
            commands.reach(tick).expect("a channel").then(|| commands.last().copied()).flatten()
        });
        if tick >= count / 10 {
            recorder.record(command.header.sent_ns.saturating_sub(reading.header.acquired_ns));
        }
        answered(tick);
    }
    recorder.percentiles()
}
