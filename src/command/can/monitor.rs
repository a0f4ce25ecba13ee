//! `hydraxis can monitor`: what is on a bus, decoded, with rates and load.

use std::{
    collections::BTreeMap,
    io::{self, IsTerminal, Write},
    path::PathBuf,
    sync::atomic::Ordering,
    time::Duration,
};

use can::{
    Counters, Format, Frame, Load,
    bus::{Bus, BusError, Playback},
};
use clap::Args;
use embedded_can::Frame as _;
use pipeline::{bounded, stage::monotonic_ns};

use super::{
    bus::{BusArguments, NamedBus, duration},
    decode::Decoder,
};
use crate::{
    failure::Failure,
    group::signals::stop_flag,
    report::{output::show, table::table},
};

/// `can monitor`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis can monitor machine.toml                           a table every second, until Ctrl-C
  hydraxis can monitor --interface can0 --frames              a line for each frame
  hydraxis can monitor --interface can0 --duration 5s         one table about 5 s
  hydraxis can monitor machine.toml --log bus.log             a log of `hydraxis can record` or candump -l

  id         identifier, hexadecimal; eight digits are one of 29 bits
  rate       frames in a second, since the last table
  jitter     largest less smallest time between two of them, since the last table
  meaning    what the last frame says: CANopen with the names of the machine file's axes, and signals of its messages

The load counts bits without stuff bits: a bus is full before it says 100 %. Sends nothing. An interface of the kernel
can be watched while a group runs on it; a serial adapter belongs to one program.")]
pub struct MonitorBusArguments {
    #[command(flatten)]
    bus: BusArguments,
    /// A line for each frame, in the place of tables
    #[arg(long)]
    frames: bool,
    /// One table, about this time [default: a table every second, until Ctrl-C]
    #[arg(long, value_parser = duration)]
    duration: Option<Duration>,
    /// A log in the place of the bus
    #[arg(long, value_name = "FILE", conflicts_with = "duration")]
    log: Option<PathBuf>,
}

/// Time between two tables.
const EVERY: Duration = Duration::from_secs(1);

/// Shortest time that a rate is told about, ns.
const LEAST_NS: u64 = 1_000_000;

/// What has come with one identifier.
struct Seen {
    last: Frame,
    count: u64,
    last_ns: u64,
    /// Shortest and longest time between two frames, ns.
    shortest_ns: u64,
    longest_ns: u64,
}

/// Runs the command.
pub fn run(arguments: &MonitorBusArguments) -> Result<(), Failure> {
    let stop = stop_flag()?;
    if let Some(path) = &arguments.log {
        let text = bounded::read_text(path, bounded::TABLE)
            .map_err(|error| Failure::usage(format!("--log: {}: {error}", path.display())))?;
        let log =
            Playback::read(&text).map_err(|error| Failure::usage(format!("--log: {}: {error}", path.display())))?;
        let named = NamedBus::of_log(&arguments.bus, path)?;
        return play(log, Monitor::new(&named, arguments.frames)?, &named);
    }
    let named = arguments.bus.named()?;
    let mut monitor = Monitor::new(&named, arguments.frames)?;
    let mut bus = named.listen()?;
    let started_ns = monotonic_ns();
    let every_ns = arguments.duration.unwrap_or(EVERY).as_nanos() as u64;
    let mut next_ns = started_ns + every_ns;
    monitor.load = Load::new(named.rates, started_ns);
    while !stop.load(Ordering::Relaxed) {
        while let Some(received) = bus.receive().map_err(Failure::run)? {
            monitor.take(&received.frame, received.time_ns)?;
        }
        let now_ns = monotonic_ns();
        if now_ns >= next_ns {
            let passed_ns = now_ns - (next_ns - every_ns);
            monitor.tell(bus.counters(), now_ns, passed_ns, &named)?;
            next_ns = now_ns + every_ns;
            if arguments.duration.is_some() {
                break;
            }
        }
        let rest = Duration::from_nanos(next_ns.saturating_sub(monotonic_ns()));
        bus.wait(rest.min(Duration::from_millis(50))).map_err(Failure::run)?;
    }
    Ok(())
}

/// Shows a log as a whole.
fn play(mut log: Playback, mut monitor: Monitor, named: &NamedBus) -> Result<(), Failure> {
    let (mut first_ns, mut last_ns) = (None, 0);
    loop {
        match log.receive() {
            Ok(Some(received)) => {
                first_ns.get_or_insert(received.time_ns);
                last_ns = received.time_ns;
                monitor.take(&received.frame, received.time_ns)?;
            }
            Ok(None) | Err(BusError::Ended) => break,
            Err(error) => return Err(Failure::run(error)),
        }
    }
    let first_ns = first_ns.unwrap_or_default();
    let passed_ns = last_ns.saturating_sub(first_ns).max(1);
    monitor.load = Load::new(named.rates, 0);
    monitor.tell(log.counters(), passed_ns.max(EVERY.as_nanos() as u64), passed_ns, named)
}

struct Monitor {
    seen: BTreeMap<(bool, u32), Seen>,
    decoder: Decoder,
    load: Load,
    frames: bool,
    is_terminal: bool,
}

impl Monitor {
    fn new(named: &NamedBus, frames: bool) -> Result<Self, Failure> {
        Ok(Self {
            seen: BTreeMap::new(),
            decoder: Decoder::of(named)?,
            load: Load::new(named.rates, 0),
            frames,
            is_terminal: io::stdout().is_terminal(),
        })
    }

    fn take(&mut self, frame: &Frame, time_ns: u64) -> Result<(), Failure> {
        if self.frames {
            let line = format!(
                "{:>14.6}  {:>8}  {:23}  {}\n",
                time_ns as f64 * 1e-9,
                id_of(frame),
                data_of(frame),
                self.decoder.meaning(frame)
            );
            show(&line)?;
        }
        let key = (frame.is_extended(), frame.raw_id());
        let seen = self.seen.entry(key).or_insert(Seen {
            last: *frame,
            count: 0,
            last_ns: 0,
            shortest_ns: u64::MAX,
            longest_ns: 0,
        });
        if seen.last_ns > 0 {
            let passed_ns = time_ns.saturating_sub(seen.last_ns);
            seen.shortest_ns = seen.shortest_ns.min(passed_ns);
            seen.longest_ns = seen.longest_ns.max(passed_ns);
        }
        (seen.last, seen.last_ns, seen.count) = (*frame, time_ns, seen.count + 1);
        Ok(())
    }

    /// Shows the table about the time since the last one.
    fn tell(&mut self, counters: &Counters, now_ns: u64, passed_ns: u64, named: &NamedBus) -> Result<(), Failure> {
        let load = self.load.at(counters, now_ns);
        if self.frames {
            return Ok(());
        }
        let rows = self.seen.values().map(|seen| {
            let has_jitter = seen.shortest_ns <= seen.longest_ns;
            let jitter_ms = seen.longest_ns.saturating_sub(seen.shortest_ns) as f64 * 1e-6;
            vec![
                id_of(&seen.last),
                rate(seen.count, passed_ns),
                if has_jitter { format!("{jitter_ms:.2} ms") } else { "-".to_owned() },
                data_of(&seen.last),
                self.decoder.meaning(&seen.last),
            ]
        });
        let mut shown = table(&["id", "rate", "jitter", "data", "meaning"], rows.collect());
        for column in shown.column_iter_mut().skip(3) {
            column.set_cell_alignment(comfy_table::CellAlignment::Left);
        }
        let summary = format!(
            "{}: load {:.1} %, {} frames; lost {}, errors {}, bus-off {}, malformed {}",
            named.address,
            100.0 * load,
            counters.received,
            counters.lost,
            counters.errors,
            counters.bus_off,
            counters.malformed
        );
        // A table takes the place of the one before.
        if self.is_terminal {
            // A terminal that has ended is no failure; `show` passes that over as well.
            let _ = io::stdout().write_all(b"\x1b[H\x1b[J");
        }
        show(&format!("{shown}\n{summary}\n"))?;
        io::stdout().flush().map_err(Failure::run)?;
        for seen in self.seen.values_mut() {
            (seen.count, seen.shortest_ns, seen.longest_ns) = (0, u64::MAX, 0);
        }
        Ok(())
    }
}

/// Frames in a second; none about a time in which nothing could be counted, as in a log of one frame.
fn rate(count: u64, passed_ns: u64) -> String {
    if passed_ns < LEAST_NS {
        return "-".to_owned();
    }
    format!("{:.1}/s", count as f64 / (passed_ns as f64 * 1e-9))
}

fn id_of(frame: &Frame) -> String {
    if frame.is_extended() { format!("{:08X}", frame.raw_id()) } else { format!("{:03X}", frame.raw_id()) }
}

fn data_of(frame: &Frame) -> String {
    if frame.is_remote_frame() {
        return format!("remote, {} bytes", frame.dlc());
    }
    let bytes: Vec<String> = frame.data().iter().map(|byte| format!("{byte:02X}")).collect();
    let kind = match frame.format() {
        Format::Flexible { is_fast: true } => "CAN FD, fast: ",
        Format::Flexible { is_fast: false } => "CAN FD: ",
        Format::Classical | Format::Remote => "",
    };
    kind.to_owned() + &bytes.join(" ")
}
