//! Fallback and Smith predictor as transfer functions from the measured position to the command.
//!
//! ```text
//! C   = kp + ki T / (z - 1)                               u = -C y                      the fallback
//! u   = -C y_p          y_p = G_0 u + F (y - M u)         K = C F / (1 + C (G_0 - F M))      the Smith predictor
//! X   = (1 - a) q / (1 - a q)          G_0 = g (T / (1 - q) + tau) X          M = g T / (1 - q) X ((1 - f) + f q) q^n
//! F   = ((1 - b^2) (1 - q) + (1 - b)^2 (q + (1 - q) (t_d + tau) / T)) / (1 - b q)^2
//! ```
//!
//! u command, y position m, q = 1/z, a = exp(-T/tau), b = exp(-T/T_o), T_o time constant of the observer in s, t_d/T =
//! n + f dead time in periods; the other symbols are those of `plant` and of [`crate::smith`]. F follows from the
//! equations of the observer: with r = y - y_e it is r = (1 - q)^2 / (1 - b q)^2 (y - M u), and y_p is the sum of y_e
//! and of what is under way. F is 1 at rest (q = 1). The model in a Smith predictor has no swing.

use nalgebra::Complex;
use pipeline::{
    hammerstein::MAX_DELAY,
    machine::{Commissioned, SmithSettings},
};

/// A controller.
#[derive(Debug, Clone)]
pub struct Controller {
    kp: f64,
    ki: f64,
    predictor: Option<Predictor>,
}

/// The model and the observer of a Smith predictor.
#[derive(Debug, Clone)]
struct Predictor {
    /// g.
    gain: f64,
    /// t_d, s.
    dead_time: f64,
    /// tau, s.
    time_constant: f64,
    /// a.
    kept: f64,
    /// b.
    pole: f64,
}

impl Controller {
    /// The fallback, with gains in 1/m and 1/(m s).
    pub fn proportional_integral(kp: f64, ki: f64) -> Self {
        Self { kp, ki, predictor: None }
    }

    /// The Smith predictor by `model` where its curve has the slope `gain` m/s per command; `period` in s.
    pub fn smith(settings: &SmithSettings, model: &Commissioned, gain: f64, period: f64) -> Self {
        let tau = model.time_constant;
        let predictor = Predictor {
            gain,
            dead_time: model.dead_time,
            time_constant: tau,
            kept: if tau > 0.0 { (-period / tau).exp() } else { 0.0 },
            pole: (-period / settings.observer_time).exp(),
        };
        Self { kp: settings.kp, ki: settings.ki, predictor: Some(predictor) }
    }

    /// C (G_0 - F M), which is 0 for the fallback, and C F, which is C for the fallback; at z, `period` in s.
    pub fn at(&self, z: Complex<f64>, period: f64) -> (Complex<f64>, Complex<f64>) {
        let law = self.kp + self.ki * period / (z - 1.0);
        let Some(predictor) = &self.predictor else { return (Complex::from(0.0), law) };
        let (coming, delayed, filter) = predictor.at(z, period);
        (law * (coming - filter * delayed), law * filter)
    }
}

impl Predictor {
    /// G_0, M and F.
    fn at(&self, z: Complex<f64>, period: f64) -> (Complex<f64>, Complex<f64>, Complex<f64>) {
        let q = z.inv();
        let ticks = self.dead_time / period;
        let whole = (ticks as usize).min(MAX_DELAY);
        let part = (ticks - whole as f64).min(1.0);
        let one = Complex::from(1.0);
        let sum = period / (one - q);
        let speed = q * (self.gain * (1.0 - self.kept)) / (one - q * self.kept);
        let delayed = speed * sum * (q * part + (1.0 - part)) * q.powi(whole as i32);
        let reaction = (self.dead_time + self.time_constant) / period;
        let slow = (1.0 - self.pole).powi(2);
        let filter = (one - q) * (1.0 - self.pole * self.pole) + (q + (one - q) * reaction) * slow;
        (speed * (sum + self.time_constant), delayed, filter / (one - q * self.pole).powi(2))
    }
}
