//! Recordings: CSV files with one row per sample. They are read before the first tick, never in the loop.
//!
//! A row holds y(k) and the u(k) that was applied from t(k) on. Columns are chosen by name; other columns are ignored.

mod error;

use std::{path::Path, time::Duration};

use pipeline::{
    columns::{Table, TableProblem},
    machine::Machine,
};

pub use error::{RecordingError, ReplayError};

/// Name of the column with the time, s.
pub const TIME_COLUMN: &str = "t";
/// A step of time is irregular if it differs from the median step by more than this part of the median.
const IRREGULAR: f64 = 0.5;
/// Sample periods that a recording can have, s: from a nanosecond, the resolution of a duration, to half a year.
pub(crate) const PERIODS: std::ops::RangeInclusive<f64> = 1e-9..=1.6e7;
/// Largest part by which the mean period of a recording may differ from the period of the machine that replays it.
const PERIOD_TOLERANCE: f64 = 0.01;

/// One input and one output over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    /// Sample period, s.
    pub period: f64,
    /// Commands u(k).
    pub inputs: Vec<f64>,
    /// Outputs y(k).
    pub outputs: Vec<f64>,
    /// Number of steps of time that differ from the median step by more than half of it.
    pub irregular_steps: usize,
}

impl Recording {
    /// Reads the columns `input` and `output`. The period comes from column `t` unless it is given, s.
    ///
    /// # Errors
    /// The error names the file and, for wrong content, line, row and column.
    pub fn read(file: &Path, input: &str, output: &str, period: Option<f64>) -> Result<Self, RecordingError> {
        let table = Table::read(file)?;
        let timed = table.has(TIME_COLUMN);
        let needs_time = timed || period.is_none();
        let names = [input, output, TIME_COLUMN];
        let columns = table.numbers(if needs_time { &names } else { &names[..2] }, TIME_COLUMN).map_err(|error| {
            if !table.has(input) || !table.has(output) {
                RecordingError::NoColumn(error)
            } else if needs_time && !timed {
                RecordingError::NoTime(error)
            } else {
                RecordingError::Table(error)
            }
        })?;
        let mut values = columns.values.into_iter();
        let mut next = || values.next().unwrap_or_default();
        let (inputs, outputs, times) = (next(), next(), next());
        if outputs.len() < 2 {
            let purpose = "to tell anything".to_owned();
            return Err(RecordingError::TooFewRows { file: file.into(), rows: outputs.len(), needed: 2, purpose });
        }
        let mean = || (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
        let period = period.unwrap_or_else(mean);
        if !PERIODS.contains(&period) {
            let found = format!("a period of {period:e} s in column \"{TIME_COLUMN}\"");
            let allowed = format!("{:e} to {:e} s", PERIODS.start(), PERIODS.end());
            return Err(table.error(vec![TableProblem { line: None, field: None, found, allowed }]).into());
        }
        Ok(Self { period, irregular_steps: irregular_steps(&times), inputs, outputs })
    }

    /// Reads the columns of every axis of `machine`, for a replay. A file without a column `t` is taken to have the
    /// machine's period.
    ///
    /// # Errors
    /// The columns of an axis cannot be read, or the file was recorded with another period than the machine's.
    pub fn read_all(machine: &Machine, file: &Path) -> Result<Vec<Self>, ReplayError> {
        let period = machine.timing.period;
        let mut recordings = Vec::with_capacity(machine.axes.len());
        for axis in &machine.axes {
            let (input, output) = &axis.columns;
            let recording = match Self::read(file, input, output, None) {
                Err(RecordingError::NoTime(_)) => Self::read(file, input, output, Some(period.as_secs_f64()))?,
                other => other?,
            };
            recording.expect_period(period, file)?;
            recordings.push(recording);
        }
        Ok(recordings)
    }

    /// Refuses a recording whose mean period is not `period`, within 1 %.
    ///
    /// # Errors
    /// It was recorded with another period.
    pub fn expect_period(&self, period: Duration, file: &Path) -> Result<(), ReplayError> {
        let expected = period.as_secs_f64();
        if (self.period / expected - 1.0).abs() > PERIOD_TOLERANCE {
            return Err(ReplayError::Period { file: file.into(), found: self.period, expected });
        }
        Ok(())
    }
}

fn irregular_steps(times: &[f64]) -> usize {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if steps.is_empty() {
        return 0;
    }
    steps.sort_by(f64::total_cmp);
    let median = steps[steps.len() / 2];
    steps.iter().filter(|step| (*step - median).abs() > IRREGULAR * median).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, period: Option<f64>) -> Result<Recording, RecordingError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        Recording::read(file.path(), "u", "y", period)
    }

    #[test]
    fn the_period_comes_from_column_t_unless_it_is_given() {
        let recording = read("k, y ,t,u\n7,1.5,0.00,-0.25\n8,1.75,0.02,0.5\n9,2,0.04,1e-3\n", None).unwrap();
        assert_eq!(recording.outputs, [1.5, 1.75, 2.0]);
        assert_eq!(recording.inputs, [-0.25, 0.5, 1e-3]);
        assert!((recording.period - 0.02).abs() < 1e-15);
        assert_eq!(recording.irregular_steps, 0);
        assert_eq!(read("u,y\n1,2\n3,4\n", Some(0.5)).unwrap().period, 0.5);
        assert_eq!(read("t,u,y\n0,1,2\n1,3,4\n2,0,0\n9,0,0\n", None).unwrap().irregular_steps, 1);
    }

    #[test]
    fn files_that_are_no_recordings_are_refused_with_the_place_of_the_error() {
        for (text, expected) in [
            ("t,u,y\n0,1,2\n1,3,nan\n", ":3: row 2, column \"y\": found \"nan\""),
            ("t,u,y\n0,1,2\n1,3,4\n0.5,3,4\n", ":4: row 3, column \"t\": found 0.5 after 1"),
            ("t,u,z\n0,1,2\n1,3,4\n", ":1: found no column \"y\"; the columns are: t, u, z"),
            ("u,y\n1,2\n3,4\n", "allowed: a header with \"t\" (or give the sample period with --period)"),
            ("t,u,y\n", "found 0 rows; allowed: at least 2"),
            ("t,u,y\n0,1,2\n1e-12,1,2\n", "found a period of 1e-12 s in column \"t\"; allowed: 1e-9 to"),
            ("t,u,y\n0,1,2\n1e300,1,2\n", "found a period of 1e300 s in column \"t\""),
        ] {
            let error = read(text, None).expect_err(text).to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
        let missing = Recording::read(Path::new("/nowhere/r.csv"), "u", "y", None).unwrap_err().to_string();
        assert!(missing.contains("/nowhere/r.csv: found a file that cannot be read"), "{missing}");
    }
}
