//! `hydraxis export`: a recording as CSV, for other tools.

mod channel;
mod loop_table;

use std::{io::Write, path::PathBuf, time::Duration};

use clap::Args;
use pipeline::{message::CHANNELS, nearest::did_you_mean};

use crate::{
    arguments::values::seconds,
    failure::Failure,
    recording::reading::{ReadMessage, Reading, ReadingError},
    report::output::{OutputError, create, is_stdout},
};
use channel::ChannelTable;
use loop_table::LoopTable;

/// `export`.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  hydraxis export demo.mcap --csv demo.csv                           a row for each tick, all axes
  hydraxis plot demo.csv --output demo.svg
  hydraxis export demo.mcap --csv - --axis boom --from 10s --to 20s
  hydraxis export demo.mcap --csv health.csv --channel stage-health  every number of a channel, a row for each message

Without --channel the columns are t, tick, and for each axis command, position, velocity, reference, error, mode, flags
and faults. A row is a sample with the command that was made of it; the command is empty where there is none. Times are
in s since the first row, or the first message, of the recording; everything is in SI units.")]
pub struct ExportArguments {
    /// A recording, or a black box
    #[arg(value_name = "FILE.mcap")]
    pub file: PathBuf,
    /// The table, a file or - for standard output
    #[arg(long, value_name = "FILE")]
    pub csv: PathBuf,
    /// All numbers of this channel in the place of the table of the ticks
    #[arg(long, value_name = "NAME")]
    pub channel: Option<String>,
    /// Only this axis; may be given several times [default: all axes]
    #[arg(long = "axis", value_name = "NAME")]
    pub axes: Vec<String>,
    /// Begin at this time
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub from: Option<Duration>,
    /// End at this time
    #[arg(long, value_name = "TIME", value_parser = seconds)]
    pub to: Option<Duration>,
    /// Only every N-th row
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    pub every: u64,
    /// Write a second row with the units
    #[arg(long)]
    pub units: bool,
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
    if let Some(unknown) = arguments.channel.as_deref().filter(|name| !CHANNELS.contains(name)) {
        let hint = did_you_mean(unknown, CHANNELS.iter().copied());
        let allowed = CHANNELS.join(", ");
        return Err(Failure::usage(format!("--channel: found \"{unknown}\"; allowed: one of {allowed}{hint}")));
    }
    let mut reading = Reading::open(&arguments.file).map_err(Failure::usage)?;
    let mut rows: Box<dyn Rows> = match &arguments.channel {
        Some(channel) => Box::new(ChannelTable::new(channel.clone(), arguments.axes.clone())),
        None => Box::new(LoopTable::new(arguments.axes.clone())),
    };
    // The first message shows whether the file is a recording, before another file is overwritten.
    let mut message = reading.next().map_err(Failure::usage)?;
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

/// The file that rows are written to, as far as they were asked for.
struct Sheet {
    path: PathBuf,
    writer: csv::Writer<Box<dyn Write>>,
    from: f64,
    to: f64,
    every: u64,
    has_units: bool,
    has_header: bool,
    /// Rows within the asked times.
    rows: u64,
    written: u64,
}

impl Sheet {
    fn open(arguments: &ExportArguments) -> Result<Self, Failure> {
        let file = create("--csv", &arguments.csv)?;
        Ok(Self {
            path: arguments.csv.clone(),
            writer: csv::Writer::from_writer(file),
            from: arguments.from.map_or(f64::NEG_INFINITY, |from| from.as_secs_f64()),
            to: arguments.to.map_or(f64::INFINITY, |to| to.as_secs_f64()),
            every: arguments.every,
            has_units: arguments.units,
            has_header: false,
            rows: 0,
            written: 0,
        })
    }

    /// Writes names and units of the columns before the first row.
    fn header(&mut self, columns: impl FnOnce() -> Vec<(String, &'static str)>) -> Result<(), Failure> {
        if std::mem::replace(&mut self.has_header, true) {
            return Ok(());
        }
        let columns = columns();
        let names = self.writer.write_record(columns.iter().map(|(name, _)| name));
        self.written(names)?;
        if self.has_units {
            let units = self.writer.write_record(columns.iter().map(|(_, unit)| unit));
            self.written(units)?;
        }
        Ok(())
    }

    /// Writes the row of time `t`, s, if it was asked for.
    fn row(&mut self, t: f64, values: impl FnOnce() -> Vec<String>) -> Result<(), Failure> {
        if t < self.from || t > self.to {
            return Ok(());
        }
        self.rows += 1;
        if !(self.rows - 1).is_multiple_of(self.every) {
            return Ok(());
        }
        self.written += 1;
        let written = self.writer.write_record(values());
        self.written(written)
    }

    fn written(&self, result: csv::Result<()>) -> Result<(), Failure> {
        result.map_err(|error| Failure::run(error).about(format!("--csv: {}", self.path.display())))
    }

    /// Ends the file, and says what was written.
    fn finish(mut self, reading: &Reading) -> Result<(), Failure> {
        if let Err(source) = self.writer.flush() {
            return Err(OutputError::Write { option: "--csv", path: self.path, source }.into());
        }
        if let Some(damage) = reading.damage() {
            eprintln!("warning: read as far as it goes: byte {}: {}", damage.byte, damage.what);
        }
        if self.written == 0 {
            return Err(Failure::run("found no row: no such message in the recording, or none within --from and --to"));
        }
        if !is_stdout(&self.path) {
            println!("{}: {} rows", self.path.display(), self.written);
        }
        Ok(())
    }
}

impl From<ReadingError> for Failure {
    fn from(error: ReadingError) -> Self {
        Self::usage(error)
    }
}
