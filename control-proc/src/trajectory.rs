//! A trajectory's CSV file, read once and refused by row and column.
//!
//! ```text
//! g(t) = p_i + (p_i+1 - p_i) (t - t_i) / (t_i+1 - t_i)     for t_i <= t < t_i+1
//! ```
//!
//! t time in s, p position in m; before the first row the first position holds, after the last the last. Trap: a row
//! that does not read is not skipped, a straight line over it would be a motion nobody planned.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use pipeline::machine::Axis;

/// The most problems that are listed; a file of the wrong kind has one in every row.
const MAX_PROBLEMS: usize = 20;

/// Points (s, m) with straight lines between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    points: Vec<(f64, f64)>,
}

/// What is wrong with one row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RowProblem {
    /// Line of the file, the header being line 1.
    pub line: u64,
    /// Column, empty for the row as a whole.
    pub column: String,
    /// What was found.
    pub found: String,
    /// What is allowed.
    pub allowed: String,
}

impl fmt::Display for RowProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, column, found, allowed } = self;
        write!(f, "row {line}, column \"{column}\": found {found}; allowed: {allowed}")
    }
}

/// Why a trajectory's file is refused.
#[derive(Debug, thiserror::Error)]
pub enum TrajectoryError {
    /// It cannot be opened or read.
    #[error("{}: cannot be read: {source}", file.display())]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// What the reader said.
        source: csv::Error,
    },
    /// A column is not there.
    #[error("{}: row 1: found columns {found:?}; allowed: a header with a column \"{column}\"", file.display())]
    MissingColumn {
        /// The file.
        file: PathBuf,
        /// The missing column.
        column: String,
        /// Those that are there.
        found: Vec<String>,
    },
    /// No row below the header.
    #[error("{}: found no row below the header; allowed: at least one", file.display())]
    Empty {
        /// The file.
        file: PathBuf,
    },
    /// Rows that cannot be followed.
    #[error("{}", problems.iter().map(|p| format!("{}: {p}", file.display())).collect::<Vec<_>>().join("\n"))]
    Rows {
        /// The file.
        file: PathBuf,
        /// At least one, the first twenty.
        problems: Vec<RowProblem>,
    },
}

impl Trajectory {
    /// Straight lines through `points` (s, m) whose times rise; at least one.
    pub fn through(points: Vec<(f64, f64)>) -> Self {
        Self { points }
    }

    /// Reads columns `t` (s) and `column` (m) of a CSV file for `axis`.
    ///
    /// # Errors
    /// The file cannot be read, has no such column or no row, or has rows with text, not finite numbers, a time that
    /// does not rise, a position outside the soft limits or a speed over `max_speed`.
    pub fn read(file: &Path, column: &str, axis: &Axis) -> Result<Self, TrajectoryError> {
        let unreadable = |source| TrajectoryError::Unreadable { file: file.to_owned(), source };
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(file).map_err(unreadable)?;
        let headers = reader.headers().map_err(unreadable)?.clone();
        let find = |name: &str| {
            headers.iter().position(|header| header == name).ok_or_else(|| TrajectoryError::MissingColumn {
                file: file.to_owned(),
                column: name.to_owned(),
                found: headers.iter().map(str::to_owned).collect(),
            })
        };
        let columns = [(find("t")?, "t"), (find(column)?, column)];

        let mut rows = Rows { axis, columns, points: Vec::new(), problems: Vec::new() };
        for record in reader.records() {
            match record {
                Ok(record) => rows.take(&record),
                Err(error) if error.is_io_error() => return Err(unreadable(error)),
                Err(error) => rows.refuse(
                    error.position().map_or(0, csv::Position::line),
                    "",
                    error.to_string(),
                    "as many fields as the header has".to_owned(),
                ),
            }
        }
        let file = file.to_owned();
        if !rows.problems.is_empty() {
            Err(TrajectoryError::Rows { file, problems: rows.problems })
        } else if rows.points.is_empty() {
            Err(TrajectoryError::Empty { file })
        } else {
            Ok(Self { points: rows.points })
        }
    }

    /// g(t), m, for `t` in s.
    pub fn position(&self, t: f64) -> f64 {
        let after = self.points.partition_point(|point| point.0 <= t);
        match (after.checked_sub(1).and_then(|i| self.points.get(i)), self.points.get(after)) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * ((t - a.0) / (b.0 - a.0)),
            (Some(only), None) | (None, Some(only)) => only.1,
            (None, None) => f64::NAN,
        }
    }

    /// Time of the last point, s.
    pub fn end(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.0)
    }
}

/// The rows of a file as far as they are read.
struct Rows<'a> {
    axis: &'a Axis,
    columns: [(usize, &'a str); 2],
    points: Vec<(f64, f64)>,
    problems: Vec<RowProblem>,
}

impl Rows<'_> {
    fn refuse(&mut self, line: u64, column: &str, found: String, allowed: String) {
        if self.problems.len() < MAX_PROBLEMS {
            self.problems.push(RowProblem { line, column: column.to_owned(), found, allowed });
        }
    }

    fn take(&mut self, record: &csv::StringRecord) {
        let line = record.position().map_or(0, csv::Position::line);
        let mut values = [0.0; 2];
        let mut readable = true;
        for (value, (index, name)) in values.iter_mut().zip(self.columns) {
            let text = record.get(index).unwrap_or_default();
            match text.parse::<f64>() {
                Ok(number) if number.is_finite() => *value = number,
                _ => {
                    self.refuse(line, name, format!("\"{text}\""), "a finite number".to_owned());
                    readable = false;
                }
            }
        }
        if readable {
            self.append(line, (values[0], values[1]));
        }
    }

    fn append(&mut self, line: u64, (t, position): (f64, f64)) {
        let [(_, time), (_, column)] = self.columns;
        let (low, high) = self.axis.soft_limits;
        if !(low..=high).contains(&position) {
            let allowed = format!("positions in the soft limits, {low} to {high} m");
            return self.refuse(line, column, format!("{position}"), allowed);
        }
        if let Some(&(t_before, before)) = self.points.last() {
            if t <= t_before {
                return self.refuse(line, time, format!("{t}"), format!("a time after {t_before} s"));
            }
            let speed = ((position - before) / (t - t_before)).abs();
            if speed > self.axis.max_speed {
                let allowed = format!("speeds up to max_speed, {} m/s", self.axis.max_speed);
                self.refuse(line, column, format!("{position}, a speed of {speed:.3} m/s"), allowed);
            }
        }
        self.points.push((t, position));
    }
}
