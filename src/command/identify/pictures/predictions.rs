//! What was measured and what was predicted, and the errors.

use plotters::prelude::Color;

use super::{
    Picture, Shown,
    style::{ADAPTIVE, GREY, HELD, MEASURED, OUTLIER, area, line, upright},
};
use crate::{
    model::prediction::statistics,
    report::chart::{Chart, Mark, Series, WIDE, tick},
};

/// The band is this many times the rmse of the prediction: it holds 95 % of errors that are normally distributed.
const BAND: f64 = 2.0;
/// Free space above and below what was measured, as a part of its height.
const SPACE: f64 = 0.15;
/// Length of the piece that is shown large, in horizons, and its fewest rows.
const PIECE: usize = 6;
const FEWEST_ROWS: usize = 60;
/// Most rows that are shown as dots.
const DOTS: usize = 320;

/// The whole record, a piece of it, and the errors h steps ahead.
pub fn all(shown: &Shown<'_>) -> Vec<Picture> {
    let rows = shown.record.outputs.len();
    let ahead = &shown.ahead;
    let gaps = if shown.record.begins.iter().skip(1).any(|begins| *begins) {
        let shortened = if shown.axis.is_shortened { " Long ones are drawn shorter." } else { "" };
        format!(" Gaps of the record are gaps in the lines.{shortened}")
    } else {
        String::new()
    };
    let recordings = match shown.axis.recordings.len() {
        0 => "",
        _ => " A recording begins at each thin line.",
    };
    let whole = format!(
        "Each prediction was made {ahead} before, with the coefficients of that time and the commands as applied. The \
         band is the adaptive prediction and {BAND} times its rmse on both sides, which holds 95 % of errors that are \
         normally distributed. The training ends at the thick line.{recordings}{gaps}"
    );
    let (first, end) = piece(shown);
    let large = "The same around the largest error of the held model.".to_owned();
    let errors = "What was measured minus what was predicted, without outliers.".to_owned();
    vec![
        Picture { chart: measured(shown, (0, rows), format!("Measured, and predicted {ahead} ahead")), caption: whole },
        Picture {
            chart: measured(shown, (first, end), format!("A piece of it, predicted {ahead} ahead")),
            caption: large,
        },
        Picture { chart: error(shown), caption: errors },
    ]
}

/// The rows of the piece.
fn piece(shown: &Shown<'_>) -> (usize, usize) {
    let errors = shown.course.residuals(&shown.record.outputs, &shown.course.held.h_step);
    let size = |k: &usize| if errors[*k].is_finite() { errors[*k].abs() } else { -1.0 };
    let rows = errors.len();
    let worst = (0..rows).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or_default();
    let half = (PIECE * shown.settings.horizon).max(FEWEST_ROWS) / 2;
    (worst.saturating_sub(half), (worst + half).min(rows))
}

fn measured(shown: &Shown<'_>, (first, end): (usize, usize), title: String) -> Chart {
    let Shown { record, course, axis, .. } = shown;
    let (adaptive, held) = (&course.adaptive.h_step, &course.held.h_step);
    let wide = BAND * statistics(course.residuals(&record.outputs, adaptive).into_iter()).rmse();
    let of = |values: &[f64]| axis.line(values, (first, end));
    let (low, high) = extent(&course.used[first..end]);
    let space = SPACE * (high - low).max(1e-12);
    let y = (low - space, high + space);
    let mut series = vec![
        area("", axis.band(adaptive, (first, end), wide), ADAPTIVE.mix(0.25)),
        line("measured", of(&course.used), MEASURED, 4),
        line("held model", of(held), HELD, 2),
        line("adaptive model", of(adaptive), ADAPTIVE, 2),
    ];
    if end - first <= DOTS {
        series[1].mark = Mark::Dot(3);
    }
    let is_outlier = |k: &usize| course.used[*k] != record.outputs[*k];
    let crosses = (first..end).filter(is_outlier).map(|k| (axis.times[k], record.outputs[k].clamp(y.0, y.1)));
    let crosses: Vec<(f64, f64)> = crosses.collect();
    if !crosses.is_empty() {
        series.push(Series { mark: Mark::Cross(7), ..line("outlier, left out", crosses, OUTLIER, 1) });
    }
    let frame = [(axis.times[first], axis.times[end - 1].max(axis.times[first] + 1e-9)), y];
    series.splice(0..0, marks(shown, (first, end), frame[1]));
    let labels = ["time, s".to_owned(), shown.output.clone()];
    Chart { title, size: WIDE, labels, tick, y_tick: None, series, notes: Vec::new(), frame: Some(frame) }
}

/// Lines at the end of the training and at the beginning of each recording.
fn marks(shown: &Shown<'_>, (first, end): (usize, usize), y: (f64, f64)) -> Vec<Series> {
    let Shown { axis, settings, .. } = shown;
    let (begin, last) = (axis.times[first], axis.times[end - 1]);
    let inside = |at: &f64| (begin..=last).contains(at);
    let recordings = axis.recordings.iter().copied().filter(inside).map(|at| upright(at, y, 1));
    let training = axis.times.get(settings.training).copied().filter(inside).map(|at| upright(at, y, 5));
    recordings.chain(training).collect()
}

fn error(shown: &Shown<'_>) -> Chart {
    let Shown { record, course, axis, .. } = shown;
    let rows = (shown.settings.training.min(record.outputs.len() - 1), record.outputs.len());
    let of = |predicted: &[f64]| axis.line(&course.residuals(&record.outputs, predicted), rows);
    let zero = vec![(axis.times[rows.0], 0.0), (axis.times[rows.1 - 1], 0.0)];
    let series = vec![
        line("held model", of(&course.held.h_step), HELD, 2),
        line("adaptive model", of(&course.adaptive.h_step), ADAPTIVE, 2),
        line("", zero, GREY, 1),
    ];
    let labels = ["time, s".to_owned(), shown.error.clone()];
    let title = format!("Error of the prediction {} ahead", shown.ahead);
    Chart { title, size: WIDE, labels, tick, y_tick: None, series, notes: Vec::new(), frame: None }
}

/// Lowest and highest of the values that are finite.
fn extent(values: &[f64]) -> (f64, f64) {
    let finite = values.iter().copied().filter(|value| value.is_finite());
    finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}
