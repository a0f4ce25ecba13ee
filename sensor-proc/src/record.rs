//! Recordings: CSV files with one row per sample.
//!
//! A row holds y(k) and the u(k) that was applied from t(k) on. Columns are chosen by name, other columns are
//! ignored. A row that is not fully numeric is refused with its line, never skipped.

use std::path::{Path, PathBuf};

/// Name of the column with the time, s.
pub const TIME_COLUMN: &str = "t";
/// A step of time that differs from the median by more than this part is counted as irregular.
const IRREGULAR: f64 = 0.5;

/// One input and one output over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Sample period, s.
    pub period: f64,
    /// Commands u(k).
    pub inputs: Vec<f64>,
    /// Outputs y(k).
    pub outputs: Vec<f64>,
    /// Steps of time that differ from the period by more than half of it.
    pub irregular_steps: usize,
}

/// Why a recording cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The file cannot be opened or is not CSV.
    #[error("{}: cannot be read as CSV: {source}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the reader says, with the line where it has one.
        source: csv::Error,
    },
    /// There is no header.
    #[error("{}: found an empty file; allowed: a header with column names, then one row per sample", file.display())]
    Empty {
        /// The file.
        file: PathBuf,
    },
    /// A column is not in the header.
    #[error("{}:1: found no column \"{column}\"; the columns are: {present}{}", file.display(), hint(.column))]
    MissingColumn {
        /// The file.
        file: PathBuf,
        /// The column.
        column: String,
        /// What the header has.
        present: String,
    },
    /// A field is not a finite number, or time does not rise.
    #[error("{}:{line}: row {row}, column \"{column}\": found {found}; allowed: {allowed}", file.display())]
    Field {
        /// The file.
        file: PathBuf,
        /// Line of the file, from 1.
        line: u64,
        /// Row of data, from 1.
        row: usize,
        /// The column.
        column: String,
        /// What is there.
        found: String,
        /// What may be there.
        allowed: &'static str,
    },
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

fn hint(column: &str) -> &'static str {
    match column {
        TIME_COLUMN => " (or give the sample period with --period)",
        _ => " (choose with --input and --output)",
    }
}

impl Record {
    /// Reads the columns `input` and `output`; the period comes from column `t` unless it is given, s.
    ///
    /// # Errors
    /// The first thing wrong, with line, row and column.
    pub fn read(file: &Path, input: &str, output: &str, period: Option<f64>) -> Result<Self, RecordError> {
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .from_path(file)
            .map_err(|source| RecordError::Read { file: file.into(), source })?;
        let header = reader.headers().map_err(|source| RecordError::Read { file: file.into(), source })?.clone();
        if header.is_empty() || header.iter().all(str::is_empty) {
            return Err(RecordError::Empty { file: file.into() });
        }
        let index = |column: &str| {
            header.iter().position(|name| name == column).ok_or_else(|| RecordError::MissingColumn {
                file: file.into(),
                column: column.to_owned(),
                present: header.iter().collect::<Vec<_>>().join(", "),
            })
        };
        let (input_at, output_at) = (index(input)?, index(output)?);
        let time_at = if period.is_some() { index(TIME_COLUMN).ok() } else { Some(index(TIME_COLUMN)?) };

        let (mut times, mut inputs, mut outputs) = (Vec::new(), Vec::new(), Vec::new());
        for (i, row) in reader.records().enumerate() {
            let row = row.map_err(|source| RecordError::Read { file: file.into(), source })?;
            let refuse = |column: &str, found: String, allowed| RecordError::Field {
                file: file.into(),
                line: row.position().map_or(i as u64 + 2, csv::Position::line),
                row: i + 1,
                column: column.to_owned(),
                found,
                allowed,
            };
            let number = |at: usize, column: &str| {
                let text = row.get(at).unwrap_or("");
                match text.parse::<f64>() {
                    Ok(value) if value.is_finite() => Ok(value),
                    _ if text.is_empty() => Err(refuse(column, "an empty field".to_owned(), "a finite number")),
                    _ => Err(refuse(column, format!("\"{text}\""), "a finite number")),
                }
            };
            if let Some(at) = time_at {
                let time = number(at, TIME_COLUMN)?;
                if let Some(&before) = times.last()
                    && time <= before
                {
                    return Err(refuse(
                        TIME_COLUMN,
                        format!("{time} after {before}"),
                        "a time later than the row before",
                    ));
                }
                times.push(time);
            }
            inputs.push(number(input_at, input)?);
            outputs.push(number(output_at, output)?);
        }
        if outputs.len() < 2 {
            let why = "to tell anything".to_owned();
            return Err(RecordError::TooFewRows { file: file.into(), rows: outputs.len(), needed: 2, why });
        }
        let mean = || (times[times.len() - 1] - times[0]) / (times.len() - 1) as f64;
        Ok(Self { period: period.unwrap_or_else(mean), irregular_steps: irregular_steps(&times), inputs, outputs })
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
    fn columns_are_found_by_name_and_the_period_by_time() {
        let record = read("k, y ,t,u\n7,1.5,0.00,-0.25\n8,1.75,0.02,0.5\n9,2,0.04,1e-3\n", None).unwrap();
        assert_eq!(record.outputs, [1.5, 1.75, 2.0]);
        assert_eq!(record.inputs, [-0.25, 0.5, 1e-3]);
        assert!((record.period - 0.02).abs() < 1e-15);
        assert_eq!(record.irregular_steps, 0);
        assert_eq!(read("u,y\n1,2\n3,4\n", Some(0.5)).unwrap().period, 0.5);
        assert_eq!(read("t,u,y\n0,1,2\n1,3,4\n2,0,0\n9,0,0\n", None).unwrap().irregular_steps, 1);
    }

    #[test]
    fn what_is_wrong_is_named_by_row_and_column() {
        for (text, expected) in [
            ("t,u,y\n0,1,2\n1,,4\n", ":3: row 2, column \"u\": found an empty field"),
            ("t,u,y\n0,1,2\n1,3,nan\n", ":3: row 2, column \"y\": found \"nan\""),
            ("t,u,y\n0,1,2\n1,inf,4\n", ":3: row 2, column \"u\": found \"inf\""),
            ("t,u,y\n0,1,2\n1,3,four\n", ":3: row 2, column \"y\": found \"four\""),
            ("t,u,y\n0,1,2\n1,3,4\n0.5,3,4\n", ":4: row 3, column \"t\": found 0.5 after 1"),
            ("t,u,y\n0,1,2\n0,3,4\n", ":3: row 2, column \"t\": found 0 after 0"),
            ("t,u,z\n0,1,2\n1,3,4\n", ":1: found no column \"y\"; the columns are: t, u, z"),
            (
                "u,y\n1,2\n3,4\n",
                ":1: found no column \"t\"; the columns are: u, y (or give the sample period with --period)",
            ),
            ("", "found an empty file"),
            ("t,u,y\n", "found 0 rows; allowed: at least 2"),
            ("t,u,y\n0,1,2\n1,3\n", "cannot be read as CSV"),
        ] {
            let error = read(text, None).expect_err(text).to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
        let missing = Record::read(Path::new("/nowhere/r.csv"), "u", "y", None).unwrap_err().to_string();
        assert!(missing.starts_with("/nowhere/r.csv: cannot be read as CSV"), "{missing}");
    }
}
