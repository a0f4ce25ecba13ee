//! An output that stands while the command would move it.
//!
//! ```text
//! a stand is proven at row k  <=>  k - s > n  and  k - j > n  and  |u(k)| >= U         n = max(h, 20, 10 m)
//! ```
//!
//! y output, u command, h horizon in rows; s the row from which on y stands, j >= s the first row whose command differs
//! from u(s) by half of U. Over the rows in which y changes: m the median number of rows between two of them, U the
//! median of |u|. A stuck sensor, a cable that has slipped off its drum and an axis at its end stop look like this. The
//! predictions of such rows are perfect, and make a bad model look good.
//!
//! Traps: a coarse sensor stands for many rows between two counts; hence m. An output that answers to the size of its
//! command stands while the command does; hence j.

use std::ops::Range;

use pipeline::statistics::median;

/// Fewest rows for which an output stands.
const LEAST: usize = 20;
/// Fewest rows for which an output stands, in parts of m.
const USUAL: usize = 10;
/// Largest part of the rows in which the output may stand while it is driven.
pub const LARGEST_STANDING: f64 = 0.05;
/// Change of the command, in parts of U.
const CHANGE: f64 = 0.5;

/// Part of the rows in proven stands. `begins` says before which rows a gap is.
pub fn part(outputs: &[f64], inputs: &[f64], begins: &[bool], horizon: usize) -> f64 {
    let rows: usize = proven(outputs, inputs, begins, horizon).iter().map(Range::len).sum();
    if outputs.is_empty() { 0.0 } else { rows as f64 / outputs.len() as f64 }
}

/// The rows of each proven stand.
pub fn proven(outputs: &[f64], inputs: &[f64], begins: &[bool], horizon: usize) -> Vec<Range<usize>> {
    let stands = |k: usize| !begins[k] && outputs[k] == outputs[k - 1];
    let changes: Vec<usize> = (1..outputs.len()).filter(|&k| !begins[k] && !stands(k)).collect();
    let apart = median(changes.windows(2).map(|pair| (pair[1] - pair[0]) as f64));
    let (Some(apart), Some(usual)) = (apart, median(changes.iter().map(|&k| inputs[k].abs()))) else {
        return Vec::new();
    };
    let longest = horizon.max(LEAST).max(USUAL * apart as usize);
    let is_proven = |rows: &Range<usize>| {
        let start = rows.start;
        let changed = rows.clone().find(|&k| (inputs[k] - inputs[start]).abs() >= CHANGE * usual);
        changed.is_some_and(|changed| (changed + longest + 1..rows.end).any(|k| inputs[k].abs() >= usual))
    };
    let ends = (1..=outputs.len()).filter(|k| *k == outputs.len() || !stands(*k));
    let rows = ends.scan(0, |start, end| Some(std::mem::replace(start, end)..end));
    rows.filter(is_proven).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Part of a record of 4000 rows, with a horizon of 50.
    fn part_of(outputs: impl Iterator<Item = f64>, inputs: impl Fn(usize) -> f64) -> f64 {
        let outputs: Vec<f64> = outputs.take(4000).collect();
        let inputs: Vec<f64> = (0..4000).map(inputs).collect();
        let begins: Vec<bool> = (0..4000).map(|k| k == 0).collect();
        part(&outputs, &inputs, &begins, 50)
    }

    fn sines(k: usize) -> f64 {
        let t = k as f64 * 0.01;
        0.5 * (1.3 * t).sin() + 0.3 * (3.1 * t).sin()
    }

    /// An axis that goes by `speed` u and is read in counts; `read` is the position that is read at row k for the true
    /// one and the one that was read before.
    fn axis(count: f64, dead_band: f64, read: impl Fn(usize, f64, f64) -> f64) -> f64 {
        let (mut y, mut frozen) = (0.5, 0.5);
        let outputs = (0..).map(move |k| {
            let u = sines(k);
            if u.abs() > dead_band {
                y += 0.002 * (u - dead_band.copysign(u));
            }
            frozen = read(k, y, frozen);
            (frozen / count).round() * count
        });
        part_of(outputs, sines)
    }

    #[test]
    fn an_output_that_is_frozen_is_found_whole() {
        let frozen = |rows: std::ops::Range<usize>| {
            axis(1e-4, 0.0, move |k, y, before| if rows.contains(&k) { before } else { y })
        };
        for rows in [2000..4000, 1000..2000, 1000..1400] {
            let expected = rows.len() as f64 / 4000.0;
            let found = frozen(rows.clone());
            assert!((found - expected).abs() < 0.01, "{rows:?}: {found}");
        }
        // Pieces of a second.
        assert!(axis(1e-4, 0.1, |k, y, before| if k % 1000 < 150 { before } else { y }) > 0.05);
        // A stop at half of the stroke.
        assert!(axis(1e-4, 0.0, |_, y, _| y.min(0.55)) > 0.1);
    }

    #[test]
    fn dead_bands_coarse_counts_and_outputs_that_never_move_are_no_frozen_output() {
        for (count, dead_band) in [(1e-5, 0.0), (1e-4, 0.4), (1e-3, 0.3), (0.02, 0.0)] {
            assert_eq!(axis(count, dead_band, |_, y, _| y), 0.0, "{count} {dead_band}");
        }
        assert_eq!(axis(1e-4, 0.0, |_, _, _| 0.5), 0.0);
        assert_eq!(part(&[], &[], &[], 1), 0.0);
    }

    #[test]
    fn an_output_that_has_answered_to_a_step_stands_as_its_command_does() {
        for (hold, tau, count) in [(400, 10.0, 1e-3), (400, 40.0, 1e-2), (800, 40.0, 1e-2)] {
            let steps = move |k: usize| [0.2, 0.9, 0.5, -0.3, 0.7, -0.8, 0.1][k / hold % 7];
            let mut y = 0.0_f64;
            let outputs = (0..).map(move |k: usize| {
                y += (steps(k.saturating_sub(3)) - y) / tau;
                (y / count).round() * count
            });
            assert_eq!(part_of(outputs, steps), 0.0, "{hold} {tau} {count}");
        }
    }
}
