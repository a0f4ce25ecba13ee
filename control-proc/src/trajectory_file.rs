//! Reads the references that a machine file names from CSV files, and plans the motion of the teeth, once at the start.
//! Never called in the loop.
//!
//! A file has a column `t` (s) and one column per axis (m). Trap: a row that cannot be read is refused, not skipped. A
//! straight line over the missing row would be a motion that nobody planned.

use std::path::Path;

use pipeline::{
    columns::{Table, TableError, TableProblem},
    machine::{Axis, Machine, ReferenceSource},
};

use crate::{
    reference::{
        generator::{Generator, ReferenceGenerator},
        trajectory::Trajectory,
    },
    tip::{TipError, TipPlan},
};

/// Name of the column with the time, s.
const TIME_COLUMN: &str = "t";

/// Why references cannot be generated.
#[derive(Debug, thiserror::Error)]
pub enum ReferenceError {
    /// The file of an axis is refused.
    #[error("axis.{axis}.reference.file: {source}")]
    File {
        /// Name of the axis.
        axis: String,
        /// Why its file is refused, by row and column.
        source: TableError,
    },
    /// The machine cannot do the task of its teeth.
    #[error(transparent)]
    Tip(#[from] TipError),
}

/// The reference generators of all axes of a machine.
///
/// # Errors
/// The trajectory file of an axis is refused, or the task of the teeth.
pub fn read_references(machine: &Machine) -> Result<ReferenceGenerator, ReferenceError> {
    let plan = TipPlan::of(machine)?;
    let axes = machine.axes.iter().enumerate().map(|(i, axis)| read_generator(i, axis, plan.as_ref()));
    Ok(axes.collect::<Result<ReferenceGenerator, _>>()?.with_plan(plan))
}

fn read_generator(index: usize, axis: &Axis, plan: Option<&TipPlan>) -> Result<Generator, ReferenceError> {
    Ok(match &axis.reference {
        ReferenceSource::Tip => {
            plan.map_or(Generator::None, |plan| Generator::Tip(Trajectory::through(plan.points(index))))
        }
        ReferenceSource::Hold | ReferenceSource::Channel => Generator::None,
        ReferenceSource::Sines { center, sines } => Generator::Sines { center: *center, sines: sines.clone() },
        ReferenceSource::Ramps(points) => Generator::Ramps(Trajectory::through(points.clone())),
        ReferenceSource::Trajectory { file, column } => Generator::Trajectory(
            read_trajectory(file, column, axis)
                .map_err(|source| ReferenceError::File { axis: axis.name.clone(), source })?,
        ),
    })
}

/// Reads columns `t` (s) and `column` (m) of a CSV file for `axis`.
///
/// # Errors
/// The file cannot be read, lacks a column or has no row; or a row holds text, a number that is not finite, a time that
/// does not rise, a position outside the soft limits or a speed over `max_speed`.
pub fn read_trajectory(file: &Path, column: &str, axis: &Axis) -> Result<Trajectory, TableError> {
    let table = Table::read(file)?;
    let columns = table.numbers(&[TIME_COLUMN, column], TIME_COLUMN)?;
    let points: Vec<(f64, f64)> = columns.values[0].iter().copied().zip(columns.values[1].iter().copied()).collect();
    let mut problems = Vec::new();
    let (low, high) = axis.soft_limits;
    for (i, (&(t, position), line)) in points.iter().zip(&columns.lines).enumerate() {
        let mut refuse = |found, allowed| {
            problems.push(TableProblem { line: Some(*line), field: Some((i + 1, column.to_owned())), found, allowed });
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
    if problems.is_empty() { Ok(Trajectory::through(points)) } else { Err(table.error(problems)) }
}
