//! Latencies of all ticks of a recording, as percentiles.
//!
//! ```text
//! end to end  = command sent - sample acquired          jitter = |time between two samples - period|
//! ```

use hdrhistogram::Histogram;
use plotters::prelude::Color;

use crate::report::{
    chart::{COLOURS, Chart, Mark, Series, WIDE},
    table::nanoseconds,
};

/// Longest latency, ns; a longer one counts as this one.
const LONGEST_NS: u64 = 100_000_000_000;
/// Points of a curve for each nine of the percentile.
const POINTS: usize = 20;
/// Most nines: 99.999 %.
const NINES: usize = 5;
/// Percentiles of the table.
const COLUMNS: [(f64, &str); 5] =
    [(0.5, "p50"), (0.99, "p99"), (0.999, "p99.9"), (0.9999, "p99.99"), (0.99999, "p99.999")];

/// One kind of latency.
#[derive(Debug)]
pub struct Latency {
    name: &'static str,
    histogram: Histogram<u64>,
}

impl Latency {
    /// Without values.
    pub fn new(name: &'static str) -> Self {
        // The bounds are constants that the library accepts; without a histogram nothing would be counted.
        let histogram =
            Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("the bounds are constants that the histogram accepts");
        Self { name, histogram }
    }

    /// Adds one, ns.
    pub fn record(&mut self, nanoseconds: u64) {
        self.histogram.saturating_record(nanoseconds);
    }

    /// Number of values.
    pub fn count(&self) -> u64 {
        self.histogram.len()
    }

    /// The value that the part `quantile` of all values does not exceed, ns.
    pub fn at(&self, quantile: f64) -> u64 {
        self.histogram.value_at_quantile(quantile).min(self.histogram.max())
    }

    /// Whether there are so many values that a percentile is one of them.
    fn reaches(&self, quantile: f64) -> bool {
        self.count() as f64 * (1.0 - quantile) >= 1.0 - 1e-9
    }

    /// Row of the table: name, count, percentiles, largest value. A percentile of too few values is left out.
    pub fn row(&self) -> Vec<String> {
        let column = |(quantile, _): (f64, &str)| {
            if self.reaches(quantile) { nanoseconds(self.at(quantile)) } else { "-".to_owned() }
        };
        let mut row = vec![self.name.to_owned(), self.count().to_string()];
        row.extend(COLUMNS.map(column));
        row.push(if self.count() > 0 { nanoseconds(self.histogram.max()) } else { "-".to_owned() });
        row
    }

    /// Points of the curve: nines of the percentile, and decimal logarithm of the latency in us.
    fn curve(&self) -> Vec<(f64, f64)> {
        let steps = (0..=POINTS * NINES).map(|i| i as f64 / POINTS as f64);
        let inside = steps.filter(|nines| self.count() > 0 && self.reaches(1.0 - 10f64.powf(-nines)));
        inside.map(|nines| (nines, micro_log(self.at(1.0 - 10f64.powf(-nines))))).collect()
    }
}

/// Header of the table.
pub fn header() -> Vec<String> {
    let names = COLUMNS.map(|(_, name)| name);
    ["latency", "count"].into_iter().chain(names).chain(["max"]).map(str::to_owned).collect()
}

/// Decimal logarithm of a time in us.
fn micro_log(nanoseconds: u64) -> f64 {
    (nanoseconds.max(1) as f64 * 1e-3).log10()
}

/// The curves of all latencies up to 99.999 %, with the period; none without values.
pub fn chart(latencies: &[&Latency], period_s: f64) -> Option<Chart> {
    let with_values = latencies.iter().filter(|latency| latency.count() > 1);
    let mut series: Vec<Series> = with_values
        .zip(COLOURS)
        .map(|(latency, colour)| Series {
            name: latency.name.to_owned(),
            points: latency.curve(),
            colour: colour.into(),
            mark: Mark::Line(4),
        })
        .collect();
    if series.is_empty() {
        return None;
    }
    let points = || series.iter().flat_map(|series| &series.points);
    let period = (period_s * 1e6).log10();
    let low = points().map(|point| point.1).fold(period, f64::min).floor();
    let high = points().map(|point| point.1).fold(period, f64::max).ceil();
    let grey = COLOURS[6].mix(0.8);
    let ends = vec![(0.0, period), (NINES as f64, period)];
    series.push(Series { name: "one period".to_owned(), points: ends, colour: grey, mark: Mark::Line(2) });
    Some(Chart {
        title: "Latencies by percentile".to_owned(),
        size: WIDE,
        labels: ["part of the ticks".to_owned(), "latency".to_owned()],
        tick: nines,
        y_tick: Some(time),
        series,
        notes: Vec::new(),
        frame: Some([(0.0, NINES as f64), (low, high.max(low + 1.0))]),
    })
}

/// The percentile with so many nines.
fn nines(nines: &f64) -> String {
    if (nines - nines.round()).abs() > 1e-6 {
        return String::new();
    }
    ["0 %", "90 %", "99 %", "99.9 %", "99.99 %", "99.999 %"]
        .get(nines.round() as usize)
        .map_or("", |text| text)
        .to_owned()
}

/// The time with this decimal logarithm, us.
fn time(exponent: &f64) -> String {
    let is_decade = (exponent - exponent.round()).abs() < 1e-6;
    if is_decade { nanoseconds_short(10f64.powi(exponent.round() as i32 + 3)) } else { String::new() }
}

/// A power of ten in ns with its unit.
fn nanoseconds_short(value: f64) -> String {
    match value {
        ..1e3 => format!("{value:.0} ns"),
        ..1e6 => format!("{:.0} us", value / 1e3),
        ..1e9 => format!("{:.0} ms", value / 1e6),
        _ => format!("{:.0} s", value / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_of_too_few_values_are_left_out() {
        let mut latency = Latency::new("end to end");
        (1..=1000).for_each(|us| latency.record(us * 1000));
        let row = latency.row();
        assert_eq!(row[..3], ["end to end", "1000", "500.2 us"].map(String::from));
        assert_eq!((row[4].as_str(), row[5].as_str(), row[6].as_str()), ("999.4 us", "-", "-"));
        let curve = latency.curve();
        let last = curve[curve.len() - 1];
        assert!((last.0 - 3.0).abs() < 1e-9 && (last.1 - 3.0).abs() < 0.01, "{last:?}");
    }

    #[test]
    fn the_curve_has_decades_at_its_edges() {
        let mut latency = Latency::new("jitter");
        (0..100_000).for_each(|i| latency.record(if i < 2 { 50_000_000 } else { 20_000 }));
        let chart = chart(&[&latency], 0.01).unwrap();
        assert_eq!(chart.frame, Some([(0.0, 5.0), (1.0, 5.0)]));
        assert!(chart.series[0].points.iter().all(|(x, y)| (0.0..=5.0).contains(x) && (1.0..=5.0).contains(y)));
        let svg = chart.svg().unwrap();
        assert!(["99.999 %", "10 us", "100 ms", "one period"].iter().all(|text| svg.contains(text)), "{svg}");
        assert!(super::chart(&[&Latency::new("none")], 0.01).is_none());
    }
}
