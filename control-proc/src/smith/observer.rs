//! Where the axis is, and where it will be when a command of now has acted, by the commissioned model.
//!
//! ```text
//! y_e(k) = y_e(k-1) + Y(k-n) - Y(k-n-1) + T d(k-1)     as expected
//! r(k)   = y(k) - y_e(k),   y_e(k) += (1 - b^2) r(k),   d(k) = d(k-1) + (1 - b)^2 r(k)/T          b = exp(-T/T_o)
//! y_p(k) = y_e(k) + Y(k) - Y(k-n) + tau v(k) + (t_d + tau) d(k)
//! ```
//!
//! y measured position in m; Y(k) way in m that the commands so far make, of which the axis has made Y(k-n), and v
//! speed in m/s behind the lag ([`ExpectedMotion`]); t_d dead time and tau time constant in s, T period in s; d speed
//! in m/s that the model does not explain, T_o time constant of the observer in s. Both poles of the observer are b.

use pipeline::machine::Commissioned;

use crate::{load::Load, model::expected::ExpectedMotion};

/// The observer of one axis.
#[derive(Debug, Clone)]
pub struct Observer {
    expected: ExpectedMotion,
    period: f64,
    /// b.
    pole: f64,
    /// y_e; none before the first position.
    position: Option<f64>,
    /// d.
    unexplained: f64,
}

impl Observer {
    /// By `model`, with T_o of `time` s; `period` in s.
    pub fn new(model: &Commissioned, time: f64, period: f64) -> Self {
        Self {
            expected: ExpectedMotion::new(model, period),
            period,
            pole: (-period / time).exp(),
            position: None,
            unexplained: 0.0,
        }
    }

    /// The axis bears this load from now on.
    pub fn bear(&mut self, load: Load) {
        self.expected.bear(load);
    }

    /// Forgets the past: the axis stands, and the spool is in the middle.
    pub fn reset(&mut self) {
        self.expected.reset();
        (self.position, self.unexplained) = (None, 0.0);
    }

    /// Takes in a position in m, `elapsed` ticks after the last one; `command` has been on the valve since.
    pub fn update(&mut self, elapsed: u64, position: f64, command: f64) {
        let moved = self.expected.advance(elapsed, command) + elapsed as f64 * self.period * self.unexplained;
        let expected = self.position.map_or(position, |last| last + moved);
        let residual = position - expected;
        self.position = Some(expected + (1.0 - self.pole * self.pole) * residual);
        self.unexplained += (1.0 - self.pole).powi(2) * residual / self.period;
    }

    /// y_p, m; none before the first position.
    pub fn predicted(&self) -> Option<f64> {
        let model = self.expected.model();
        let coming = model.time_constant * self.expected.speed() + model.reaction() * self.unexplained;
        Some(self.position? + self.expected.underway() + coming)
    }
}
