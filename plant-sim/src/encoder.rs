//! The position encoder: noise, and rounding to counts.
//!
//! ```text
//! counts = round((y + w)/r)        w ~ N(0, s^2)
//! ```
//!
//! y position, m; r resolution, m per count; w noise with the standard deviation s, m.
//!
//! Trap: if all axes drew from one random generator, adding an axis would change the noise of the others. Each encoder
//! therefore has its own generator, seeded by the seed of the run and the number of the axis.

use rand_distr::{Distribution, StandardNormal};
use rand_pcg::{Pcg64, rand_core::SeedableRng};

/// Distance between the seeds of two axes: 2^64 divided by the golden ratio, rounded to an odd number. With it no two
/// axes get the same seed from run seeds that are close to each other.
const SEED_STRIDE: u64 = 0x9e37_79b9_7f4a_7c15;

/// One encoder with its noise.
#[derive(Debug, Clone)]
pub struct NoisyEncoder {
    resolution: f64,
    noise: f64,
    generator: Pcg64,
}

impl NoisyEncoder {
    /// Encoder of the axis with the number `index`, with `resolution` m per count and noise of the standard deviation
    /// `noise` m; `seed` is the seed of the run.
    pub fn new(resolution: f64, noise: f64, seed: u64, index: usize) -> Self {
        let own = seed.wrapping_add(SEED_STRIDE.wrapping_mul(index as u64 + 1));
        Self { resolution, noise, generator: Pcg64::seed_from_u64(own) }
    }

    /// Counts at `position` m with newly drawn noise.
    pub fn read(&mut self, position: f64) -> i64 {
        let deviate: f64 = StandardNormal.sample(&mut self.generator);
        ((position + self.noise * deviate) / self.resolution).round() as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_noise_the_counts_are_rounded() {
        let mut encoder = NoisyEncoder::new(1e-4, 0.0, 1, 0);
        for (position, counts) in [(0.0, 0), (0.65, 6500), (0.65004, 6500), (0.65006, 6501), (-0.0012, -12)] {
            assert_eq!(encoder.read(position), counts);
        }
    }

    #[test]
    fn the_noise_has_the_given_standard_deviation_and_zero_mean() {
        let mut encoder = NoisyEncoder::new(1e-6, 3e-5, 7, 2);
        let n = 20_000;
        let counts: Vec<f64> = (0..n).map(|_| encoder.read(0.0) as f64 * 1e-6).collect();
        let mean = counts.iter().sum::<f64>() / f64::from(n);
        let deviation = (counts.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / f64::from(n)).sqrt();
        assert!(mean.abs() < 4.0 * 3e-5 / f64::from(n).sqrt(), "{mean}");
        assert!((deviation / 3e-5 - 1.0).abs() < 0.03, "{deviation}");
    }

    #[test]
    fn seed_and_index_determine_the_noise() {
        let draw = |seed, index| {
            let mut encoder = NoisyEncoder::new(1e-6, 1e-3, seed, index);
            std::array::from_fn::<i64, 16, _>(|_| encoder.read(0.0))
        };
        assert_eq!(draw(1, 0), draw(1, 0));
        assert_ne!(draw(1, 0), draw(2, 0));
        assert_ne!(draw(1, 0), draw(1, 1));
    }
}
