//! `hydraxis-fleet bench`: many simulated machines on one router of this computer.
//!
//! Router and publishers are processes of their own, so that their time and memory can be told apart. Each machine has
//! a connection of its own and publishes what a bridge does by default: positions and commands at 20 Hz; states,
//! heartbeats of four stages and the state of the bridge at 1 Hz. The latency is that from the put to the callback of
//! the one subscriber of everything.

use std::{
    fs,
    io::{self, BufRead, BufReader},
    process::{Child, Command, Stdio},
    sync::{Arc, Mutex, PoisonError},
    thread::sleep,
    time::{Duration, Instant},
};

use pipeline::{
    cdr,
    message::{EncoderSample, MachineState, Message, StageHealth, ValveCommand},
};
use serde::Serialize;
use serde_json::json;
use thiserror::Error;
use zenoh::{Session, Wait, pubsub::Publisher, sample::Sample};

use crate::{
    bridge::{network, topic::Topic},
    connection::{Connection, ConnectionError},
    fleet::{Counts, Fleet},
    kernel::utc_ns,
    key::{self, Place},
    listen,
    stamp::{NOT_SYNCHRONISED, Stamp},
};

/// Positions and commands a second.
const RATE: u64 = 20;
/// Stages of a group.
const STAGES: usize = 4;
/// Bytes of the state of a bridge, about.
const STATUS_BYTES: usize = 1200;
/// Time that processes and connections have to come up.
const PATIENCE: Duration = Duration::from_secs(60);
/// Hundredths of a second in which the kernel counts the time of a process.
const TICKS_PER_SECOND: f64 = 100.0;

/// Why the measurement has failed.
#[derive(Debug, Error)]
pub enum BenchError {
    /// A process cannot be started or asked.
    #[error("a process of the measurement: {0}")]
    Process(#[from] io::Error),
    /// A connection fails.
    #[error(transparent)]
    Connection(#[from] ConnectionError),
    /// Zenoh refuses something.
    #[error("Zenoh: {0}")]
    Zenoh(#[from] zenoh::Error),
    /// Not all machines were heard.
    #[error("heard {heard} of {machines} machines within {}", humantime::format_duration(PATIENCE))]
    Silent {
        /// Machines that were heard.
        heard: usize,
        /// Machines that publish.
        machines: usize,
    },
}

/// What a process has taken.
#[derive(Debug, Serialize)]
pub struct Taken {
    /// Part of a core, %.
    pub core_percent: f64,
    /// Memory, MB.
    pub memory_mb: f64,
}

/// The measurement of so many machines.
#[derive(Debug, Serialize)]
pub struct Measured {
    /// Machines.
    pub machines: usize,
    /// Messages a second that came.
    pub per_second: f64,
    /// Latency from put to callback, ms: half, 99 %, 99.9 % and all of the messages are faster.
    pub latency_ms: [f64; 4],
    /// Messages by what became of them, all machines together.
    pub counts: Counts,
    /// The router.
    pub router: Taken,
    /// All publishers together.
    pub publishers: Taken,
    /// This process, the subscriber.
    pub subscriber: Taken,
}

/// Ends a process of the measurement with it.
struct Ended(Child);

impl Drop for Ended {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Measures so many machines for so long.
///
/// # Errors
/// A process does not start, or not all machines are heard.
pub fn measure(machines: usize, duration: Duration) -> Result<Measured, BenchError> {
    let folder = tempfile::tempdir()?;
    let address = format!("tcp/127.0.0.1:{}", free_port()?);
    let file = folder.path().join("router.json5");
    fs::write(&file, router_file(&address))?;
    let own = std::env::current_exe()?;
    let router = started(Command::new(&own).arg("router").arg(&file))?;
    let connection = Connection { router: vec![address.clone()], tls: None };
    let session = connection.open()?;
    let heard = Arc::new(Mutex::new((Fleet::new(Duration::from_secs(1)), Vec::<u32>::new())));
    let taken = Arc::clone(&heard);
    let take = move |sample: Sample| take(&mut taken.lock().unwrap_or_else(PoisonError::into_inner), &sample);
    let _subscriber = session.declare_subscriber(key::of_all(None, "**")).callback(take).wait()?;
    let publishers = started(Command::new(&own).args(["bench-publish", &address, &machines.to_string()]))?;

    let until = Instant::now() + PATIENCE;
    let known = || heard.lock().unwrap_or_else(PoisonError::into_inner).0.machines().len();
    while known() < machines {
        if Instant::now() > until {
            return Err(BenchError::Silent { heard: known(), machines });
        }
        sleep(Duration::from_millis(50));
    }
    // The connections have come up one after the other; what that took is no part of the measurement.
    sleep(Duration::from_secs(1));
    *heard.lock().unwrap_or_else(PoisonError::into_inner) = (Fleet::new(Duration::from_secs(1)), Vec::new());
    let pids = [router.0.id(), publishers.0.id(), std::process::id()];
    let (begun, before) = (Instant::now(), pids.map(seconds_of));
    sleep(duration);
    let (fleet, mut latencies) = {
        let mut heard = heard.lock().unwrap_or_else(PoisonError::into_inner);
        std::mem::replace(&mut *heard, (Fleet::new(Duration::from_secs(1)), Vec::new()))
    };
    let wall = begun.elapsed().as_secs_f64();
    let taken = |i: usize| Taken {
        core_percent: 100.0 * (seconds_of(pids[i]) - before[i]) / wall,
        memory_mb: memory_of(pids[i]),
    };
    latencies.sort_unstable();
    let at = |part: f64| {
        let place = (part * latencies.len() as f64).ceil() as usize;
        latencies.get(place.max(1) - 1).map_or(f64::NAN, |us| f64::from(*us) / 1e3)
    };
    Ok(Measured {
        machines,
        per_second: latencies.len() as f64 / wall,
        latency_ms: [0.5, 0.99, 0.999, 1.0].map(at),
        counts: fleet.counts(),
        router: taken(0),
        publishers: taken(1),
        subscriber: taken(2),
    })
}

fn take((fleet, latencies): &mut (Fleet, Vec<u32>), sample: &Sample) {
    let now_ns = utc_ns();
    if let Some(stamp) = listen::take(fleet, sample, now_ns) {
        latencies.push(u32::try_from(stamp.age_ns(now_ns).max(0) / 1000).unwrap_or(u32::MAX));
    }
}

/// A port of this computer that nobody has at the moment.
fn free_port() -> io::Result<u16> {
    Ok(std::net::TcpListener::bind("127.0.0.1:0")?.local_addr()?.port())
}

fn router_file(address: &str) -> String {
    let listen = json!({ "endpoints": [address] });
    let scouting = json!({ "multicast": { "enabled": false } });
    json!({ "mode": "router", "listen": listen, "scouting": scouting }).to_string()
}

/// Starts a process and waits for its first line.
fn started(command: &mut Command) -> io::Result<Ended> {
    let mut child = Ended(command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn()?);
    let mut line = String::new();
    if let Some(out) = child.0.stdout.take() {
        BufReader::new(out).read_line(&mut line)?;
    }
    if line.is_empty() { Err(io::Error::other("it has ended before it said anything")) } else { Ok(child) }
}

/// Time of the processor that a process has had, s.
fn seconds_of(pid: u32) -> f64 {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    // Fields 14 and 15 of proc_pid_stat(5), of which two stand before the bracket.
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace().skip(11).take(2);
    fields.filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / TICKS_PER_SECOND
}

/// Memory that a process has, MB.
fn memory_of(pid: u32) -> f64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok()).map_or(f64::NAN, |kb| kb / 1024.0)
}

/// A simulated machine.
struct Simulated {
    /// Keeps its connection.
    _session: Session,
    publishers: Vec<Publisher<'static>>,
    numbers: [u64; Topic::ALL.len()],
    run: u64,
}

impl Simulated {
    fn new(connection: &Connection, number: usize) -> Result<Self, BenchError> {
        let session = connection.open()?;
        let name = format!("machine-{number}");
        let place = Place {
            site: "bench".parse().unwrap_or_else(|_| unreachable!("a constant")),
            machine: name.parse().unwrap_or_else(|_| unreachable!("letters, digits and -")),
        };
        let publisher = |topic: &Topic| network::publisher(&session, &place, *topic);
        let publishers = Topic::ALL.iter().map(publisher).collect::<Result<_, _>>()?;
        Ok(Self { _session: session, publishers, numbers: [0; Topic::ALL.len()], run: utc_ns() as u64 })
    }

    fn put(&mut self, topic: Topic, payload: &[u8]) -> Result<(), zenoh::Error> {
        let number = self.numbers[topic as usize];
        self.numbers[topic as usize] += 1;
        let stamp = Stamp { run: self.run, number, utc_ns: utc_ns(), clock_error_ns: NOT_SYNCHRONISED };
        self.publishers[topic as usize].put(payload).attachment(&stamp.to_bytes()[..]).wait()
    }
}

/// `hydraxis-fleet bench-publish`: publishes so many machines until it is killed.
///
/// # Errors
/// A connection fails.
pub fn publish(router: &str, machines: usize) -> Result<(), BenchError> {
    println!("publishes {machines} machines");
    let connection = Connection { router: vec![router.to_owned()], tls: None };
    let mut fleet = (0..machines).map(|i| Simulated::new(&connection, i)).collect::<Result<Vec<_>, _>>()?;
    let (sample, command) = (bytes_of::<EncoderSample>(), bytes_of::<ValveCommand>());
    let (state, health) = (bytes_of::<MachineState>(), bytes_of::<StageHealth>());
    let status = json!({ "group": "bench", "filled": "x".repeat(STATUS_BYTES) }).to_string();
    let (begun, apart) = (Instant::now(), Duration::from_secs(1) / (RATE as u32 * machines.max(1) as u32));
    // The machines publish one after the other, so that their messages are spread over the period.
    for turn in 0u64.. {
        sleep((begun + apart * turn as u32).saturating_duration_since(Instant::now()));
        let (round, i) = (turn / machines as u64, (turn % machines as u64) as usize);
        fleet[i].put(Topic::Sample, &sample)?;
        fleet[i].put(Topic::Command, &command)?;
        if round % RATE == 0 {
            fleet[i].put(Topic::State, &state)?;
            (0..STAGES).try_for_each(|_| fleet[i].put(Topic::Health, &health))?;
            fleet[i].put(Topic::Status, status.as_bytes())?;
        }
    }
    Ok(())
}

fn bytes_of<M: Message>() -> Vec<u8> {
    let mut bytes = Vec::new();
    cdr::encode(&M::default(), &mut bytes);
    bytes
}

/// The measurements as a table.
pub fn table(measured: &[Measured]) -> String {
    let mut text = format!(
        " {:>8}  {:>8}  {:>9}  {:>9}  {:>9}  {:>9}  {:>5}  {:>14}  {:>14}  {:>14}\n",
        "machines", "1/s", "p50", "p99", "p99.9", "max", "lost", "router", "publishers", "subscriber"
    );
    let taken = |taken: &Taken| format!("{:.1} % {:.0} MB", taken.core_percent, taken.memory_mb);
    for one in measured {
        let [p50, p99, p999, max] = one.latency_ms.map(|ms| format!("{ms:.2} ms"));
        text += &format!(
            " {:8}  {:8.0}  {p50:>9}  {p99:>9}  {p999:>9}  {max:>9}  {:5}  {:>14}  {:>14}  {:>14}\n",
            one.machines,
            one.per_second,
            one.counts.lost,
            taken(&one.router),
            taken(&one.publishers),
            taken(&one.subscriber)
        );
    }
    text
}
