//! The pipeline's own times beside what the machine allows: both sides in one run.
//!
//! | figure | beside |
//! |---|---|
//! | release jitter of sensor-proc | a bare loop on `clock_nanosleep`, same period, same priority, half a period later |
//! | sample to command through two processes in lock-step | the same two hops between threads that do nothing else, and the work of the two |
//! | sample to command of a real-time group, while watchers attach and detach | the same while they do so to another group on the same cores, and while nobody does |
//!
//! Trap: on cores that others use, too, the largest values are theirs; so the comparison is of ratios, and the two sides
//! take turns or run at once.

mod arguments;

use std::{
    process::{Child, Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, sleep},
    time::{Duration, Instant},
};

use pipeline::{
    channel::{Group, Prefix, Publisher, Reader, remove_leftovers},
    latency::{LatencyRecorder, Percentiles},
    message::{
        CoefficientSnapshot, EncoderReading, EncoderSample, Header, MachineState, Message, StageHealth, StageState,
        ValveCommand, model_fault,
    },
    stage::{StageKind, monotonic_ns, schedule, sleep_until},
};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

use arguments::Arguments;

/// Period of the real-time groups: five times the rate of the built-in machine, for more samples.
const PERIOD: Duration = Duration::from_millis(2);
/// Priority of the jitter's two sides, where it is to be had.
const PRIORITY: u8 = 60;
/// Axes of the built-in machine.
const AXES: u32 = 4;
/// How long anything may take to begin.
const PATIENCE: Duration = Duration::from_secs(20);
/// Times that a watcher attaches and detaches.
const WATCHERS: usize = 1000;

fn main() {
    let arguments = Arguments::read();
    let long = Duration::from_secs(if arguments.quick { 3 } else { 60 });
    let sections = [
        jitter(long),
        hops(if arguments.quick { 2_000 } else { 50_000 }),
        watching(if arguments.quick { 2 } else { 20 }, Duration::from_secs(if arguments.quick { 1 } else { 3 })),
    ];
    println!("load {}", std::fs::read_to_string("/proc/loadavg").unwrap_or_default().trim());
    if let Some(file) = arguments.json {
        let text = serde_json::to_string_pretty(&Value::from(sections.to_vec())).expect("plain numbers");
        std::fs::write(file, text).expect("the file is writable");
    }
}

fn show(title: &str, sides: &[(&str, Percentiles)], ratios: &[(&str, f64)]) -> Value {
    println!("{title}");
    println!("  {:34} {:>9} {:>9} {:>9} {:>9} {:>10}", "us", "count", "p50", "p99", "p99.9", "max");
    for (name, p) in sides {
        let [p50, p99, p99_9, max] = [p.p50, p.p99, p.p99_9, p.max].map(|ns| ns as f64 / 1e3);
        println!("  {name:34} {:>9} {p50:>9.1} {p99:>9.1} {p99_9:>9.1} {max:>10.1}", p.count);
    }
    for (name, ratio) in ratios {
        println!("  {name}: {ratio:.3}");
    }
    println!();
    let sides: Vec<Value> = sides.iter().map(|(name, p)| json!({ "side": name, "ns": p })).collect();
    let ratios: Vec<Value> = ratios.iter().map(|(name, ratio)| json!({ "ratio": name, "is": ratio })).collect();
    json!({ "title": title, "sides": sides, "ratios": ratios })
}

fn ratio(one: u64, other: u64) -> f64 {
    one as f64 / other.max(1) as f64
}

/// A group that ends with this value.
struct Running {
    prefix: Prefix,
    processes: Vec<Child>,
}

impl Running {
    fn new(name: &str) -> Self {
        let prefix = format!("b{}-{name}", std::process::id()).parse().expect("letters and digits");
        Self { prefix, processes: Vec::new() }
    }

    fn start(&mut self, arguments: &[&str]) {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hydraxis"));
        command.args(arguments).args(["--prefix", &self.prefix.to_string()]);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        self.processes.push(command.spawn().expect("the command was built for this benchmark"));
    }

    fn join(&self) -> Group {
        Group::join(&self.prefix, "bench").expect("the group can be joined")
    }

    /// A whole real-time group in which all stages work.
    fn real_time(name: &str, settings: &[&str]) -> (Self, Group, Reader<StageHealth>) {
        let mut running = Self::new(name);
        let period = format!("timing.period={}us", PERIOD.as_micros());
        let settings: Vec<&str> = [period.as_str()].iter().chain(settings).flat_map(|s| ["--set", *s]).collect();
        running.start(&[&["run", "--duration", "3600s"], &settings[..]].concat());
        await_some(|| running.prefix.folder().join("members").exists().then_some(()));
        let group = running.join();
        let mut health: Reader<StageHealth> = group.reader().expect("a place among the readers");
        let mut works = [false; 4];
        await_some(|| {
            while let Some(health) = health.read().expect("a channel").if_new() {
                works[health.stage as usize] |= health.state == StageState::Running as u32;
            }
            (works == [true; 4]).then_some(())
        });
        (running, group, health)
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        for process in &mut self.processes {
            let _ = kill_process(Pid::from_child(process), Signal::TERM);
        }
        for process in &mut self.processes {
            let _ = process.wait();
        }
        let _ = remove_leftovers(&self.prefix);
    }
}

fn await_some<T>(mut look: impl FnMut() -> Option<T>) -> T {
    let until = Instant::now() + PATIENCE;
    loop {
        if let Some(seen) = look() {
            return seen;
        }
        assert!(Instant::now() < until, "nothing within {PATIENCE:?}");
        sleep(Duration::from_micros(200));
    }
}

/// The newest health of a stage whose figures were all taken after `since_ns`.
fn health_of(kind: StageKind, health: &mut Reader<StageHealth>, since_ns: u64) -> StageHealth {
    let mut beats = 0;
    await_some(|| {
        while let Some(health) = health.read().expect("a channel").if_new() {
            // One of four histograms is summed up per heartbeat.
            beats += u32::from(health.stage == kind as u32 && health.header.sent_ns > since_ns);
            if beats >= 5 && health.stage == kind as u32 {
                return Some(*health);
            }
        }
        None
    })
}

fn jitter(time: Duration) -> Value {
    let fifo = thread::spawn(|| schedule(PRIORITY).is_ok()).join().unwrap_or(false);
    let priority = format!("stage.sensor-proc.priority={PRIORITY}");
    let settings: Vec<&str> = fifo.then_some(priority.as_str()).into_iter().collect();
    let (_running, _group, mut health) = Running::real_time("jitter", &settings);
    let before = health_of(StageKind::SensorProc, &mut health, monotonic_ns());
    let pid = Pid::from_raw(before.pid as i32).expect("a process");
    kill_process(pid, Signal::USR1).expect("our own process");
    let bare = thread::spawn(move || {
        if fifo {
            let _ = schedule(PRIORITY);
        }
        let _ = rustix::thread::set_current_timer_slack(std::num::NonZeroU64::new(1));
        let (period, mut recorder) = (PERIOD.as_nanos() as u64, LatencyRecorder::new());
        let (begin, ticks) = (monotonic_ns() + period / 2, (time.as_nanos() as u64) / period);
        for tick in 1..=ticks {
            let due = begin + tick * period;
            sleep_until(due);
            recorder.record(monotonic_ns().saturating_sub(due));
        }
        recorder.percentiles()
    });
    let bare = bare.join().expect("the loop ends");
    let ours = health_of(StageKind::SensorProc, &mut health, monotonic_ns()).release_jitter;
    let class = if fifo { format!("SCHED_FIFO {PRIORITY}") } else { "no priority".to_owned() };
    let title = format!("Release jitter, period {PERIOD:?}, {class}");
    let ratios = [("p99.9 by bare loop", ratio(ours.p99_9, bare.p99_9)), ("p50", ratio(ours.p50, bare.p50))];
    show(&title, &[("sensor-proc", ours), ("bare clock_nanosleep", bare)], &ratios)
}

/// Polls as a stage in lock-step does.
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

/// Sends readings and waits for the commands that are made from them; times from acquisition to command.
fn ticks(count: u64, channels: &Group, mut answered: impl FnMut(u64)) -> Percentiles {
    let readings: Publisher<EncoderReading> = channels.publisher().expect("a place");
    let mut commands: Reader<ValveCommand> = channels.reader().expect("a place");
    let mut recorder = LatencyRecorder::new();
    for tick in 0..count {
        let mut reading = EncoderReading { header: header(tick), ..EncoderReading::default() };
        // About the middle of all strokes, and a count of noise.
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

fn hops(count: u64) -> Value {
    // Raw: reading to sample to command, each handed on as it is.
    let raw = {
        let running = Running::new("raw");
        let channels = running.join();
        let stop = Arc::new(AtomicBool::new(false));
        let relay = |is_first: bool| {
            let (prefix, stop) = (running.prefix.clone(), Arc::clone(&stop));
            thread::spawn(move || {
                let group = Group::join(&prefix, "relay").expect("the group can be joined");
                if is_first {
                    let mut readings: Reader<EncoderReading> = group.reader().expect("a place");
                    let samples: Publisher<EncoderSample> = group.publisher().expect("a place");
                    while let Some(reading) = poll(&mut readings, &stop) {
                        let header = Header { sent_ns: monotonic_ns(), ..reading.header };
                        samples.send(&EncoderSample { header, ..EncoderSample::default() }).expect("memory");
                        samples.greet();
                    }
                } else {
                    let mut samples: Reader<EncoderSample> = group.reader().expect("a place");
                    let commands: Publisher<ValveCommand> = group.publisher().expect("a place");
                    while let Some(sample) = poll(&mut samples, &stop) {
                        let header = Header { sent_ns: monotonic_ns(), ..sample.header };
                        commands.send(&ValveCommand { header, ..ValveCommand::default() }).expect("memory");
                        commands.greet();
                    }
                }
            })
        };
        let relays = [relay(true), relay(false)];
        let raw = ticks(count, &channels, |_| ());
        stop.store(true, Ordering::Relaxed);
        relays.into_iter().for_each(|relay| relay.join().expect("the relay ends"));
        raw
    };
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

/// Attaches to the slow channels of a group as `hydraxis status` does, looks once, and leaves.
fn watch(group: &Running) {
    let watcher = group.join();
    let mut health: Reader<StageHealth> = watcher.reader().expect("a place");
    let mut states: Reader<MachineState> = watcher.reader().expect("a place");
    health.newest().expect("a channel");
    states.newest().expect("a channel");
}

fn watching(rounds: usize, time: Duration) -> Value {
    let (running, group, _health) = Running::real_time("watch", &[]);
    // The same work of the watchers, on the same cores, for a group in which nobody is at home.
    let empty = Running::new("empty");
    let _empty = empty.join();
    let mut samples: Reader<EncoderSample> = group.reader().expect("a place");
    let mut commands: Reader<ValveCommand> = group.reader().expect("a place");
    let mut sides: [LatencyRecorder; 3] = std::array::from_fn(|_| LatencyRecorder::new());
    let looks = WATCHERS.div_ceil(rounds);
    let mut attached = 0;
    for _ in 0..rounds {
        for (side, recorder) in sides.iter_mut().enumerate() {
            let begin = Instant::now();
            let mut looked = 0;
            // What was sent before belongs to the side before.
            samples.newest().expect("a channel");
            commands.newest().expect("a channel");
            while begin.elapsed() < time {
                let due = begin.elapsed().as_secs_f64() / time.as_secs_f64() * looks as f64;
                if side > 0 && looked < looks && looked as f64 <= due {
                    looked += 1;
                    watch(if side == 1 { &empty } else { &running });
                    attached += usize::from(side == 2);
                }
                sleep(Duration::from_millis(5));
                while let Some(command) = commands.read().expect("a channel").if_new().copied() {
                    if samples.reach(command.header.sequence).expect("a channel")
                        && let Some(sample) = samples.last()
                        && sample.header.sequence == command.header.sequence
                    {
                        recorder.record(command.header.sent_ns.saturating_sub(sample.header.sent_ns));
                    }
                }
            }
        }
    }
    let [alone, elsewhere, watched] = sides.map(|side| side.percentiles());
    show(
        &format!("Sample to command in real time, period {PERIOD:?}, {attached} watchers come and go"),
        &[("nobody comes", alone), ("to another group, same cores", elsewhere), ("to this group", watched)],
        &[
            ("p99, this group by another one", ratio(watched.p99, elsewhere.p99)),
            ("p99, this group by nobody", ratio(watched.p99, alone.p99)),
            ("p50, this group by nobody", ratio(watched.p50, alone.p50)),
        ],
    )
}
