//! Contestants that take turns, their times, and the table of the figures.

use std::time::Instant;

use serde_json::{Value, json};

/// One contestant: the subject that works, and the times that its work took.
pub struct Contestant<S> {
    pub name: String,
    pub subject: S,
    /// Times of the samples so far, ns.
    times: Vec<f64>,
}

impl<S> Contestant<S> {
    pub fn new(name: impl Into<String>, subject: S) -> Self {
        Self { name: name.into(), subject, times: Vec::new() }
    }

    /// Times `work` as one sample: the mean time of the `updates` that it makes.
    pub fn time<R>(&mut self, updates: usize, work: impl FnOnce(&mut S) -> R) -> R {
        let start = Instant::now();
        let result = work(&mut self.subject);
        self.times.push(start.elapsed().as_nanos() as f64 / updates as f64);
        result
    }

    /// Name and figures.
    pub fn figures(self) -> (String, Figures) {
        (self.name, Figures::new(self.times))
    }
}

/// Figures of the times of one contestant, ns.
pub struct Figures {
    pub p50: f64,
    pub p99: f64,
    pub p999: f64,
    pub max: f64,
    pub mean: f64,
    pub samples: usize,
}

impl Figures {
    fn new(mut times: Vec<f64>) -> Self {
        times.sort_by(f64::total_cmp);
        let samples = times.len();
        let part = |part: f64| times[((samples as f64 * part).ceil() as usize).clamp(1, samples) - 1];
        let mean = times.iter().sum::<f64>() / samples as f64;
        Self { p50: part(0.5), p99: part(0.99), p999: part(0.999), max: times[samples - 1], mean, samples }
    }

    /// Prints the first columns of a table's line, without the end of the line.
    pub fn print(&self, name: &str) {
        let Self { p50, p99, p999, max, samples, .. } = self;
        print!("{name:<23} {p50:>9.1} {p99:>9.1} {p999:>9.1} {max:>9.1} {samples:>10}");
    }

    pub fn json(&self, name: &str) -> Value {
        json!({
            "name": name, "samples": self.samples, "p50_ns": self.p50, "p99_ns": self.p99, "p99_9_ns": self.p999,
            "max_ns": self.max, "mean_ns": self.mean,
        })
    }
}

/// Prints the head of a table whose lines [`Figures::print`] begins. `title` names the table, `last` the other columns.
pub fn head(title: &str, last: &str) {
    println!("\n{title:<23} p50, ns       p99     p99.9       max    samples{last}");
}
