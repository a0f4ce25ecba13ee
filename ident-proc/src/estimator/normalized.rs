//! The fuzzy factor on normalised errors: Table 1 and (21) for noise that the paper's universes do not fit.
//!
//! ```text
//! z(k) = e(k) / (s(k-1) sqrt(1 + phi' P phi))           dz(k) = z(k) - z(k-1)
//! lambda = low + (1 - low) (table(z, dz) - 0.75) / 0.25
//! s(k)^2 = s(k-1)^2 [1 - g + g min(z(k)^2, c^2) / m(c)]      s(k) >= floor
//! m(c) = E min(x^2, c^2) for x standard normal               g = 1/256, c = 2
//! ```
//!
//! e innovation and s running scale of its noise, both in the unit of the target. s starts at the standard deviation of
//! the residuals of offline identification and does not fall below a quarter of it. Otherwise, at rest, where the
//! errors of a counting encoder are zero, s would fall so far that the first sample of the next motion were a thousand
//! sigmas.
//!
//! An error counts at most as c sigmas (Huber: Robust Statistics, 1981); m(c) makes the scale that of normal noise
//! again. So one outlier moves s by less than a hundredth, while errors that stay large double it in about 100 samples.
//! From then on they count as noise. A wrong structure therefore does not keep the memory short for ever, as it does
//! with fixed universes. The root is the part of e that the uncertainty of the coefficients explains; without it a
//! short memory makes larger errors, and those a shorter memory.
//!
//! PB is 8 sigmas of the error and 8 sqrt(2) sigmas of its change; of white noise these are 8 standard deviations each.
//! Neighbouring terms are then 2.7 sigmas apart. White noise lowers the factor by 6 % of its range on average: by 0.006
//! with low 0.9. With PB at 4 sigmas it would be 18 %, and with the paper's ratio of the two universes, one half, 35 %:
//! the table asks for a small factor wherever the change is large, and the change of white noise is larger than the
//! error.
//!
//! Trap: a change of the plant is followed only until s has grown to it, for some 100 samples of errors. With low below
//! about 0.9 that is more than enough; with low near 1 it may not be.

use pipeline::machine::{Fuzzy, Level};

use super::{Adapted, Method, fuzzy::FuzzyForgetting};
use crate::{
    least_squares::Triangle,
    recursive::{Change, RecursiveLeastSquares},
};

/// Error that counts as PB, in standard deviations.
const ERROR_UNIVERSE: f64 = 8.0;
/// Change of error that counts as PB, in standard deviations of the error.
const VARIATION_UNIVERSE: f64 = ERROR_UNIVERSE * std::f64::consts::SQRT_2;
/// g, the inverse of the memory of the scale in samples.
const SCALE_GAIN: f64 = 1.0 / 256.0;
/// c, the largest error that the scale takes in, in standard deviations.
const CLIP: f64 = 2.0;
/// m(c) of c = 2.
const CLIPPED_VARIANCE: f64 = 0.920_536_925;
/// Smallest scale, in parts of the standard deviation of the residuals of offline identification.
const FLOOR: f64 = 0.25;

/// The estimator `fuzzy:LOW`.
#[derive(Debug, Clone)]
pub struct Normalized {
    recursion: RecursiveLeastSquares,
    table: FuzzyForgetting,
    low: f64,
    scale: f64,
    floor: f64,
    last: f64,
}

impl Normalized {
    /// For `n` coefficients with the smallest factor `low`. The universes of `settings` are not used.
    pub fn new(n: usize, settings: &Fuzzy, low: f64) -> Self {
        let settings =
            Fuzzy { error_universe: Some(ERROR_UNIVERSE), variation_universe: Some(VARIATION_UNIVERSE), ..*settings };
        Self {
            recursion: RecursiveLeastSquares::new(n),
            table: FuzzyForgetting::new(settings, 0.0),
            low,
            scale: f64::MIN_POSITIVE,
            floor: f64::MIN_POSITIVE,
            last: 0.0,
        }
    }
}

impl Method for Normalized {
    fn start(&mut self, data: &Triangle, held: &[bool], residual_sigma: f64) {
        self.recursion.start(data, held);
        // With a residual of zero (data without noise) every error but zero is beyond the universe.
        self.floor = (FLOOR * residual_sigma).max(f64::MIN_POSITIVE);
        self.scale = residual_sigma.max(self.floor);
        self.last = 0.0;
    }

    fn set_theta(&mut self, theta: &[f64]) {
        self.recursion.set_theta(theta);
    }

    fn update(&mut self, phi: &[f64], target: f64) -> Adapted {
        let (table, scale, last) = (&self.table, &mut self.scale, &mut self.last);
        let mut factor = 1.0;
        let update = self.recursion.update_by(phi, target, |e, leverage| {
            // Beyond the universe the size has no effect; but the difference of two infinite errors is no number.
            let z = (e / (*scale * (1.0 + leverage).sqrt())).clamp(-1e6, 1e6);
            let table = table.evaluate(z, z - *last);
            let (least, most) = (Level::VS.factor(), Level::VB.factor());
            factor = (self.low + (1.0 - self.low) * (table - least) / (most - least)).min(1.0);
            *last = z;
            let variance = (z * z).min(CLIP * CLIP) / CLIPPED_VARIANCE;
            *scale = (*scale * (1.0 - SCALE_GAIN + SCALE_GAIN * variance).sqrt()).max(self.floor);
            Change::forget(factor)
        });
        Adapted { innovation: update.innovation, factor, bounded: update.bounded }
    }

    fn recursion(&self) -> &RecursiveLeastSquares {
        &self.recursion
    }

    fn universes(&self) -> Option<(f64, f64)> {
        Some((ERROR_UNIVERSE * self.scale, VARIATION_UNIVERSE * self.scale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGMA: f64 = 1e-4;

    /// Nearly normal noise of standard deviation 1: the sum of twelve uniform numbers.
    fn noise(k: usize) -> f64 {
        let uniform = |i: usize| {
            let x = (i as f64 * 12.9898).sin() * 43758.5453;
            x - x.floor()
        };
        (0..12).map(|i| uniform(12 * k + i)).sum::<f64>() - 6.0
    }

    /// One coefficient, 0, known from many rows, with a residual of SIGMA.
    fn started(low: f64) -> Normalized {
        let mut data = Triangle::new(1);
        (0..1000).for_each(|_| data.add(&[1.0], 0.0));
        let mut normalized = Normalized::new(1, &Fuzzy::PAPER, low);
        normalized.start(&data, &[false], SIGMA);
        normalized
    }

    /// Mean of 1 - lambda over the last half of `count` samples of noise with the given sigma and mean.
    fn forgotten(normalized: &mut Normalized, count: usize, sigma: f64) -> f64 {
        let mut sum = 0.0;
        for k in 0..count {
            let factor = normalized.update(&[1.0], sigma * noise(k)).factor;
            assert!((normalized.low..=1.0).contains(&factor));
            sum += if 2 * k >= count { 1.0 - factor } else { 0.0 };
        }
        2.0 * sum / count as f64
    }

    #[test]
    fn white_noise_of_any_size_lowers_the_factor_equally() {
        for sigma in [SIGMA, 10.0 * SIGMA, 1e4 * SIGMA, 0.5 * SIGMA] {
            let mut normalized = started(0.9);
            let forgotten = forgotten(&mut normalized, 20_000, sigma);
            assert!((0.004..0.008).contains(&forgotten), "{sigma}: {forgotten}");
            let (error, change) = normalized.universes().unwrap();
            assert!((error / (8.0 * sigma) - 1.0).abs() < 0.15, "{sigma}: {error}");
            assert!((change / error - 2.0f64.sqrt()).abs() < 1e-12);
        }
    }

    #[test]
    fn the_smallest_factor_is_the_given_one() {
        for low in [0.5, 0.9, 0.99] {
            let mut normalized = started(low);
            assert_eq!(normalized.update(&[1.0], 0.0).factor, 1.0);
            // Error and change both far beyond PB.
            assert_eq!(normalized.update(&[1.0], 1.0).factor, low);
        }
    }

    #[test]
    fn an_outlier_hardly_moves_the_scale_and_rest_does_not_move_it_below_its_floor() {
        let mut normalized = started(0.9);
        let before = normalized.universes().unwrap().0;
        normalized.update(&[1.0], 1e300);
        assert!(normalized.universes().unwrap().0 < 1.01 * before);
        let mut resting = started(0.9);
        (0..10_000).for_each(|_| {
            resting.update(&[1.0], 0.0);
        });
        assert!((resting.universes().unwrap().0 / (0.25 * before) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn lasting_errors_become_the_scale() {
        let mut normalized = started(0.9);
        // Errors of twenty sigmas with random signs lower the factor at first, and later no more.
        let mut factors = (0..2000).map(|k| normalized.update(&[1.0], 20.0 * SIGMA * noise(k).signum()).factor);
        let early = factors.by_ref().take(20).sum::<f64>() / 20.0;
        let late = factors.skip(1000).sum::<f64>() / 980.0;
        assert!(early < 0.93 && late > 0.98, "{early} {late}");
    }
}
