//! Noise of a sensor.
//!
//! ```text
//! w ~ N(0, s^2)
//! ```
//!
//! w noise and s its standard deviation, in the unit of the sensor.
//!
//! Trap: if all sensors drew from one random generator, adding one would change the noise of the others. Each sensor
//! therefore has its own generator, seeded by the seed of the run and the number of the sensor.

use rand_distr::{Distribution, StandardNormal};
use rand_pcg::{Pcg64, rand_core::SeedableRng};

/// Distance between the seeds of two sensors: 2^64 divided by the golden ratio, rounded to an odd number. With it no
/// two sensors get the same seed from run seeds that are close to each other.
const SEED_STRIDE: u64 = 0x9e37_79b9_7f4a_7c15;

/// The noise of one sensor.
#[derive(Debug, Clone)]
pub struct Noise {
    deviation: f64,
    generator: Pcg64,
}

impl Noise {
    /// Noise of the sensor with the number `index`, with the standard deviation `deviation`; `seed` is the seed of the
    /// run.
    pub fn new(deviation: f64, seed: u64, index: usize) -> Self {
        let own = seed.wrapping_add(SEED_STRIDE.wrapping_mul(index as u64 + 1));
        Self { deviation, generator: Pcg64::seed_from_u64(own) }
    }

    /// The next value.
    pub fn draw(&mut self) -> f64 {
        let deviate: f64 = StandardNormal.sample(&mut self.generator);
        self.deviation * deviate
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_has_the_given_standard_deviation_and_zero_mean() {
        let mut noise = Noise::new(3e-5, 7, 2);
        let n = 20_000;
        let values: Vec<f64> = (0..n).map(|_| noise.draw()).collect();
        let mean = values.iter().sum::<f64>() / f64::from(n);
        let deviation = (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / f64::from(n)).sqrt();
        assert!(mean.abs() < 4.0 * 3e-5 / f64::from(n).sqrt(), "{mean}");
        assert!((deviation / 3e-5 - 1.0).abs() < 0.03, "{deviation}");
    }

    #[test]
    fn seed_and_index_determine_the_noise() {
        let draw = |seed, index| {
            let mut noise = Noise::new(1e-3, seed, index);
            std::array::from_fn::<f64, 16, _>(|_| noise.draw())
        };
        assert_eq!(draw(1, 0), draw(1, 0));
        assert_ne!(draw(1, 0), draw(2, 0));
        assert_ne!(draw(1, 0), draw(1, 1));
    }
}
