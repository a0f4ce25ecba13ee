//! Latency histograms; a value beyond the range is counted and not clipped silently.

use hdrhistogram::Histogram;
use iceoryx2::prelude::ZeroCopySend;

use crate::layout::shared_struct;

shared_struct! {
    /// Percentiles of a latency, ns.
    #[derive(serde::Serialize)]
    #[type_name("hydraxis.Percentiles/1")]
    pub struct Percentiles {
        /// Number of values, values beyond the range included.
        pub count: u64,
        /// Median.
        pub p50: u64,
        /// 99 %.
        pub p99: u64,
        /// 99.9 %.
        pub p99_9: u64,
        /// 99.99 %.
        pub p99_99: u64,
        /// Largest value, exact also when it is beyond the histogram's range.
        pub max: u64,
        /// Number of values beyond the histogram's range.
        pub beyond: u64,
    }
}

/// A histogram of latencies from 1 ns to 100 s with three significant digits.
///
/// Memory is taken at construction; recording and reading allocate nothing. A value beyond the range is counted
/// in `beyond`, counts as the upper end in the percentiles, and is exact in `max`.
pub struct LatencyRecorder {
    histogram: Histogram<u64>,
    beyond: u64,
    max: u64,
}

/// Upper end of the range, ns: far above any latency of a loop that still runs.
const LONGEST_NS: u64 = 100_000_000_000;

impl LatencyRecorder {
    /// An empty histogram.
    pub fn new() -> Self {
        let mut histogram =
            Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("the bounds are constants that the histogram accepts");
        // All pages are written now, so that no record is the first to touch one.
        histogram.reset();
        Self { histogram, beyond: 0, max: 0 }
    }

    /// Adds one latency, ns.
    pub fn record(&mut self, nanoseconds: u64) {
        self.max = self.max.max(nanoseconds);
        if nanoseconds > LONGEST_NS {
            self.beyond += 1;
        }
        self.histogram.saturating_record(nanoseconds);
    }

    /// Removes all values.
    pub fn reset(&mut self) {
        self.histogram.reset();
        (self.beyond, self.max) = (0, 0);
    }

    /// The percentiles of all values.
    pub fn percentiles(&self) -> Percentiles {
        let at = |quantile| self.histogram.value_at_quantile(quantile).min(self.max);
        Percentiles {
            count: self.histogram.len(),
            p50: at(0.5),
            p99: at(0.99),
            p99_9: at(0.999),
            p99_99: at(0.9999),
            max: self.max,
            beyond: self.beyond,
        }
    }
}

impl Default for LatencyRecorder {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_to_three_digits() {
        let mut recorder = LatencyRecorder::new();
        (1..=100_000).for_each(|v| recorder.record(v * 1000));
        let p = recorder.percentiles();
        assert_eq!((p.count, p.max, p.beyond), (100_000, 100_000_000, 0));
        for (found, exact) in [(p.p50, 5e7), (p.p99, 9.9e7), (p.p99_9, 9.99e7), (p.p99_99, 9.999e7)] {
            assert!((found as f64 / exact - 1.0).abs() < 2e-3, "{found} for {exact}");
        }
    }

    #[test]
    fn a_value_beyond_the_range_is_counted_and_kept() {
        let mut recorder = LatencyRecorder::new();
        recorder.record(0);
        recorder.record(LONGEST_NS);
        recorder.record(LONGEST_NS * 3);
        let p = recorder.percentiles();
        assert_eq!((p.count, p.beyond, p.max), (3, 1, LONGEST_NS * 3));
        recorder.reset();
        assert_eq!(recorder.percentiles(), Percentiles::default());
    }
}
