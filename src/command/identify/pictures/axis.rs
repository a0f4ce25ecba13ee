//! The rows of a record along one axis of time, and lines with fewer points than rows.
//!
//! Recordings follow each other. A gap is drawn as long as it is, but not longer than [`LONGEST_GAP`]: otherwise a
//! night between two recordings would leave no room for them.

use super::super::record::Record;

/// Longest gap, as a part of the time of all rows.
const LONGEST_GAP: f64 = 0.02;
/// Points of a line, about two for each pixel of its width.
const POINTS: usize = 1200;

/// The axis of time of one record.
#[derive(Debug)]
pub struct Axis {
    /// Place of each row, s.
    pub times: Vec<f64>,
    /// Whether a gap is before each row.
    begins: Vec<bool>,
    /// Whether a gap is drawn shorter than it is.
    pub is_shortened: bool,
    /// Places where a recording begins, but for the first one.
    pub recordings: Vec<f64>,
}

impl Axis {
    /// The axis of a record.
    pub fn new(record: &Record) -> Self {
        let rows = record.outputs.len();
        let longest = (LONGEST_GAP * rows as f64 * record.period).max(record.period);
        let firsts: Vec<usize> = record.first_rows().collect();
        let mut axis = Self {
            times: Vec::with_capacity(rows),
            begins: record.begins.clone(),
            is_shortened: false,
            recordings: Vec::new(),
        };
        let mut now = 0.0;
        for k in 0..rows {
            if k > 0 {
                let step = record.times[k] - record.times[k - 1];
                now += match (record.begins[k], firsts.contains(&k)) {
                    (false, _) => step,
                    (true, true) => longest,
                    (true, false) if step > longest || step <= 0.0 => {
                        axis.is_shortened = true;
                        longest
                    }
                    (true, false) => step,
                };
            }
            if k > 0 && firsts.contains(&k) {
                axis.recordings.push(now);
            }
            axis.times.push(now);
        }
        axis
    }

    /// The line through these values of the rows `first` to `end`, one value for each row of the record. It is broken
    /// at gaps and where a value is not finite.
    pub fn line(&self, values: &[f64], (first, end): (usize, usize)) -> Vec<(f64, f64)> {
        let mut line = Vec::new();
        for [low, high] in self.extremes(values, (first, end)) {
            let is_rising = low.0 <= high.0;
            line.push(if is_rising { low } else { high });
            if high != low && high.1.is_finite() {
                line.push(if is_rising { high } else { low });
            }
        }
        line
    }

    /// The corners of the areas `wide` above and below these values.
    pub fn band(&self, values: &[f64], (first, end): (usize, usize), wide: f64) -> Vec<(f64, f64)> {
        let extremes = self.extremes(values, (first, end));
        let mut corners = Vec::new();
        for part in extremes.split(|[low, _]| !low.1.is_finite()) {
            corners.extend(part.iter().map(|[_, high]| (high.0, high.1 + wide)));
            corners.extend(part.iter().rev().map(|[low, _]| (low.0, low.1 - wide)));
            corners.push((0.0, f64::NAN));
        }
        corners
    }

    /// Lowest and highest value of some rows each, so few that a line has about [`POINTS`] points. A value that is not
    /// finite stands where a line is broken.
    fn extremes(&self, values: &[f64], (first, end): (usize, usize)) -> Vec<[(f64, f64); 2]> {
        // Each group of rows has two points; as many points as rows need no groups.
        let together = if end - first <= POINTS { 1 } else { (2 * (end - first)).div_ceil(POINTS) };
        let mut all: Vec<[(f64, f64); 2]> = Vec::new();
        let mut count = 0;
        for (k, value) in values.iter().enumerate().take(end).skip(first) {
            let point = (self.times[k], *value);
            if !point.1.is_finite() || self.begins[k] {
                all.push([(point.0, f64::NAN); 2]);
                count = 0;
            }
            if !point.1.is_finite() {
                continue;
            }
            match all.last_mut() {
                Some([low, high]) if count > 0 && count < together => {
                    if point.1 < low.1 {
                        *low = point;
                    }
                    if point.1 > high.1 {
                        *high = point;
                    }
                }
                _ => {
                    all.push([point; 2]);
                    count = 0;
                }
            }
            count += 1;
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(rows: usize, gap: usize) -> Axis {
        let begins = (0..rows).map(|k| k == 0 || k == gap).collect();
        Axis { times: (0..rows).map(|k| k as f64).collect(), begins, is_shortened: false, recordings: Vec::new() }
    }

    #[test]
    fn a_line_keeps_every_peak_and_breaks_at_gaps() {
        let axis = axis(100_000, 50_000);
        let mut values = vec![0.0; 100_000];
        (values[777], values[50_001], values[70_000]) = (5.0, -3.0, f64::NAN);
        let line = axis.line(&values, (0, 100_000));
        assert!(line.len() < 1300, "{}", line.len());
        assert!(line.contains(&(777.0, 5.0)) && line.contains(&(50_001.0, -3.0)));
        let breaks: Vec<f64> = line.iter().filter(|point| point.1.is_nan()).map(|point| point.0).collect();
        assert_eq!(breaks, [0.0, 50_000.0, 70_000.0]);
        let band = axis.band(&values, (0, 100_000), 2.0);
        assert!(band.contains(&(777.0, 7.0)) && band.contains(&(50_001.0, -5.0)));
    }

    #[test]
    fn a_short_line_has_all_points() {
        let values: Vec<f64> = (0..50).map(f64::from).collect();
        let line = axis(50, 0).line(&values, (10, 20));
        assert_eq!(line, (10..20).map(|k| (f64::from(k), f64::from(k))).collect::<Vec<_>>());
    }
}
