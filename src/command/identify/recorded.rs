//! An axis of a recording in the place of a table: its command and its position at every tick.

use std::path::Path;

use sensor_proc::log::{Cause, Found, FoundColumn, Gap, Gaps, Log, contradict};

use crate::{
    arguments::ColumnArguments,
    failure::Failure,
    recording::rows::{Row, Rows, axes_of, is_recording},
};

/// What [`Found::separator`] says of a recording: it has ticks in the place of lines.
pub const MCAP: &str = "MCAP";
/// Most places of gaps that are kept.
const MOST_PLACES: usize = 100;

/// Reads a table with `columns`, or the axis of a recording that they name.
///
/// # Errors
/// The file cannot be read, or does not have what is asked for.
pub fn read_log(file: &Path, columns: &ColumnArguments) -> Result<Log, Failure> {
    if !is_recording(file) {
        return Log::read(file, &columns.wanted()).map_err(Failure::usage);
    }
    let axis = match &columns.axis {
        Some(axis) => axis.clone(),
        None => only_axis(axes_of(file)?)?,
    };
    let Rows { period, axes } = Rows::read(file, &[&axis]).map_err(Failure::usage)?;
    let used = columns.period.map_or(period, |period| period.as_secs_f64());
    let mut log = log(&axes.concat(), used, &axis);
    log.found.contradicting_period_s = Some(period).filter(|recorded| contradict(*recorded, used));
    Ok(log)
}

/// The axis that is meant where none is named.
fn only_axis(axes: Vec<String>) -> Result<String, Failure> {
    match axes.as_slice() {
        [one] => Ok(one.clone()),
        [] => Err(Failure::usage("--axis: found a recording that names no axes; allowed: one with the fact axes")),
        several => Err(Failure::usage(format!("--axis: found none; allowed: one of {}", several.join(", ")))),
    }
}

/// The rows with plausible positions.
fn log(rows: &[Row], period: f64, axis: &str) -> Log {
    let column =
        |name: String, unit: &'static str| FoundColumn { name, unit: Some(unit.to_owned()), becomes: Some(unit) };
    let position = format!("{axis}.position");
    let mut log = Log {
        inputs: Vec::new(),
        outputs: Vec::new(),
        begins: Vec::new(),
        times: Vec::new(),
        period,
        short_steps: 0,
        gaps: Gaps::default(),
        found: Found {
            separator: MCAP,
            decimal: "CDR",
            encoding: "schemas of ROS 2",
            header: true,
            units_row: false,
            is_time_doubtful: false,
            contradicting_period_s: None,
            time_form: Some("numbers"),
            time: Some(FoundColumn { name: "tick".to_owned(), unit: None, becomes: Some("s") }),
            input: column(format!("{axis}.command"), "1"),
            output: column(position.clone(), "m"),
        },
    };
    let first = rows.first().map_or(0, |row| row.tick);
    // Tick of the last row, and of the last one that was kept.
    let (mut last, mut kept) = (None, None);
    for row in rows {
        let missing = last.map_or(0, |last| row.tick - last - 1);
        last = Some(row.tick);
        let place = |cause| Gap { line: usize::try_from(row.tick).unwrap_or(usize::MAX), cause };
        if missing > 0 {
            log.gaps.missing_rows += 1;
            log.gaps.places.push(place(Cause::MissingRows { seconds: (missing + 1) as f64 * period }));
        }
        if !row.is_usable {
            log.gaps.empty_rows += 1;
            log.gaps.places.push(place(Cause::EmptyField { column: position.clone() }));
            continue;
        }
        log.begins.push(kept.is_none_or(|kept| row.tick != kept + 1));
        kept = Some(row.tick);
        log.times.push((row.tick - first) as f64 * period);
        log.inputs.push(row.command);
        log.outputs.push(row.position);
    }
    log.gaps.places.truncate(MOST_PLACES);
    log
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_where_ticks_are_missing_and_where_a_position_is_not_usable() {
        let row = |tick, is_usable| Row { tick, position: tick as f64, command: 0.5, is_usable };
        let rows = [row(7, true), row(8, true), row(10, true), row(11, false), row(12, true), row(13, true)];
        let log = log(&rows, 0.01, "boom");
        assert_eq!(log.outputs, [7.0, 8.0, 10.0, 12.0, 13.0]);
        assert_eq!(log.begins, [true, false, true, true, false]);
        assert_eq!((log.gaps.missing_rows, log.gaps.empty_rows), (1, 1));
        assert_eq!(log.gaps.places[0], Gap { line: 10, cause: Cause::MissingRows { seconds: 0.02 } });
        assert_eq!(log.times[4], 0.06);
    }
}
