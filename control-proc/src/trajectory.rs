//! A trajectory's CSV file, read once and refused by row and column.
//!
//! ```text
//! g(t) = p_i + (p_i+1 - p_i) (t - t_i) / (t_i+1 - t_i)     for t_i <= t < t_i+1
//! ```
//!
//! t time in s, p position in m; before the first row the first position holds, after the last the last. Trap: a row
//! that does not read is not skipped, a straight line over it would be a motion nobody planned.

use std::path::Path;

use pipeline::{
    columns::{Table, TableError, TableProblem},
    machine::Axis,
};

/// Name of the column with the time, s.
const TIME_COLUMN: &str = "t";

/// Points (s, m) with straight lines between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    points: Vec<(f64, f64)>,
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
    pub fn read(file: &Path, column: &str, axis: &Axis) -> Result<Self, TableError> {
        let table = Table::read(file)?;
        let columns = table.numbers(&[TIME_COLUMN, column], TIME_COLUMN)?;
        let points: Vec<(f64, f64)> =
            columns.values[0].iter().copied().zip(columns.values[1].iter().copied()).collect();
        let mut problems = Vec::new();
        let (low, high) = axis.soft_limits;
        for (i, (&(t, position), line)) in points.iter().zip(&columns.lines).enumerate() {
            let mut refuse = |found, allowed| {
                problems.push(TableProblem {
                    line: Some(*line),
                    field: Some((i + 1, column.to_owned())),
                    found,
                    allowed,
                });
            };
            if !(low..=high).contains(&position) {
                refuse(format!("{position}"), format!("positions in the soft limits, {low} to {high} m"));
            } else if let Some((t_before, before)) = i.checked_sub(1).map(|before| points[before]) {
                let speed = ((position - before) / (t - t_before)).abs();
                if speed > axis.max_speed {
                    let allowed = format!("speeds up to max_speed, {} m/s", axis.max_speed);
                    refuse(format!("{position}, a speed of {speed:.3} m/s"), allowed);
                }
            }
        }
        if points.is_empty() {
            let (found, allowed) = ("no row below the header".to_owned(), "at least one".to_owned());
            problems.push(TableProblem { line: None, field: None, found, allowed });
        }
        if problems.is_empty() { Ok(Self { points }) } else { Err(table.error(problems)) }
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
