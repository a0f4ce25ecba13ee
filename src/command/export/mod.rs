//! `hydraxis export`: a recording as a table, for other tools.

mod channel;
mod csv;
mod loop_table;
mod parquet;
mod sheet;
mod table;
mod units;

use std::{path::PathBuf, time::Duration};

use clap::Args;
use pipeline::{message::CHANNELS, nearest::did_you_mean};

use crate::{
    arguments::values::{seconds, time},
    failure::Failure,
    recording::{
        controller_state, lock_step_period,
        reading::{ReadMessage, Reading, ReadingError},
    },
};
use channel::ChannelTable;
use loop_table::LoopTable;
use sheet::Sheet;

/// `export`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis export demo.mcap --csv demo.csv                           a row for each tick, all axes
  hydraxis plot demo.csv --output demo.svg
  hydraxis export demo.mcap --csv - --axis boom --from 10s --to 20s
  hydraxis export demo.mcap --parquet demo.parquet
  hydraxis export demo.mcap --csv health.csv --channel stage-health  every number of a channel, a row for each message

Without --channel the columns are t, tick, and for each axis command, position, velocity, reference, error, mode, flags
and faults. A row is a sample with the command that was made of it; the command is empty where there is none. Times are
in s since the first row, or the first message, of the recording; the rows of a run in lock-step have the time of the
machine. Everything is in SI units.")]
pub struct ExportArguments {
    /// A recording, or a black box
    #[arg(value_name = "FILE.mcap")]
    pub file: PathBuf,
    /// Where the table goes
    #[command(flatten)]
    pub to: TableFile,
    /// All numbers of this channel in the place of the table of the ticks
    #[arg(long, value_name = "NAME")]
    pub channel: Option<String>,
    /// Only this axis; may be given several times [default: all axes]
    #[arg(long = "axis", value_name = "NAME")]
    pub axes: Vec<String>,
    /// Begin at this time
    #[arg(long, value_name = "TIME", value_parser = time)]
    pub from: Option<Duration>,
    /// End at this time
    #[arg(long = "to", value_name = "TIME", value_parser = seconds)]
    pub until: Option<Duration>,
    /// Only every N-th row
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    pub every: u64,
    /// Write a second row with the units; Parquet has them in its metadata
    #[arg(long, conflicts_with = "parquet")]
    pub units: bool,
}

/// The file of a table, in one of the formats.
#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
pub struct TableFile {
    /// The table as CSV, a file or - for standard output
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// The table as Parquet, a file
    #[arg(long, value_name = "FILE")]
    pub parquet: Option<PathBuf>,
}

/// A table that is filled message by message.
trait Rows {
    /// Takes a message in; the rows that are complete by it are written.
    fn message(&mut self, message: &ReadMessage, axes: &[String], out: &mut Sheet) -> Result<(), Failure>;
    /// Writes the rows that wait for more.
    fn finish(&mut self, out: &mut Sheet) -> Result<(), Failure>;
}

/// Runs the command.
pub fn run(arguments: &ExportArguments) -> Result<(), Failure> {
    let channels = [&CHANNELS[..], &[controller_state::CHANNEL]].concat();
    if let Some(unknown) = arguments.channel.as_deref().filter(|name| !channels.contains(name)) {
        let hint = did_you_mean(unknown, channels.iter().copied());
        let allowed = channels.join(", ");
        return Err(Failure::usage(format!("--channel: found \"{unknown}\"; allowed: one of {allowed}{hint}")));
    }
    let mut reading = Reading::open(&arguments.file).map_err(Failure::usage)?;
    // The first message shows whether the file is a recording, before another file is overwritten.
    let mut message = reading.next().map_err(Failure::usage)?;
    let mut rows: Box<dyn Rows> = match &arguments.channel {
        Some(channel) => Box::new(ChannelTable::new(channel.clone(), arguments.axes.clone())),
        None => Box::new(LoopTable::new(arguments.axes.clone(), lock_step_period(reading.facts()))),
    };
    expect_axes(arguments, &reading)?;
    let mut out = Sheet::open(arguments)?;
    while let Some(read) = message {
        rows.message(&read, &reading.axes(), &mut out)?;
        message = reading.next().map_err(Failure::usage)?;
    }
    rows.finish(&mut out)?;
    out.finish(&reading)
}

/// Refuses an axis that the recording does not name.
fn expect_axes(arguments: &ExportArguments, reading: &Reading) -> Result<(), Failure> {
    let all = reading.axes();
    match arguments.axes.iter().find(|axis| !all.contains(axis)) {
        Some(unknown) => {
            let allowed = format!("{}{}", all.join(", "), did_you_mean(unknown, all.iter().map(String::as_str)));
            Err(Failure::usage(format!("--axis: found \"{unknown}\"; allowed: one of {allowed}")))
        }
        None => Ok(()),
    }
}

impl From<ReadingError> for Failure {
    fn from(error: ReadingError) -> Self {
        Self::usage(error)
    }
}
