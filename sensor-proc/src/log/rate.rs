//! A period that changes within a recording.
//!
//! ```text
//! T_i = mean of 100 successive steps without a gap         changed at block i  <=>  |T_i / T_0 - 1| > 0.1
//! ```
//!
//! A step that is far longer than the others counts as a gap. 20 of them in a row that are equally long are another
//! period as well.
//!
//! The mean of successive steps is the time between two rows divided by their number. Stamps that are late by a part of
//! a period, or rounded, hardly change it.

use serde::Serialize;

/// Steps of a block.
const BLOCK: usize = 100;
/// Part by which two periods that are meant to be one may differ.
const TOLERANCE: f64 = 0.1;
/// Gaps in a row from which on they are steps of another period, and how much longer than the shortest of them the
/// longest may be.
const GAPS: usize = 20;
const EQUAL: f64 = 1.5;
/// Steps by whose mean the place of a change is found within its block.
const FEW: usize = 8;

/// Where the period of a recording changes for the first time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PeriodChange {
    /// Line of the file, from 1: the first row after a step of the new length, give or take some rows.
    pub line: usize,
    /// Time of that row since the first row, s.
    pub seconds: f64,
    /// Period of the first rows, s.
    pub before_s: f64,
    /// Period from there on, s.
    pub after_s: f64,
}

/// Whether two periods are too far apart to be one.
pub fn contradict(one: f64, two: f64) -> bool {
    (one / two - 1.0).abs() > TOLERANCE
}

/// The first change of the period; `begins` as in [`super::Log`], `lines` of the file.
pub(super) fn period_change(times: &[f64], begins: &[bool], lines: &[usize]) -> Option<PeriodChange> {
    // Rows whose step from the row before is no gap.
    let steps: Vec<usize> = (1..times.len()).filter(|row| !begins[*row]).collect();
    let mean = |rows: &[usize]| rows.iter().map(|row| times[*row] - times[*row - 1]).sum::<f64>() / rows.len() as f64;
    let before = mean(steps.get(..BLOCK)?);
    let gaps = longer_steps(times, begins).filter(|row| *row > steps[0]);
    let gaps = gaps.map(|row| (row, mean(&(row..row + GAPS).collect::<Vec<_>>())));
    let changed = || {
        let mut blocks = steps.chunks_exact(BLOCK).enumerate();
        let (block, rows) = blocks.find(|(_, rows)| contradict(mean(rows), before))?;
        // The change may lie in the middle of this block: the next one has the new period only.
        let after = mean(steps.get((block + 1) * BLOCK..(block + 2) * BLOCK).unwrap_or(rows));
        let is_new = |rows: &[usize]| (mean(rows) - after).abs() < (mean(rows) - before).abs();
        let near = &steps[(block - 1) * BLOCK..(block + 1) * BLOCK];
        let row = near.windows(FEW).find(|rows| is_new(rows) && is_new(&rows[..1])).map_or(rows[0], |rows| rows[0]);
        Some((row, after))
    };
    let (row, after) = gaps.into_iter().chain(changed()).min_by_key(|(row, _)| *row)?;
    Some(PeriodChange { line: lines[row], seconds: times[row] - times[0], before_s: before, after_s: after })
}

/// The first of [`GAPS`] rows in a row that all come equally long after a gap.
fn longer_steps(times: &[f64], begins: &[bool]) -> Option<usize> {
    let step = |row: usize| times[row] - times[row - 1];
    let is_longer = |row: &usize| {
        let rows = *row..row + GAPS;
        let (least, most) =
            rows.clone().map(step).fold((f64::INFINITY, 0.0f64), |(a, b), step| (a.min(step), b.max(step)));
        rows.clone().all(|row| begins[row]) && least > 0.0 && most <= EQUAL * least
    };
    (1..(times.len() + 1).saturating_sub(GAPS)).find(is_longer)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The change in times of these steps, with jitter of a third of a period and a gap; row 0 is in line 2.
    fn change(step: impl Fn(usize) -> f64) -> Option<PeriodChange> {
        let mut time = 0.0;
        let mut times = vec![0.0];
        for k in 1..1000 {
            time += step(k) + if k == 250 { 4.0 } else { 0.0 };
            times.push(time + 0.3 * step(k) * (k as f64 * 91.7).sin());
        }
        let begins: Vec<bool> = (0..1000).map(|k| k == 0 || k == 250).collect();
        period_change(&times, &begins, &(2..1002).collect::<Vec<_>>())
    }

    #[test]
    fn a_change_is_found_with_its_place_whatever_the_jitter() {
        for at in [104, 333, 560, 720] {
            let found = change(|k| if k < at { 0.014 } else { 0.020 }).unwrap();
            assert!(found.line.abs_diff(at + 2) <= FEW, "{at}: {found:?}");
            assert!((found.before_s - 0.014).abs() < 2e-4 && (found.after_s - 0.020).abs() < 2e-4, "{found:?}");
        }
    }

    #[test]
    fn equal_gaps_in_a_row_are_another_period() {
        let found = |gaps: std::ops::Range<usize>, step: &dyn Fn(usize) -> f64| {
            let begins: Vec<bool> = (0..400).map(|k| k == 0 || gaps.contains(&k)).collect();
            let mut time = 0.0;
            let add = |k: usize| {
                time += if k == 0 {
                    0.0
                } else if begins[k] {
                    step(k)
                } else {
                    0.01
                };
                time
            };
            let times: Vec<f64> = (0..400).map(add).collect();
            period_change(&times, &begins, &(2..402).collect::<Vec<_>>())
        };
        let change = found(200..400, &|_| 0.02).unwrap();
        assert_eq!(change.line, 202);
        assert!((change.before_s - 0.01).abs() < 1e-9 && (change.after_s - 0.02).abs() < 1e-9, "{change:?}");
        // Some rows are missing, or many at random.
        assert_eq!(found(200..210, &|_| 0.02), None);
        assert_eq!(found(200..400, &|k| 0.01 * (2 + k % 3) as f64), None);
    }

    #[test]
    fn one_period_with_jitter_and_a_gap_is_no_change() {
        assert_eq!(change(|_| 0.014), None);
        assert_eq!(period_change(&[0.0, 0.1], &[true, false], &[1, 2]), None);
        assert_eq!(period_change(&[], &[], &[]), None);
    }
}
