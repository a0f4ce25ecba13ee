//! A forgetting factor that keeps the information about constant, of Fortescue, Kershenbaum and Ydstie.
//!
//! ```text
//! K = P phi / (1 + phi' P phi)             theta <- theta + K e
//! lambda = 1 - (1 - phi' K) e^2 / Sigma0   clipped to [lambda_min, 1]
//! P <- (I - K phi') P / lambda             Sigma0 = sigma0^2 N0
//! ```
//!
//! e innovation in the unit of the target; sigma0 standard deviation of the residuals of offline identification; N0
//! memory in samples while the errors stay as large as those residuals, because E e^2 = sigma0^2 gives 1 - lambda =
//! 1 / N0. Errors twice as large make the memory a quarter as long. An error that the uncertainty of the coefficients
//! explains (phi' K near 1) forgets little; such a row changes the coefficients much in any case.
//!
//! lambda_min is 1 - 1 / (2 n): a memory of at least two rows for each of the n coefficients. Without it one outlier
//! makes lambda negative.
//!
//! Traps: sigma0 is all that the method knows of the noise. A model that fits the training much better than later
//! samples forgets at every sample. The factor also falls where the structure of the model is wrong.
//!
//! Source: Fortescue, Kershenbaum, Ydstie: Implementation of self-tuning regulators with variable forgetting factors,
//! Automatica 17, 1981.

use super::{Adapted, Method};
use crate::{
    least_squares::Triangle,
    recursive::{Change, RecursiveLeastSquares},
};

/// The estimator `fortescue:N0`.
#[derive(Debug, Clone)]
pub struct Fortescue {
    recursion: RecursiveLeastSquares,
    /// N0.
    memory: f64,
    /// Sigma0, (unit of the target)^2.
    information: f64,
    least: f64,
}

impl Fortescue {
    /// For `n` coefficients with a memory of `memory` samples.
    pub fn new(n: usize, memory: usize) -> Self {
        Self {
            recursion: RecursiveLeastSquares::new(n),
            memory: memory as f64,
            information: f64::MIN_POSITIVE,
            least: 1.0 - 0.5 / n.max(1) as f64,
        }
    }

    /// lambda_min.
    pub fn least(&self) -> f64 {
        self.least
    }
}

impl Method for Fortescue {
    fn start(&mut self, data: &Triangle, held: &[bool], residual_sigma: f64) {
        self.recursion.start(data, held);
        // With a residual of zero (data without noise) a zero error forgets nothing, and every other error the most.
        self.information = (residual_sigma * residual_sigma * self.memory).max(f64::MIN_POSITIVE);
    }

    fn set_theta(&mut self, theta: &[f64]) {
        self.recursion.set_theta(theta);
    }

    fn update(&mut self, phi: &[f64], target: f64) -> Adapted {
        let (information, least) = (self.information, self.least);
        let mut factor = 1.0;
        let update = self.recursion.update_by(phi, target, |e, leverage| {
            factor = (1.0 - e * e / ((1.0 + leverage) * information)).clamp(least, 1.0);
            Change { variance: 1.0, growth: factor.recip(), step: 1.0 }
        });
        Adapted { innovation: update.innovation, factor, bounded: update.bounded }
    }

    fn recursion(&self) -> &RecursiveLeastSquares {
        &self.recursion
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two coefficients, 1 and 2, known from ten rows each, with a residual of 0.1 and a memory of 50.
    fn started() -> Fortescue {
        let mut data = Triangle::new(2);
        (0..10).for_each(|_| {
            data.add(&[1.0, 0.0], 1.0);
            data.add(&[0.0, 1.0], 2.0);
        });
        let mut fortescue = Fortescue::new(2, 50);
        fortescue.start(&data, &[false; 2], 0.1);
        fortescue
    }

    #[test]
    fn the_factor_is_one_without_error_falls_with_it_and_is_clipped() {
        let factor = |error: f64| started().update(&[1.0, 1.0], 3.0 + error).factor;
        assert_eq!(factor(0.0), 1.0);
        // phi' P phi = 0.2, Sigma0 = 0.5.
        for error in [0.01, 0.1, -0.2, 0.3] {
            let expected = 1.0 - error * error / (1.2 * 0.5);
            assert!((factor(error) - expected).abs() < 1e-12, "{error}");
        }
        for error in [0.5, -10.0, 1e100, 1e200] {
            assert_eq!(factor(error), 0.75, "{error}");
        }
    }

    #[test]
    fn the_memory_is_as_long_as_set_while_the_errors_are_as_large_as_in_the_training() {
        let mut fortescue = started();
        let mut forgotten = 0.0;
        for k in 0..20_000 {
            // Errors of +-0.1, the two rows by turns.
            let error = if k % 3 == 0 { -0.1 } else { 0.1 };
            let theta = fortescue.recursion().theta();
            let (row, predicted) = if k % 2 == 0 { ([1.0, 0.0], theta[0]) } else { ([0.0, 1.0], theta[1]) };
            forgotten += 1.0 - fortescue.update(&row, predicted + error).factor;
        }
        let memory = 20_000.0 / forgotten;
        assert!((50.0..53.0).contains(&memory), "{memory}");
    }

    #[test]
    fn data_without_noise_give_a_factor_that_is_a_number() {
        let mut fortescue = started();
        let mut data = Triangle::new(2);
        data.add(&[1.0, 0.0], 1.0);
        data.add(&[0.0, 1.0], 2.0);
        fortescue.start(&data, &[false; 2], 0.0);
        assert_eq!(fortescue.update(&[1.0, 0.0], 1.0).factor, 1.0);
        assert_eq!(fortescue.update(&[1.0, 0.0], 1.5).factor, 0.75);
    }
}
