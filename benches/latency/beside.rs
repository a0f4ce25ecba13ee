//! Times of all stages of a real-time group while something happens beside it, and while nothing does.
//!
//! The sides take turns in many short spans of one run, in one order and then in the other. One of the sides is nothing
//! once more: how far its ratio is from 1 says what the computer allows to be seen.
//!
//! Trap: what happens beside needs cores itself, whatever it is connected to. So clients also go to a server that does
//! nothing but close their connections.

use std::{
    io::Write,
    net::{SocketAddr, TcpListener, TcpStream},
    process::{Child, Command, Stdio},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::{self, JoinHandle, sleep},
    time::{Duration, Instant},
};

use pipeline::{
    channel::Reader,
    latency::{LatencyRecorder, Percentiles},
    message::{CoefficientSnapshot, EncoderSample, ValveCommand},
};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};

use crate::{
    PERIOD,
    group::{Running, await_some},
    report,
    table::{ratio, show},
};

/// Time after a change of sides that belongs to none: programs attach and leave.
const SETTLING: Duration = Duration::from_millis(700);
/// Clients that come in one span, and time between two of them.
const CLIENTS: usize = 1000;
/// The stages as on a controller PC. Where the right to it is missing, they run without.
const PRIORITIES: [&str; 4] = [
    "stage.plant-sim.priority=10",
    "stage.sensor-proc.priority=10",
    "stage.ident-proc.priority=10",
    "stage.control-proc.priority=10",
];
/// What is measured of each tick.
const TIMES: [&str; 4] = ["acquired to sample", "sample to snapshot", "sample to command", "acquired to command"];

/// Something beside the group, which ends when it is dropped.
type Beside = Box<dyn Send>;
/// A side: its name, and what begins it.
struct Side<'a> {
    name: &'static str,
    begin: Box<dyn Fn() -> Option<Beside> + 'a>,
}

/// A process that gets an interrupt at its end.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        let _ = kill_process(Pid::from_child(&self.0), Signal::INT);
        let _ = self.0.wait();
    }
}

impl Process {
    fn start(arguments: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hydraxis"));
        command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        Self(command.spawn().expect("the command was built for this benchmark"))
    }

    /// Memory, kB.
    fn memory(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.0.id())).unwrap_or_default();
        let line = status.lines().find(|line| line.starts_with("VmHWM:"));
        line.and_then(|line| line.split_whitespace().nth(1)?.parse().ok()).unwrap_or_default()
    }
}

/// Clients on a thread, until they are dropped.
struct Clients {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Clients {
    /// [`CLIENTS`] clients of `server` in `time`. They connect and stall, ask and do not read, or send garbage.
    fn of(server: SocketAddr, time: Duration) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = thread::spawn(move || {
            let (begin, mut open) = (Instant::now(), Vec::new());
            for i in 0..CLIENTS {
                sleep((time * i as u32 / CLIENTS as u32).saturating_sub(begin.elapsed()));
                if stopped.load(Ordering::Relaxed) {
                    return;
                }
                let Ok(mut stream) = TcpStream::connect(server) else { continue };
                let sent: &[u8] = match i % 4 {
                    0 => b"",
                    1 => b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n",
                    2 => b"GET /state HTTP/1.1\r\nHost: loc",
                    _ => b"\x00\xff\x13\x37 no request at all \r\n\r\n\r\n",
                };
                let _ = stream.write_all(sent);
                open.push(stream);
                // Half of them leave soon, the others at the end.
                if i % 2 == 1 {
                    open.swap_remove(i / 2 % open.len());
                }
            }
            while !stopped.load(Ordering::Relaxed) {
                sleep(Duration::from_millis(20));
            }
        });
        Self { stop, thread: Some(thread) }
    }
}

impl Drop for Clients {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().into_iter().for_each(|thread| drop(thread.join()));
    }
}

/// A recorder beside the group, in `rounds` rounds in which each side has `time`.
pub fn recorder(rounds: usize, time: Duration) -> Value {
    let running = Running::real_time("recorded", &PRIORITIES);
    let folder = tempfile::tempdir().expect("a folder");
    let (prefix, file) = (running.0.prefix.to_string(), folder.path().join("run.mcap"));
    let record = || -> Option<Beside> {
        let _ = std::fs::remove_file(&file);
        let recorder = Process::start(&["record", "--prefix", &prefix, "--output", file.to_str()?]);
        await_some(|| file.exists().then_some(()));
        Some(Box::new(recorder))
    };
    let sides = [
        Side { name: "nothing", begin: Box::new(|| None) },
        Side { name: "nothing, once more", begin: Box::new(|| None) },
        Side { name: "a recorder", begin: Box::new(record) },
    ];
    compare("A recorder", &running, &sides, rounds, time)
}

/// Clients of the page beside the group, in `rounds` rounds in which each side has `time`.
pub fn clients(rounds: usize, time: Duration) -> Value {
    let running = Running::real_time("clients", &PRIORITIES);
    let free = || TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("an address");
    let (page, prefix) = (free(), running.0.prefix.to_string());
    let monitor = Process::start(&["monitor", "--listen", &page.to_string(), "--prefix", &prefix]);
    await_some(|| TcpStream::connect(page).ok());
    let bare = TcpListener::bind("127.0.0.1:0").expect("a port");
    let elsewhere = bare.local_addr().expect("an address");
    thread::spawn(move || bare.incoming().for_each(drop));
    let of = |server| move || -> Option<Beside> { Some(Box::new(Clients::of(server, time + SETTLING))) };
    let sides = [
        Side { name: "nothing", begin: Box::new(|| None) },
        Side { name: "nothing, once more", begin: Box::new(|| None) },
        Side { name: "1000 clients of a bare server", begin: Box::new(of(elsewhere)) },
        Side { name: "1000 clients of the page", begin: Box::new(of(page)) },
    ];
    let mut figures = compare("1000 clients in a span", &running, &sides, rounds, time);
    println!("  memory of the monitor: {} kB at most\n", monitor.memory());
    figures["monitor_kb"] = monitor.memory().into();
    figures
}

/// The readers of all messages of a tick.
struct Ticks {
    samples: Reader<EncoderSample>,
    snapshots: Reader<CoefficientSnapshot>,
    commands: Reader<ValveCommand>,
}

impl Ticks {
    /// Forgets what has come.
    fn skip(&mut self) {
        self.samples.newest().expect("a channel");
        self.snapshots.newest().expect("a channel");
        self.commands.newest().expect("a channel");
    }

    /// Gives the times of all ticks that have come, ns, each with its place in [`TIMES`].
    fn each(&mut self, mut take: impl FnMut(usize, u64)) {
        while let Some(command) = self.commands.read().expect("a channel").if_new().copied() {
            let tick = command.header.sequence;
            if !self.samples.reach(tick).expect("a channel") {
                continue;
            }
            let Some(sample) = self.samples.last().filter(|sample| sample.header.sequence == tick) else { continue };
            let (acquired, sent) = (sample.header.acquired_ns, sample.header.sent_ns);
            take(0, sent.saturating_sub(acquired));
            take(2, command.header.sent_ns.saturating_sub(sent));
            take(3, command.header.sent_ns.saturating_sub(acquired));
            let reached = self.snapshots.reach(tick).expect("a channel");
            if let Some(snapshot) = self.snapshots.last().filter(|of| reached && of.header.sequence == tick) {
                take(1, snapshot.header.sent_ns.saturating_sub(sent));
            }
        }
    }
}

fn recorders() -> [LatencyRecorder; TIMES.len()] {
    std::array::from_fn(|_| LatencyRecorder::new())
}

/// Times of the group by sides.
fn compare(
    title: &str,
    (_, group, _): &(Running, pipeline::channel::Group, Reader<pipeline::message::StageHealth>),
    sides: &[Side<'_>],
    rounds: usize,
    time: Duration,
) -> Value {
    let mut ticks = Ticks {
        samples: group.reader().expect("a place"),
        snapshots: group.reader().expect("a place"),
        commands: group.reader().expect("a place"),
    };
    let mut all: Vec<_> = sides.iter().map(|_| recorders()).collect();
    // By round, side and time.
    let mut spans: Vec<Vec<[Percentiles; TIMES.len()]>> = Vec::new();
    for round in 0..rounds {
        let mut of_round = vec![[Percentiles::default(); TIMES.len()]; sides.len()];
        let forth = 0..sides.len();
        let order: Vec<usize> = if round % 2 == 0 { forth.collect() } else { forth.rev().collect() };
        for side in order {
            let beside = (sides[side].begin)();
            sleep(SETTLING);
            ticks.skip();
            let (mut span, begin) = (recorders(), Instant::now());
            while begin.elapsed() < time {
                sleep(Duration::from_millis(20));
                ticks.each(|i, ns| {
                    span[i].record(ns);
                    all[side][i].record(ns);
                });
            }
            of_round[side] = std::array::from_fn(|i| span[i].percentiles());
            drop(beside);
        }
        spans.push(of_round);
    }
    let heading = format!("{title}, period {PERIOD:?}, {rounds} rounds of {time:?}, load {}", report::load());
    let names: Vec<&str> = sides.iter().map(|side| side.name).collect();
    let times = (0..TIMES.len()).map(|i| {
        let pooled: Vec<Percentiles> = all.iter().map(|all| all[i].percentiles()).collect();
        let spans: Vec<Vec<Percentiles>> = spans.iter().map(|span| span.iter().map(|side| side[i]).collect()).collect();
        table(&format!("{heading}: {}", TIMES[i]), &names, &pooled, &spans)
    });
    json!({ "title": title, "times": times.collect::<Vec<_>>() })
}

/// Prints percentiles of all sides, and their ratios by the first one: of all spans together, and the mean of the
/// ratios of single spans with its standard error.
fn table(title: &str, names: &[&str], pooled: &[Percentiles], spans: &[Vec<Percentiles>]) -> Value {
    let named: Vec<_> = names.iter().copied().zip(pooled.iter().copied()).collect();
    let mut figures = show(title, &named, &[]);
    let mut ratios = Vec::new();
    for (side, name) in names.iter().enumerate().skip(1) {
        for (k, percentile) in ["p50", "p99", "p99.9"].into_iter().enumerate() {
            let of = |all: &[Percentiles]| {
                let at = |p: &Percentiles| [p.p50, p.p99, p.p99_9][k];
                ratio(at(&all[side]), at(&all[0]))
            };
            let each: Vec<f64> = spans.iter().map(|span| of(span)).collect();
            let (all, (mean, error)) = (of(pooled), spread(&each));
            println!("  {percentile:6} {name:30} by {}: {all:.3}; spans {mean:.3} +- {error:.3}", names[0]);
            ratios.push(json!({ "percentile": percentile, "side": name, "all": all, "spans": mean, "error": error }));
        }
    }
    println!();
    figures["ratios"] = ratios.into();
    figures
}

/// Mean and standard error.
fn spread(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
    (mean, (squares / (count - 1.0).max(1.0) / count).sqrt())
}
