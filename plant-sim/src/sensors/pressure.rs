//! The pressure transducers of one axis: noise, and rounding to the resolution.
//!
//! ```text
//! p_m = r round((p + w)/r)        w ~ N(0, s^2)
//! ```
//!
//! p chamber pressure, p_m measured pressure, r resolution, w noise with the standard deviation s; all in Pa above the
//! atmosphere. Assumed: a transducer is fast against the sample period (its bandwidth is that of its electronics, about
//! 1 kHz), so it has no lag. Trap: the range is not limited here; the acquisition refuses what lies outside it.

use pipeline::machine::PressureTransducers;

use super::noise::Noise;

/// The transducers at both chambers.
#[derive(Debug, Clone)]
pub struct NoisyTransducers {
    resolution: f64,
    noise: Noise,
}

impl NoisyTransducers {
    /// Transducers with this noise, Pa.
    pub fn new(transducers: &PressureTransducers, noise: Noise) -> Self {
        Self { resolution: transducers.resolution, noise }
    }

    /// What one of the transducers measures at `pressure` Pa, with newly drawn noise, Pa.
    pub fn read(&mut self, pressure: f64) -> f64 {
        ((pressure + self.noise.draw()) / self.resolution).round() * self.resolution
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pressure_is_measured_within_half_a_step_and_its_noise() {
        let transducers = PressureTransducers { resolution: 5e3, range: 60e6 };
        let mut exact = NoisyTransducers::new(&transducers, Noise::new(0.0, 1, 0));
        assert_eq!([0.0, 2.4e3, 2.6e3, 17.3e6 + 1e3].map(|pressure| exact.read(pressure)), [0.0, 0.0, 5e3, 17.3e6]);
        let mut noisy = NoisyTransducers::new(&transducers, Noise::new(2e4, 1, 0));
        let errors: Vec<f64> = (0..10_000).map(|_| noisy.read(1e7) - 1e7).collect();
        let deviation = (errors.iter().map(|error| error * error).sum::<f64>() / 10_000.0).sqrt();
        // Noise and rounding: s^2 + r^2/12.
        assert!((deviation / (4e8f64 + 25e6 / 12.0).sqrt() - 1.0).abs() < 0.03, "{deviation}");
    }
}
