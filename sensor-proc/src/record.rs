//! Recordings: CSV files with one row per sample.
//!
//! A row holds y(k) and the u(k) that was applied from t(k) on. Columns are chosen by name, other columns are
//! ignored.

use std::path::{Path, PathBuf};

use pipeline::columns::{Table, TableError, TableProblem};

/// Name of the column with the time, s.
pub const TIME_COLUMN: &str = "t";
/// A step of time that differs from the median by more than this part is counted as irregular.
const IRREGULAR: f64 = 0.5;
/// Sample periods that a record can have, s: a nanosecond, the resolution of a duration, to half a year.
const PERIODS: std::ops::RangeInclusive<f64> = 1e-9..=1.6e7;

/// One input and one output over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Sample period, s.
    pub period: f64,
    /// Commands u(k).
    pub inputs: Vec<f64>,
    /// Outputs y(k).
    pub outputs: Vec<f64>,
    /// Steps of time that differ from the median step by more than half of it.
    pub irregular_steps: usize,
}

/// Why a recording cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The file is not a table of finite numbers with these columns.
    #[error(transparent)]
    Table(#[from] TableError),
    /// There is no time, and no period was given.
    #[error("{} (or give the sample period with --period)", .0)]
    NoTime(TableError),
    /// The input or the output is not there.
    #[error("{} (choose with --input and --output, in a machine file with axis.NAME.columns)", .0)]
    NoColumn(TableError),
    /// There are too few rows.
    #[error("{}: found {rows} rows; allowed: at least {needed} {why}", file.display())]
    TooFewRows {
        /// The file.
        file: PathBuf,
        /// Rows found.
        rows: usize,
        /// Rows needed.
        needed: usize,
        /// What for.
        why: String,
    },
}

impl Record {
    /// Reads the columns `input` and `output`; the period comes from column `t` unless it is given, s.
    ///
    /// # Errors
    /// What is wrong, with line, row and column.
    pub fn read(file: &Path, input: &str, output: &str, period: Option<f64>) -> Result<Self, RecordError> {
        let table = Table::read(file)?;
        let timed = table.has(TIME_COLUMN);
        let needed = timed || period.is_none();
        let names = [input, output, TIME_COLUMN];
        let columns = table.numbers(if needed { &names } else { &names[..2] }, TIME_COLUMN).map_err(|error| {
            if !table.has(input) || !table.has(output) {
                RecordError::NoColumn(error)
            } else if needed && !timed {
                RecordError::NoTime(error)
            } else {
                RecordError::Table(error)
            }
        })?;
        let mut values = columns.values.into_iter();
        let mut next = || values.next().unwrap_or_default();
        let (inputs, outputs, times) = (next(), next(), next());
        if outputs.len() < 2 {
            let why = "to tell anything".to_owned();
            return Err(RecordError::TooFewRows { file: file.into(), rows: outputs.len(), needed: 2, why });
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

    fn read(text: &str, period: Option<f64>) -> Result<Record, RecordError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        Record::read(file.path(), "u", "y", period)
    }

    #[test]
    fn the_period_comes_from_the_time_or_is_given() {
        let record = read("k, y ,t,u\n7,1.5,0.00,-0.25\n8,1.75,0.02,0.5\n9,2,0.04,1e-3\n", None).unwrap();
        assert_eq!(record.outputs, [1.5, 1.75, 2.0]);
        assert_eq!(record.inputs, [-0.25, 0.5, 1e-3]);
        assert!((record.period - 0.02).abs() < 1e-15);
        assert_eq!(record.irregular_steps, 0);
        assert_eq!(read("u,y\n1,2\n3,4\n", Some(0.5)).unwrap().period, 0.5);
        assert_eq!(read("t,u,y\n0,1,2\n1,3,4\n2,0,0\n9,0,0\n", None).unwrap().irregular_steps, 1);
    }

    #[test]
    fn what_is_no_record_is_refused() {
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
        let missing = Record::read(Path::new("/nowhere/r.csv"), "u", "y", None).unwrap_err().to_string();
        assert!(missing.contains("/nowhere/r.csv: found a file that cannot be read"), "{missing}");
    }
}
