//! The rows that were asked for, into the file that was asked for.

use std::path::PathBuf;

use crate::{
    failure::Failure,
    recording::{reading::Reading, schema::Value},
    report::output::is_stdout,
};

use super::{
    ExportArguments,
    csv::CsvTable,
    parquet::ParquetTable,
    table::{Heading, Table},
};

/// The headings of a table.
enum Headings {
    Unknown,
    Waiting(Vec<Heading>),
    Written,
}

/// The table that was asked for.
pub(super) struct Sheet {
    path: PathBuf,
    table: Box<dyn Table>,
    from: f64,
    to: f64,
    every: u64,
    headings: Headings,
    /// Rows within the asked times.
    rows: u64,
    written: u64,
}

impl Sheet {
    pub(super) fn open(arguments: &ExportArguments) -> Result<Self, Failure> {
        let (path, table): (_, Box<dyn Table>) = match (&arguments.to.csv, &arguments.to.parquet) {
            (Some(path), _) => (path, Box::new(CsvTable::create(path, arguments.units)?)),
            (None, Some(path)) => (path, Box::new(ParquetTable::create(path)?)),
            (None, None) => return Err(Failure::usage("found neither --csv nor --parquet; allowed: one of them")),
        };
        Ok(Self {
            path: path.clone(),
            table,
            from: arguments.from.map_or(f64::NEG_INFINITY, |from| from.as_secs_f64()),
            to: arguments.until.map_or(f64::INFINITY, |to| to.as_secs_f64()),
            every: arguments.every,
            headings: Headings::Unknown,
            rows: 0,
            written: 0,
        })
    }

    /// Takes the headings, which are written before the first row: a table without rows takes the place of no other
    /// one. `t` is not among `headings`.
    pub(super) fn headings(&mut self, headings: impl FnOnce() -> Vec<Heading>) {
        if matches!(self.headings, Headings::Unknown) {
            self.headings = Headings::Waiting([Heading::time()].into_iter().chain(headings()).collect());
        }
    }

    /// Writes the row of time `t`, s, if it was asked for.
    pub(super) fn row(&mut self, t: f64, values: impl FnOnce() -> Vec<Option<Value>>) -> Result<(), Failure> {
        if t < self.from || t > self.to {
            return Ok(());
        }
        self.rows += 1;
        if !(self.rows - 1).is_multiple_of(self.every) {
            return Ok(());
        }
        self.written += 1;
        if let Headings::Waiting(headings) = std::mem::replace(&mut self.headings, Headings::Written) {
            self.table.headings(&headings)?;
        }
        self.table.row(t, &values())
    }

    /// Ends the file, and says what was written.
    pub(super) fn finish(mut self, reading: &Reading) -> Result<(), Failure> {
        if let Some(damage) = reading.damage() {
            eprintln!("warning: read as far as it goes: byte {}: {}", damage.byte, damage.what);
        }
        if self.written == 0 {
            return Err(Failure::run("found no row: no such message in the recording, or none within --from and --to"));
        }
        self.table.finish(reading)?;
        if !is_stdout(&self.path) {
            println!("{}: {} rows", self.path.display(), self.written);
        }
        Ok(())
    }
}
