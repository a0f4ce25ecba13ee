//! The smoothed row and target.
//!
//! ```text
//! x_s(k) = p x_s(k-1) + (1 - p) x(k)          p = exp(-1 / (c h))
//! ```
//!
//! c time constant in horizons, x any entry of the row, or the target; h horizon in samples. Row and target go through
//! one filter, so the model stays the same. The noise of the encoder counts less in the fit, and errors that last over
//! the horizon count more (Shook, Mohtadi and Shah, Identification for long-range predictive control, IEE Proceedings D
//! 138, 1991).

/// Time constant of the filter that the family `smoothed` learns from, in horizons.
pub const SMOOTHED: f64 = 0.12;
/// Time constant of the filter whose rows weigh the products in their separation, in horizons. An error over the
/// horizon sees the sum of the commands within it; an error of one step sees little more than their highest
/// frequencies.
pub const INTEGRATED: f64 = 0.5;

/// The filter of row and target. Its memory is allocated at construction.
#[derive(Debug, Clone)]
pub struct Smoother {
    /// p.
    keep: f64,
    /// The smoothed row and, last, the smoothed target.
    values: Vec<f64>,
    /// Whether `values` continue into the next sample.
    running: bool,
}

impl Smoother {
    /// For rows of `n` entries, a time constant in horizons, and a horizon in samples.
    pub fn new(n: usize, time_constant: f64, horizon: usize) -> Self {
        let keep = (-1.0 / (time_constant * horizon as f64)).exp();
        Self { keep, values: vec![0.0; n + 1], running: false }
    }

    /// Takes in y(k) and the row of sample k.
    pub fn update(&mut self, y: f64, row: &[f64]) {
        let keep = if self.running { self.keep } else { 0.0 };
        for (smoothed, value) in self.values.iter_mut().zip(row.iter().chain([&y])) {
            *smoothed = keep * *smoothed + (1.0 - keep) * value;
        }
        self.running = true;
    }

    /// The smoothed row and the smoothed target.
    pub fn values(&self) -> (&[f64], f64) {
        let (target, row) = self.values.split_last().expect("there is always a target");
        (row, *target)
    }

    /// Begins anew at the next sample, after a gap.
    pub fn interrupt(&mut self) {
        self.running = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_a_first_order_lag_that_begins_at_its_first_input() {
        let mut smoother = Smoother::new(2, SMOOTHED, 25);
        smoother.update(3.0, &[1.0, 2.0]);
        assert_eq!(smoother.values(), (&[1.0, 2.0][..], 3.0));
        (0..3).for_each(|_| smoother.update(0.0, &[0.0, 2.0]));
        // Time constant of three samples.
        assert!((smoother.values().1 - 3.0 * (-1.0f64).exp()).abs() < 1e-12);
        assert!((smoother.values().0[1] - 2.0).abs() < 1e-12);
        smoother.interrupt();
        smoother.update(5.0, &[4.0, 4.0]);
        assert_eq!(smoother.values(), (&[4.0, 4.0][..], 5.0));
    }
}
