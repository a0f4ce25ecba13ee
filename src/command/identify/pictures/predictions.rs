//! What was measured and what was predicted, and the errors.

use plotters::prelude::Color;

use super::{
    Picture, Shown,
    style::{ADAPTIVE, GREY, HELD, MEASURED, area, line, upright},
};
use crate::{
    model::prediction::statistics,
    report::chart::{Chart, WIDE, tick},
};

/// The band is this many times the rmse of the prediction: it holds 95 % of errors that are normally distributed.
const BAND: f64 = 2.0;
/// Length of the piece that is shown large, in horizons, and its fewest rows.
const PIECE: usize = 16;
const FEWEST_ROWS: usize = 60;

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
         training ends at the thick line.{recordings}{gaps}"
    );
    let (first, end) = piece(shown);
    let large = format!(
        "Around the largest error of the held model. The band is the adaptive prediction and {BAND} times its rmse on \
         both sides, which holds 95 % of errors that are normally distributed."
    );
    let errors = "What was measured minus what was predicted, over the same rows.".to_owned();
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
    let (outputs, held) = (&shown.record.outputs, &shown.course.held.h_step);
    let size = |k: &usize| {
        let error = (outputs[*k] - held[*k]).abs();
        if error.is_finite() { error } else { -1.0 }
    };
    let rows = outputs.len();
    let worst = (0..rows).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or_default();
    let half = (PIECE * shown.settings.horizon).max(FEWEST_ROWS) / 2;
    (worst.saturating_sub(half), (worst + half).min(rows))
}

fn measured(shown: &Shown<'_>, (first, end): (usize, usize), title: String) -> Chart {
    let Shown { record, course, axis, .. } = shown;
    let errors = record.outputs.iter().zip(&course.adaptive.h_step).map(|(y, predicted)| y - predicted);
    let wide = BAND * statistics(errors).rmse();
    let of = |values: &[f64]| axis.line(values, (first, end));
    let (adaptive, held) = (&course.adaptive.h_step, &course.held.h_step);
    let mut series = vec![
        area("", axis.band(adaptive, (first, end), wide), ADAPTIVE.mix(0.2)),
        line("measured", of(&record.outputs), MEASURED, 4),
        line("held model", of(held), HELD, 2),
        line("adaptive model", of(adaptive), ADAPTIVE, 2),
    ];
    if first == 0 {
        // In the whole record a model that has lost the axis must not hide what was measured.
        series[0].points.clear();
    }
    let (low, high) = extent(&record.outputs[first..end]);
    let space = 0.15 * (high - low).max(1e-12);
    let frame = [(axis.times[first], axis.times[end - 1].max(axis.times[first] + 1e-9)), (low - space, high + space)];
    series.splice(0..0, marks(shown, (first, end), frame[1]));
    let labels = ["time, s".to_owned(), shown.output.clone()];
    Chart { title, size: WIDE, labels, tick, series, notes: Vec::new(), frame: Some(frame) }
}

/// Lines at the end of the training and at the beginning of each recording.
fn marks(shown: &Shown<'_>, (first, end): (usize, usize), y: (f64, f64)) -> Vec<crate::report::chart::Series> {
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
    let of = |predicted: &[f64]| {
        let errors: Vec<f64> = record.outputs.iter().zip(predicted).map(|(y, predicted)| y - predicted).collect();
        axis.line(&errors, rows)
    };
    let zero = vec![(axis.times[rows.0], 0.0), (axis.times[rows.1 - 1], 0.0)];
    let series = vec![
        line("held model", of(&course.held.h_step), HELD, 2),
        line("adaptive model", of(&course.adaptive.h_step), ADAPTIVE, 2),
        line("", zero, GREY, 1),
    ];
    let labels = ["time, s".to_owned(), shown.error.clone()];
    let title = format!("Error of the prediction {} ahead", shown.ahead);
    Chart { title, size: WIDE, labels, tick, series, notes: Vec::new(), frame: None }
}

/// Lowest and highest of the values that are finite.
fn extent(values: &[f64]) -> (f64, f64) {
    let finite = values.iter().copied().filter(|value| value.is_finite());
    finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}
