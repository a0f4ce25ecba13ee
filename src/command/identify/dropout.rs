//! Dropouts of a sensor: rows in which the output stands at one value exactly, and to or from which it jumps.
//!
//! ```text
//! dropout  <=>  y(i) = .. = y(j),  j - i >= 2,  and  |y(i) - y(i-1)| > J  or  |y(j+1) - y(j)| > J       J = 3 q
//! ```
//!
//! y output of row k; q the increment that nine in a thousand of those that are not zero exceed, at least five of them;
//! the increments at both ends of a stand do not count, unless they are most of all.
//! A sensor that repeats its last value while its axis moves, and one that reads zero for a while, look like this. The
//! gate of the identifier sees the jumps only, and believes what is between them: half a second of it in the training
//! teaches every model that the axis does not move. No axis leaves an exact stand with three times its usual top speed.
//!
//! An output that stands at the end of the recording though its command would move it ([`standing`]) is one as well: it
//! never leaves its stand, and need not have jumped to it. Where it stands for more than a twentieth of the recording,
//! the verdict says so instead.
//!
//! Traps: an output with a lag that has settled leaves its stand by the largest increment of all, but by more than a
//! quarter of it in the next row. An axis that rests jumps neither before nor after, but for a spike, from which it is
//! back within five rows and which is the gate's. A logger that repeats a slow sensor has its largest increment after
//! every stand; hence q is an increment of the recording itself.

use std::ops::Range;

use sensor_proc::log::Log;
use serde::Serialize;

use super::standing::{self, LARGEST_STANDING};
use crate::model::prediction::stretches;

/// Fewest rows of a dropout.
const LEAST: usize = 3;
/// J in parts of q.
const JUMP: f64 = 3.0;
/// Part of a jump that its next increment exceeds where a lag answers to a step.
const GOES_ON: f64 = 0.25;
/// Part of the increments that exceed q.
const EXCEED: f64 = 0.009;
/// Fewest increments that exceed q.
const EXCEEDING: usize = 5;
/// Rows within which the output is back from a spike.
const SPIKE: usize = 5;
/// Time in which an axis answers to its command, s.
const BEFORE_AN_ANSWER: f64 = 0.5;
/// Most dropouts whose times are kept.
const MOST_TIMES: usize = 100;

/// The dropouts of a recording, as JSON has them.
#[derive(Debug, Default, Clone, PartialEq, Serialize)]
pub struct Dropouts {
    /// Number of dropouts.
    pub count: usize,
    /// Rows in them, which are left out.
    pub rows: usize,
    /// When the first of them begin, s after the first row.
    pub times_s: Vec<f64>,
}

/// Leaves the rows of dropouts out of a recording; nothing is combined over them.
pub fn leave_out(log: &mut Log) -> Dropouts {
    let mut ranges = find(&log.outputs, &log.begins);
    let horizon = (BEFORE_AN_ANSWER / log.period) as usize;
    let stuck = standing::proven(&log.outputs, &log.inputs, &log.begins, horizon).pop();
    let is_stuck = |rows: &Range<usize>| {
        let count = log.outputs.len();
        rows.end == count && (rows.len() as f64) < LARGEST_STANDING * count as f64
    };
    ranges.extend(stuck.filter(is_stuck).filter(|rows| ranges.last().is_none_or(|last| last.end <= rows.start)));
    if log.times.is_empty() {
        // The rows that are left keep their times.
        log.times = (0..log.outputs.len()).map(|k| k as f64 * log.period).collect();
    }
    let times = |rows: &Range<usize>| log.times[rows.start] - log.times[0];
    let dropouts = Dropouts {
        count: ranges.len(),
        rows: ranges.iter().map(|rows| rows.len()).sum(),
        times_s: ranges.iter().take(MOST_TIMES).map(times).collect(),
    };
    for rows in ranges.iter().rev() {
        if let Some(begins) = log.begins.get_mut(rows.end) {
            *begins = true;
        }
        log.begins.drain(rows.clone());
        log.inputs.drain(rows.clone());
        log.outputs.drain(rows.clone());
        log.times.drain(rows.clone());
    }
    dropouts
}

/// The rows of each dropout.
fn find(outputs: &[f64], begins: &[bool]) -> Vec<Range<usize>> {
    let increment = |k: usize| if begins[k] { 0.0 } else { (outputs[k] - outputs[k - 1]).abs() };
    let mut is_border = vec![false; outputs.len() + 1];
    let all = || stretches(begins).flat_map(|stretch| runs(outputs, stretch));
    all().filter(|run| run.len() >= LEAST).for_each(|run| (is_border[run.start], is_border[run.end]) = (true, true));
    let counting = |borders: bool| -> Vec<f64> {
        let rows = (1..outputs.len()).filter(|k| borders || !is_border[*k]);
        rows.map(increment).filter(|increment| *increment > 0.0).collect()
    };
    let (inner, every) = (counting(false), counting(true));
    let mut increments = if 2 * inner.len() > every.len() { inner } else { every };
    increments.sort_by(f64::total_cmp);
    let exceeding = ((EXCEED * increments.len() as f64) as usize).max(EXCEEDING);
    let Some(usual) = increments.iter().rev().nth(exceeding) else { return Vec::new() };
    let limit = JUMP * usual;
    let jumps = |k: usize| k < outputs.len() && increment(k) > limit;
    let goes_on = |k: usize| k + 1 < outputs.len() && increment(k + 1) > GOES_ON * increment(k);
    let is_near = |rows: &[f64], y: f64| rows.iter().any(|other| (other - y).abs() <= limit);
    let is_dropout = |Range { start, end }: &Range<usize>| {
        let (before, after) = (start.saturating_sub(SPIKE)..*start, *end..(end + SPIKE).min(outputs.len()));
        let comes = jumps(*start) && !is_near(&outputs[before], outputs[*start]);
        let goes = jumps(*end) && !goes_on(*end) && !is_near(&outputs[after], outputs[*start]);
        end - start >= LEAST && (comes || goes)
    };
    all().filter(is_dropout).collect()
}

/// The rows of a stretch in runs of equal outputs.
fn runs(outputs: &[f64], stretch: Range<usize>) -> impl Iterator<Item = Range<usize>> {
    let first = stretch.start;
    outputs[stretch].chunk_by(|a, b| a == b).scan(first, |next, run| {
        let start = *next;
        *next += run.len();
        Some(start..*next)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An axis that goes to and fro with up to 1.05 mm a row, read in counts of this size.
    fn outputs(count: f64) -> Vec<f64> {
        let position = |k: f64| 0.1 * (0.01 * k).sin() + 0.005 * (0.01 * k).cos();
        (0..4000).map(|k| (position(f64::from(k)) / count).round() * count).collect()
    }

    fn found(outputs: &[f64]) -> Vec<Range<usize>> {
        find(outputs, &(0..outputs.len()).map(|k| k == 0).collect::<Vec<_>>())
    }

    #[test]
    fn values_that_are_held_or_zero_for_a_while_are_dropouts() {
        let mut held = outputs(1e-5);
        let (one, two) = (held[650], held[1900]);
        held[650..700].fill(one);
        held[1900..1904].fill(two);
        held[2500..2503].fill(0.5);
        held[3990..].fill(-2.0);
        // What stands for four rows jumps by four of the usual increments.
        assert_eq!(found(&held), [650..700, 1900..1904, 2500..2503, 3990..4000]);
    }

    #[test]
    fn many_dropouts_are_found_as_few_are() {
        for count in [10, 40, 60] {
            let mut zeros = outputs(1e-5);
            let at = |i: usize| 20 + i * (3900 / count);
            (0..count).for_each(|i| zeros[at(i)..at(i) + 10].fill(7.0));
            assert_eq!(found(&zeros), (0..count).map(|i| at(i)..at(i) + 10).collect::<Vec<_>>(), "{count}");
        }
    }

    #[test]
    fn coarse_counts_rest_spikes_slow_sensors_and_dead_bands_are_none() {
        for count in [1e-5, 1e-3, 2e-2] {
            assert!(found(&outputs(count)).is_empty(), "{count}");
        }
        // The axis rests for most of the time.
        let mut rests = outputs(1e-5);
        let rest = rests[159];
        rests[159..3800].fill(rest);
        (3800..4000).for_each(|k| rests[k] = rest - 1e-3 * (k - 3799) as f64);
        assert!(found(&rests).is_empty());
        // A spike is the gate's, also at rest.
        let mut spikes = rests;
        [(40, 3.0), (41, 3.0), (90, -1.0), (900, 2.0), (1200, 3.0), (1201, 3.0)]
            .iter()
            .for_each(|(k, y)| spikes[*k] = *y);
        assert!(found(&spikes).is_empty(), "{:?}", found(&spikes));
        // Every value is repeated five times.
        let slow: Vec<f64> = outputs(1e-5).chunks(5).flat_map(|values| [values[0]; 5]).collect();
        assert!(found(&slow).is_empty());
        assert!(found(&[]).is_empty() && found(&[1.0; 100]).is_empty());
    }

    #[test]
    fn a_lag_that_answers_to_a_few_steps_has_no_dropouts() {
        for pole in [0.3, 0.7, 0.95] {
            let steps = |k: usize| [0.0, 0.9, -0.7, 0.4][k / 500];
            let mut y = 0.0;
            let outputs: Vec<f64> = (0..2000)
                .map(|k| {
                    y += (1.0 - pole) * (steps(k) - y);
                    (y / 1e-3_f64).round() * 1e-3
                })
                .collect();
            assert!(found(&outputs).is_empty(), "{pole}: {:?}", found(&outputs));
        }
    }

    #[test]
    fn a_jump_over_a_gap_is_none() {
        let mut outputs = outputs(1e-5);
        let rest = outputs[700];
        outputs[700..720].fill(rest);
        let begins: Vec<bool> = (0..outputs.len()).map(|k| k == 0 || k == 720).collect();
        assert!(find(&outputs, &begins).is_empty());
    }
}
