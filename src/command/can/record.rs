//! `hydraxis can record`: the frames of a bus as a log that candump and its tools read.

use std::{
    fs::File,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
    sync::atomic::Ordering,
    time::{Duration, SystemTime},
};

use can::{Received, bus::write_line};
use clap::Args;
use pipeline::stage::monotonic_ns;

use super::bus::{BusArguments, duration};
use crate::{failure::Failure, group::signals::stop_flag};

/// `can record`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis can record --interface can0 --out bus.log                 until Ctrl-C
  hydraxis can record machine.toml --out bus.log --duration 1min
  hydraxis can monitor machine.toml --log bus.log                    shows what was recorded

The log is that of `candump -l`: canplayer plays it, and python-can, cantools and Wireshark read it. Sends nothing. An
interface of the kernel can be recorded while a group runs on it. A serial adapter belongs to one program: there it is
refused while a group has it. Frames that the kernel or the adapter has lost are counted at the end, and make exit
code 1.")]
pub struct RecordBusArguments {
    #[command(flatten)]
    bus: BusArguments,
    /// File to be written, or - for standard output; a file that is there is not overwritten
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// How long [default: until Ctrl-C]
    #[arg(long, value_parser = duration)]
    duration: Option<Duration>,
}

fn create(path: &Path) -> Result<Box<dyn Write>, Failure> {
    if path == Path::new("-") {
        return Ok(Box::new(io::stdout()));
    }
    let file = File::create_new(path).map_err(|error| {
        let allowed = "a file that is not there yet, in a folder that this user may write to";
        Failure::usage(format!("--out: {}: {error}; allowed: {allowed}", path.display()))
    })?;
    Ok(Box::new(BufWriter::new(file)))
}

/// Runs the command.
pub fn run(arguments: &RecordBusArguments) -> Result<(), Failure> {
    let named = arguments.bus.named()?;
    let stop = stop_flag()?;
    let mut bus = named.listen()?;
    let mut out = create(&arguments.out)?;
    // Logs have the time of the day. It is taken once, so that a clock that is set leaves no gap.
    let started_ns = monotonic_ns();
    let today = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_nanos() as u64;
    let path = named.address.to_string();
    let interface = path.rsplit('/').next().unwrap_or(&path);
    let until_ns = arguments.duration.map_or(u64::MAX, |duration| started_ns + duration.as_nanos() as u64);
    let mut failed = Ok(());
    while failed.is_ok() && !stop.load(Ordering::Relaxed) && monotonic_ns() < until_ns {
        failed = loop {
            match bus.receive() {
                Ok(Some(Received { frame, time_ns })) => {
                    let time_ns = today + time_ns.saturating_sub(started_ns);
                    if let Err(error) = write_line(&mut out, &Received { frame, time_ns }, interface) {
                        break Err(Failure::run(error).about("--out"));
                    }
                }
                Ok(None) => break bus.wait(Duration::from_millis(20)).map_err(Failure::run),
                Err(error) => break Err(Failure::run(error)),
            }
        };
    }
    // What has come before an error is kept.
    out.flush().map_err(|error| Failure::run(error).about("--out"))?;
    let counters = *bus.counters();
    eprintln!(
        "{} frames in {:.1} s; lost {}, errors {}, malformed {}",
        counters.received,
        monotonic_ns().saturating_sub(started_ns) as f64 * 1e-9,
        counters.lost,
        counters.errors + counters.bus_off,
        counters.malformed
    );
    failed?;
    match counters.lost {
        0 => Ok(()),
        lost => Err(Failure::run(format!("{path}: {lost} frames were lost before they could be recorded"))),
    }
}
