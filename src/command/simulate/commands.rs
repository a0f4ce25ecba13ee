//! The commands of an open loop: the rows of a CSV file, or the sines of the scenario.
//!
//! A file has a column `t`, s, and a column with commands in [-1, 1] for each axis that is commanded. Every row is held
//! until the next one. Times rise; the first one, of any value, is the begin of the simulation.

use std::{f64::consts::TAU, path::Path, time::Duration};

use pipeline::{
    columns::{Table, TableError, TableProblem},
    machine::{CommandSine, Machine},
    message::ValveCommand,
};

/// Name of the column with the time, s.
const TIME_COLUMN: &str = "t";
/// Shortest time between rows, s: far below the step of the plant, far above the resolution of a duration.
const SHORTEST: f64 = 1e-6;
/// Longest experiment, s: half a year.
const LONGEST: f64 = 1.6e7;

/// Commands over time, row by row.
pub enum Commands<'a> {
    /// A sum of sines for all axes, one row per period.
    Sines { sines: &'a [CommandSine], period: Duration, rows: usize },
    /// The rows of a file: their times, and the values of each axis that has a column.
    File { times: Vec<f64>, axes: Vec<(usize, Vec<f64>)> },
}

impl Commands<'_> {
    /// Reads the commands of a file for the axes of `machine`.
    ///
    /// # Errors
    /// The file cannot be read; it has a column that is neither `t` nor an axis, no axis, or no row; its times do not
    /// rise, or its values are not in [-1, 1].
    pub fn read(file: &Path, machine: &Machine) -> Result<Self, TableError> {
        let table = Table::read(file)?;
        let axes: Vec<&str> = machine.axes.iter().map(|axis| axis.name.as_str()).collect();
        let about = |found: String, allowed: String| {
            table.error(vec![TableProblem { line: Some(1), field: None, found, allowed }])
        };
        if let Some(unknown) = table.names().find(|name| *name != TIME_COLUMN && !axes.contains(name)) {
            let allowed = format!("\"{TIME_COLUMN}\" and the axes {}", axes.join(", "));
            return Err(about(format!("column \"{unknown}\""), allowed));
        }
        let commanded: Vec<usize> = (0..axes.len()).filter(|index| table.has(axes[*index])).collect();
        if commanded.is_empty() {
            let allowed = format!("one column or more of the axes {}", axes.join(", "));
            return Err(about("no column of an axis".to_owned(), allowed));
        }
        let mut names = vec![TIME_COLUMN];
        names.extend(commanded.iter().map(|index| axes[*index]));
        let columns = table.numbers(&names, TIME_COLUMN)?;
        let mut problems = Vec::new();
        for (row, line) in columns.lines.iter().enumerate() {
            for (name, values) in names.iter().zip(&columns.values) {
                let wrong = if *name == TIME_COLUMN { time_problem(values, row) } else { value_problem(values[row]) };
                problems.extend(wrong.map(|(found, allowed)| {
                    let field = Some((row + 1, (*name).to_owned()));
                    TableProblem { line: Some(*line), field, found, allowed }
                }));
            }
        }
        if columns.lines.is_empty() {
            return Err(about("no row below the header".to_owned(), "at least one".to_owned()));
        }
        if !problems.is_empty() {
            return Err(table.error(problems));
        }
        let mut values = columns.values.into_iter();
        let times = values.next().unwrap_or_default();
        Ok(Self::File { times, axes: commanded.into_iter().zip(values).collect() })
    }

    /// Number of rows, at least one.
    pub fn rows(&self) -> usize {
        match self {
            Self::Sines { rows, .. } => *rows,
            Self::File { times, .. } => times.len(),
        }
    }

    /// Whether an axis has commands.
    pub fn has(&self, axis: usize) -> bool {
        match self {
            Self::Sines { .. } => true,
            Self::File { axes, .. } => axes.iter().any(|(index, _)| *index == axis),
        }
    }

    /// Time of a row, s.
    pub fn time(&self, row: usize) -> f64 {
        match self {
            Self::Sines { period, .. } => period.as_nanos() as f64 * row as f64 / 1e9,
            Self::File { times, .. } => times[row],
        }
    }

    /// Time from the first row to this one.
    pub fn since_begin(&self, row: usize) -> Duration {
        Duration::from_secs_f64(self.time(row) - self.time(0))
    }

    /// Time from the first row to the last, s.
    pub fn duration(&self) -> f64 {
        self.time(self.rows() - 1) - self.time(0)
    }

    /// Writes the values of a row into `command`.
    pub fn fill(&self, row: usize, command: &mut ValveCommand) {
        match self {
            Self::Sines { sines, .. } => {
                let t = self.time(row);
                let value = sines.iter().map(|sine| sine.amplitude * (TAU * sine.frequency * t + sine.phase).sin());
                let value = value.sum();
                command.axes.iter_mut().for_each(|axis| axis.command = value);
            }
            Self::File { axes, .. } => {
                axes.iter().for_each(|(index, values)| command.axes[*index].command = values[row])
            }
        }
    }
}

/// The problem with the time of a row, as what was found and what is allowed; none when it is fine.
fn time_problem(times: &[f64], row: usize) -> Option<(String, String)> {
    let (t, before) = (times[row], times[row.checked_sub(1)?]);
    if t - before < SHORTEST {
        return Some((format!("{t} after {before}"), format!("a time at least {SHORTEST} s after the row before")));
    }
    let late = t - times[0] > LONGEST;
    late.then(|| (t.to_string(), format!("a time up to {LONGEST} s after that of the first row")))
}

/// The problem with a command, as what was found and what is allowed; none when it is fine.
fn value_problem(value: f64) -> Option<(String, String)> {
    let wrong = !(-1.0..=1.0).contains(&value);
    wrong.then(|| (value.to_string(), "a command from -1 to 1".to_owned()))
}
