//! Gaps of a recording, and its period.
//!
//! ```text
//! T_m = median of the differences t(k) - t(k-1) > 0
//! row k begins a stretch:   t(k) - t(k-1) - T_m > T_m / 2,   t(k) <= t(k-1),   or rows before it were left out
//! T = (sum of the lengths of all stretches) / (number of their steps)
//! ```
//!
//! T_m finds the gaps. T is the mean of the differences without them, because the median of stamps that are rounded to
//! milliseconds is itself rounded.

use serde::Serialize;

use super::rate::{PeriodChange, period_change};

/// Most places of gaps that are kept.
const MOST_PLACES: usize = 100;
/// A step of time is irregular if it differs from the median step by more than this part of the median.
const IRREGULAR: f64 = 0.5;

/// Why a stretch ends.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "cause")]
pub enum Cause {
    /// A row was left out, because this column has an empty field there.
    EmptyField {
        /// Name of the column.
        column: String,
    },
    /// Rows are missing before this one.
    MissingRows {
        /// Time since the row before, s.
        seconds: f64,
    },
    /// The time is not later than that of the row before.
    TimeNotRising {
        /// Time since the row before, s: 0 or negative.
        seconds: f64,
    },
}

/// A gap: no regressor row contains samples from both sides of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Gap {
    /// Line of the file, from 1.
    pub line: usize,
    /// What was found there.
    #[serde(flatten)]
    pub cause: Cause,
}

/// All gaps of a recording.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Gaps {
    /// Rows that were left out, because a field is empty.
    pub empty_rows: usize,
    /// Places where rows are missing.
    pub missing_rows: usize,
    /// Rows whose time is not later than that of the row before.
    pub times_not_rising: usize,
    /// The first gaps, in the order of the file.
    pub places: Vec<Gap>,
    /// Where the period changes, which is no gap.
    pub period_change: Option<PeriodChange>,
}

/// Rows of a recording, before their gaps are known.
#[derive(Debug, Default)]
pub(super) struct Rows {
    /// Times, s; none where the recording has none.
    pub(super) times: Vec<f64>,
    pub(super) inputs: Vec<f64>,
    pub(super) outputs: Vec<f64>,
    /// Lines of the file.
    pub(super) lines: Vec<usize>,
    /// Whether a row before this one was left out.
    pub(super) after_empty: Vec<bool>,
    pub(super) gaps: Gaps,
}

/// What the times say.
#[derive(Debug, Default)]
pub(super) struct Timing {
    /// Lengths of all stretches, s.
    pub(super) duration: f64,
    /// Steps in all stretches.
    pub(super) steps: usize,
    /// Steps that are shorter than half of the median.
    pub(super) short_steps: usize,
}

impl Timing {
    /// Mean of the steps, s; none without a step.
    pub(super) fn period(&self) -> Option<f64> {
        (self.steps > 0).then(|| self.duration / self.steps as f64)
    }
}

impl Gaps {
    /// Takes in a row with an empty field.
    pub(super) fn empty(&mut self, line: usize, column: &str) {
        self.empty_rows += 1;
        self.keep(line, || Cause::EmptyField { column: column.to_owned() });
    }

    fn step(&mut self, line: usize, seconds: f64) {
        if seconds > 0.0 {
            self.missing_rows += 1;
            self.keep(line, || Cause::MissingRows { seconds });
        } else {
            self.times_not_rising += 1;
            self.keep(line, || Cause::TimeNotRising { seconds });
        }
    }

    fn keep(&mut self, line: usize, cause: impl Fn() -> Cause) {
        // Empty fields come first, in a pass of their own; both passes keep their first places.
        if self.places.len() < 2 * MOST_PLACES {
            self.places.push(Gap { line, cause: cause() });
        }
    }

    fn sort(&mut self) {
        self.places.sort_by_key(|gap| gap.line);
        self.places.truncate(MOST_PLACES);
    }

    /// Whether the recording has gaps.
    pub fn any(&self) -> bool {
        self.empty_rows + self.missing_rows + self.times_not_rising > 0
    }
}

impl Rows {
    /// Finds where stretches begin.
    pub(super) fn stretches(&mut self) -> (Vec<bool>, Timing) {
        let mut begins = std::mem::take(&mut self.after_empty);
        begins.iter_mut().take(1).for_each(|first| *first = true);
        let mut timing = Timing::default();
        if self.times.len() == begins.len() {
            let median = median_step(&self.times, &begins);
            let mut start = self.times.first().copied().unwrap_or_default();
            for (k, begins) in begins.iter_mut().enumerate().skip(1) {
                let step = self.times[k] - self.times[k - 1];
                if !*begins && (step <= 0.0 || step - median > IRREGULAR * median) {
                    self.gaps.step(self.lines[k], step);
                    *begins = true;
                }
                if *begins {
                    timing.duration += self.times[k - 1] - start;
                    start = self.times[k];
                } else {
                    timing.steps += 1;
                    timing.short_steps += usize::from(step < IRREGULAR * median);
                }
            }
            timing.duration += self.times.last().copied().unwrap_or_default() - start;
            self.gaps.period_change = period_change(&self.times, &begins, &self.lines);
        }
        self.gaps.sort();
        (begins, timing)
    }
}

/// Median of the steps that rise, without those over rows that were left out; 0 where there is none.
fn median_step(times: &[f64], after_empty: &[bool]) -> f64 {
    let steps = times.windows(2).zip(after_empty.iter().skip(1)).filter(|(_, empty)| !**empty);
    let mut steps: Vec<f64> = steps.map(|(pair, _)| pair[1] - pair[0]).filter(|step| *step > 0.0).collect();
    let middle = steps.len() / 2;
    if steps.is_empty() { 0.0 } else { *steps.select_nth_unstable_by(middle, f64::total_cmp).1 }
}
