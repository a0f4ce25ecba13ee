//! Running statistics: of an error, small enough to travel in a message, and of an axis that holds a set point. And the
//! median.

use iceoryx2::prelude::ZeroCopySend;

use crate::layout::shared_struct;

shared_struct! {
    /// Count, mean, spread and largest magnitude of a sequence, updated one value at a time (Welford's
    /// recurrence, so that a mean far from zero does not cost digits).
    ///
    /// ```text
    /// mean += (e - mean) / n        m2 += (e - mean_old) (e - mean_new)
    /// sigma = sqrt(m2 / n)          rmse = sqrt(m2 / n + mean^2)
    /// ```
    ///
    /// Trap: after one value that is not finite, mean and sigma are never finite again. This is intended: a model that
    /// diverged once must not look good on average.
    ///
    /// ```
    /// use pipeline::statistics::ErrorStatistics;
    ///
    /// let mut errors = ErrorStatistics::default();
    /// [1.0, 3.0].into_iter().for_each(|error| errors.push(error));
    /// assert_eq!((errors.count, errors.mean, errors.sigma(), errors.max), (2, 2.0, 1.0, 3.0));
    /// ```
    pub struct ErrorStatistics {
        /// Number of values.
        pub count: u64,
        /// Arithmetic mean, in the unit of the values.
        pub mean: f64,
        /// Sum of squared deviations from the mean, in that unit squared.
        pub m2: f64,
        /// Largest magnitude, in that unit.
        pub max: f64,
    }
}

impl ErrorStatistics {
    /// Adds one value.
    pub fn push(&mut self, value: f64) {
        self.count += 1;
        let before = value - self.mean;
        self.mean += before / self.count as f64;
        self.m2 += before * (value - self.mean);
        if value.abs() > self.max || value.is_nan() {
            self.max = value.abs();
        }
    }

    /// Adds all values of `other` (Chan, Golub and LeVeque, 1979).
    pub fn merge(&mut self, other: &Self) {
        if other.count == 0 {
            return;
        }
        let (n, m) = (self.count as f64, other.count as f64);
        let between = other.mean - self.mean;
        self.count += other.count;
        self.mean += between * m / (n + m);
        self.m2 += other.m2 + between * between * n * m / (n + m);
        if other.max > self.max || other.max.is_nan() {
            self.max = other.max;
        }
    }

    /// Standard deviation (divided by the count), NaN without values.
    pub fn sigma(&self) -> f64 {
        (self.m2 / self.count as f64).sqrt()
    }

    /// Root mean square, NaN without values.
    pub fn rmse(&self) -> f64 {
        (self.m2 / self.count as f64 + self.mean * self.mean).sqrt()
    }
}

/// What an axis does while its reference stands.
#[derive(Debug, Clone, Default)]
pub struct HoldStatistics {
    /// Ticks that were watched.
    pub ticks: u64,
    /// Changes of the command's direction: commands in the other direction than the last one that was not neutral.
    pub reversals: u64,
    /// Ticks with a neutral command.
    neutral: u64,
    /// Sign of the last command that was not neutral; 0 before.
    direction: f64,
    /// Least error, m; 0 before the first tick.
    pub lowest: f64,
    /// Greatest error, m; 0 before the first tick.
    pub highest: f64,
}

impl HoldStatistics {
    /// Takes in the error (m) and the command of a tick.
    pub fn push(&mut self, error: f64, command: f64) {
        if self.ticks == 0 {
            (self.lowest, self.highest) = (error, error);
        }
        self.ticks += 1;
        (self.lowest, self.highest) = (self.lowest.min(error), self.highest.max(error));
        if command == 0.0 {
            self.neutral += 1;
        } else {
            self.reversals += u64::from(self.direction * command < 0.0);
            self.direction = command.signum();
        }
    }

    /// Part of the ticks with a neutral command; 0 before the first tick.
    pub fn neutral(&self) -> f64 {
        self.neutral as f64 / self.ticks.max(1) as f64
    }

    /// Largest magnitude of the error, m.
    pub fn largest(&self) -> f64 {
        self.lowest.abs().max(self.highest.abs())
    }

    /// Travel from one end to the other, m.
    pub fn travel(&self) -> f64 {
        self.highest - self.lowest
    }
}

/// The median of the finite values, of an even number of them the upper of the two in the middle; none without any.
///
/// ```
/// use pipeline::statistics::median;
///
/// assert_eq!(median([3.0, f64::NAN, 1.0, 2.0].into_iter()), Some(2.0));
/// assert_eq!(median([4.0, 1.0].into_iter()), Some(4.0));
/// assert_eq!(median([f64::NAN].into_iter()), None);
/// ```
pub fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_the_definition() {
        let values = [1e6 + 4.0, 1e6 + 7.0, 1e6 + 13.0, 1e6 + 16.0];
        let mut statistics = ErrorStatistics::default();
        values.iter().for_each(|&value| statistics.push(value));
        assert_eq!(statistics.count, 4);
        assert!((statistics.sigma() - 22.5f64.sqrt()).abs() < 1e-9);
        let rmse = (values.iter().map(|v| v * v).sum::<f64>() / 4.0).sqrt();
        assert!((statistics.rmse() / rmse - 1.0).abs() < 1e-12);
        assert_eq!(statistics.max, 1e6 + 16.0);
    }

    #[test]
    fn merged_parts_equal_the_whole() {
        let values = [3.0, -7.0, 13.0, 16.0, 1.0];
        let of = |values: &[f64]| {
            let mut statistics = ErrorStatistics::default();
            values.iter().for_each(|&value| statistics.push(value));
            statistics
        };
        for split in 0..=values.len() {
            let (mut merged, all) = (of(&values[..split]), of(&values));
            merged.merge(&of(&values[split..]));
            assert_eq!((merged.count, merged.max), (all.count, all.max));
            assert!((merged.mean - all.mean).abs() < 1e-12 && (merged.m2 - all.m2).abs() < 1e-9, "{split}");
        }
    }

    #[test]
    fn one_value_that_is_not_finite_makes_the_statistics_not_finite() {
        let mut statistics = ErrorStatistics::default();
        statistics.push(f64::NAN);
        statistics.push(1.0);
        assert!(statistics.sigma().is_nan() && statistics.rmse().is_nan());
    }
}
