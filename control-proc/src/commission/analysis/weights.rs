//! How much the rows of the fit of a curve count.
//!
//! ```text
//! w_k = e_k (1 + (l_k / (p L))^2)^(-1/2)        l_k = max |y(j+m) - y(j)| over |j - k| T <= 0.4 s        L = max l_k
//! e_k = 1 where u has not changed from 1.5 tau before the row on, as it acts t_d later; 0.3 elsewhere
//! ```
//!
//! u command, y position m, m rows' length, T period, t_d dead time and tau time constant as in the [`super`] module,
//! p [`EVEN_PART`]. Loads, pump and oil change a speed by a part of it, so what a model leaves unexplained grows with
//! the speed. Where all rows count the same, the fast ones decide alone, and the begin of the curve, with which an axis
//! cuts along a line, follows from theirs. And while a motion begins, the pump, the chambers and the swing of the load
//! make more difference to it than the curve. Weights by the spread of the errors make the variance of the result least
//! (A. Aitken, On Least Squares and Linear Combinations of Observations, 1936).
//!
//! Traps: weights by the way of the row itself favour what is slower than it should be. So the fastest row around
//! counts, which belongs to the same motion. And slow motions are damped more by friction than fast ones, so the
//! dynamics are found without weights.

use crate::commission::record::ExperimentRecord;

/// Part of the largest speed below which all rows count nearly the same: errors that do not depend on the speed.
const EVEN_PART: f64 = 1.0 / 6.0;
/// Time around a row in which its fastest motion is looked for, s.
const AROUND: f64 = 0.4;
/// Weight of the begin of a motion.
const EARLY: f64 = 0.3;
/// Time constants after which a motion has begun.
const BEGUN: f64 = 1.5;

/// The weights of all rows of a record.
pub(super) struct Weights(Vec<f64>);

impl Weights {
    /// Of rows that are `ahead` samples long, of an axis with this dead time and time constant, s. A row without a
    /// position has the weight of those around it.
    pub fn of(record: &ExperimentRecord, ahead: usize, dead_time: f64, time_constant: f64) -> Self {
        let samples = |seconds: f64| (seconds / record.period).round() as usize;
        let ways: Vec<f64> = record.positions.windows(ahead + 1).map(|row| (row[ahead] - row[0]).abs()).collect();
        // A way without a position is not a number, which is never the larger one.
        let largest = |ways: &[f64]| ways.iter().fold(0.0f64, |largest, way| largest.max(*way));
        let (even, around) = (EVEN_PART * largest(&ways), samples(AROUND));
        let (late, begun) = (samples(dead_time), samples(BEGUN * time_constant));
        // Ticks for which the command has stayed as it is.
        let mut unchanged = 0;
        let unchanged: Vec<usize> = (record.commands.windows(2))
            .map(|pair| {
                unchanged = if pair[1] == pair[0] { unchanged + 1 } else { 0 };
                unchanged
            })
            .collect();
        let weight = |k: usize| {
            let fastest = largest(&ways[k.saturating_sub(around)..(k + around + 1).min(ways.len())]);
            let by_speed = if even > 0.0 { 1.0 / (fastest / even).hypot(1.0) } else { 1.0 };
            let end = (k + ahead).checked_sub(late + 1).and_then(|end| unchanged.get(end));
            if end.is_some_and(|ticks| *ticks >= ahead + begun) { by_speed } else { EARLY * by_speed }
        };
        Self((0..ways.len()).map(weight).collect())
    }

    /// w of the row that begins at sample `k`.
    pub fn at(&self, k: usize) -> f64 {
        self.0[k]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(commands: Vec<f64>, positions: Vec<f64>) -> ExperimentRecord {
        ExperimentRecord { commands, positions, ..ExperimentRecord::new(0.01, 0) }
    }

    #[test]
    fn fast_motions_count_less_and_all_of_one_motion_the_same() {
        // 1 m/s for 1 s, a pause, 0.01 m/s for 1 s.
        let speed = |k: usize| match k {
            0..100 => 1.0,
            200..300 => 0.01,
            _ => 0.0,
        };
        let mut at = 0.0;
        let moved = |k: usize| {
            at += 0.01 * speed(k);
            at
        };
        let mut record = record(vec![0.0; 400], (0..400).map(moved).collect());
        let weights = Weights::of(&record, 20, 0.0, 0.0);
        let fast = 1.0 / 37.0f64.sqrt();
        assert!((weights.at(10) - fast).abs() < 1e-12 && (weights.at(95) - fast).abs() < 1e-12);
        assert!((weights.at(250) - 1.0).abs() < 0.01, "{}", weights.at(250));
        record.positions[60] = f64::NAN;
        assert!((Weights::of(&record, 20, 0.0, 0.0).at(60) - fast).abs() < 1e-12);
    }

    #[test]
    fn the_begin_of_a_motion_counts_less() {
        // A step at sample 100, which acts from 110 on and has half of its way in 15 more.
        let commands = (0..300).map(|k| if k < 100 { 0.0 } else { 0.5 }).collect();
        let weights = Weights::of(&record(commands, vec![0.5; 300]), 20, 0.1, 0.1);
        let early: Vec<usize> = (40..280).filter(|k| weights.at(*k) < 1.0).collect();
        assert_eq!((early.first(), early.last()), (Some(&90), Some(&124)), "{early:?}");
    }
}
