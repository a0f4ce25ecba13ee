//! Distributions of times, by what was going on meanwhile.

use std::collections::BTreeMap;

/// Times by name, ms.
#[derive(Default)]
pub struct Figures(BTreeMap<String, Vec<f64>>);

impl Figures {
    pub fn take(&mut self, name: impl Into<String>, milliseconds: f64) {
        self.0.entry(name.into()).or_default().push(milliseconds);
    }

    /// Number of times of this name above a bound.
    pub fn above(&self, name: &str, bound: f64) -> usize {
        self.0.get(name).map_or(0, |times| times.iter().filter(|time| **time > bound).count())
    }

    /// Median of the times of this name; none without any.
    pub fn median(&self, name: &str) -> Option<f64> {
        let mut times = self.0.get(name)?.clone();
        times.sort_unstable_by(f64::total_cmp);
        Some(quantile(&times, 0.5))
    }

    /// A line for each name.
    pub fn table(&self) -> String {
        let mut text = format!("{:72} {:>6} {:>8} {:>8} {:>8} {:>8}\n", "ms", "count", "p50", "p99", "p99.9", "max");
        for (name, times) in &self.0 {
            let mut times = times.clone();
            times.sort_unstable_by(f64::total_cmp);
            let [p50, p99, p999, max] = [0.5, 0.99, 0.999, 1.0].map(|part| quantile(&times, part));
            text += &format!("{name:72} {:6} {p50:8.2} {p99:8.2} {p999:8.2} {max:8.2}\n", times.len());
        }
        text
    }
}

/// The smallest of the sorted times that so large a part of them does not exceed.
fn quantile(sorted: &[f64], part: f64) -> f64 {
    sorted[((part * sorted.len() as f64).ceil() as usize).clamp(1, sorted.len()) - 1]
}
