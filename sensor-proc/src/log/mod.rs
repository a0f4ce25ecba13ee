//! Recordings as loggers write them, with their gaps. They are read as a whole, never in a stage's loop.
//!
//! | module | what it finds |
//! |---|---|
//! | `text` | encoding and separator |
//! | `header` | the columns, by name or by number |
//! | `unit` | their units |
//! | `number` | decimal points or decimal commas |
//! | `time` | time stamps |
//! | `stretches` | gaps and the period |
//!
//! Trap: [`Recording`](crate::Recording) is read for a replay, which needs a sample at every tick. So it takes one
//! format, and no gaps.

mod header;
mod number;
mod rate;
mod reader;
mod stretches;
mod text;
mod time;
mod unit;

use std::path::Path;

use pipeline::columns::TableError;
use serde::Serialize;

use self::{reader::Reader, text::Text};

pub use rate::{PeriodChange, contradict};
pub use stretches::{Cause, Gap, Gaps};

/// What is to be read.
#[derive(Debug, Clone, Default)]
pub struct Wanted {
    /// Name or number of the column of the input.
    pub input: String,
    /// Name or number of the column of the output.
    pub output: String,
    /// Name or number of the column of the time, or `none`. Without it, a column with a usual name is taken.
    pub time: Option<String>,
    /// Columns, each with its unit. They take the place of the units in the file.
    pub units: Vec<(String, String)>,
    /// The period, s, where it does not come from the times.
    pub period: Option<f64>,
}

/// What a file was found to be.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Found {
    /// What separates the fields.
    pub separator: &'static str,
    /// Decimal points or commas.
    pub decimal: &'static str,
    /// Encoding of the text.
    pub encoding: &'static str,
    /// Whether the first row has the names of the columns.
    pub header: bool,
    /// Whether the row below it has their units.
    pub units_row: bool,
    /// Whether the times may be in milliseconds: they have no unit, and in seconds the period is long.
    pub is_time_doubtful: bool,
    /// The period that the times have, s, where another one was given.
    pub contradicting_period_s: Option<f64>,
    /// How the time is written; none without a time.
    pub time_form: Option<&'static str>,
    /// The column of the time.
    pub time: Option<FoundColumn>,
    /// The column of the input.
    pub input: FoundColumn,
    /// The column of the output.
    pub output: FoundColumn,
}

/// A column that was read.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FoundColumn {
    /// Its name; its number in a file without a header.
    pub name: String,
    /// The stated unit.
    pub unit: Option<String>,
    /// The unit of the values after reading; `1` for a number without a unit.
    pub becomes: Option<&'static str>,
}

/// One input and one output over time, with gaps.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    /// Commands u(k).
    pub inputs: Vec<f64>,
    /// Outputs y(k).
    pub outputs: Vec<f64>,
    /// Whether row k begins a stretch: the row before it is not the sample before it.
    pub begins: Vec<bool>,
    /// Times of the rows, s; none where the recording has none.
    pub times: Vec<f64>,
    /// Sample period, s.
    pub period: f64,
    /// Number of steps of time that are shorter than half of the median step.
    pub short_steps: usize,
    /// The gaps.
    pub gaps: Gaps,
    /// What the file was found to be.
    pub found: Found,
}

impl Log {
    /// Reads a recording.
    ///
    /// # Errors
    /// The error names the file and, for wrong content, line, row and column.
    pub fn read(file: &Path, wanted: &Wanted) -> Result<Self, TableError> {
        let text = Text::read(file)?;
        let refuse = |problems| TableError { file: file.to_owned(), problems };
        let mut reader = Reader::new(&text, wanted).map_err(|problem| refuse(vec![problem]))?;
        let mut rows_read = reader.read(&text).map_err(refuse)?;
        let (begins, timing) = rows_read.stretches();
        let period = reader.period(wanted, &rows_read, &timing).map_err(|problem| refuse(vec![problem]))?;
        let mut found = reader.found(&text, period);
        found.is_time_doubtful &= wanted.period.is_none();
        found.contradicting_period_s = timing.period().filter(|timed| contradict(*timed, period));
        Ok(Self {
            begins,
            period,
            short_steps: timing.short_steps,
            gaps: rows_read.gaps,
            found,
            times: rows_read.times,
            inputs: rows_read.inputs,
            outputs: rows_read.outputs,
        })
    }
}
