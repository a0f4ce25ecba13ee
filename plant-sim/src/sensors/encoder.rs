//! An encoder: noise, and rounding to counts.
//!
//! ```text
//! counts = round((y + w)/r)        w ~ N(0, s^2)
//! ```
//!
//! y position, r resolution per count, w noise with the standard deviation s; all in m, at a joint in rad.
//!
//! Trap: the noise is drawn even where s is 0, so that a noise of 0 is a noise as any other.

use super::noise::Noise;

/// One encoder with its noise.
#[derive(Debug, Clone)]
pub struct NoisyEncoder {
    resolution: f64,
    noise: Noise,
}

impl NoisyEncoder {
    /// An encoder with `resolution` m, or rad, per count.
    pub fn new(resolution: f64, noise: Noise) -> Self {
        Self { resolution, noise }
    }

    /// Counts at `value` m, or rad, with newly drawn noise.
    pub fn read(&mut self, value: f64) -> i64 {
        ((value + self.noise.draw()) / self.resolution).round() as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_noise_the_counts_are_rounded() {
        let mut encoder = NoisyEncoder::new(1e-4, Noise::new(0.0, 1, 0));
        for (position, counts) in [(0.0, 0), (0.65, 6500), (0.65004, 6500), (0.65006, 6501), (-0.0012, -12)] {
            assert_eq!(encoder.read(position), counts);
        }
    }
}
