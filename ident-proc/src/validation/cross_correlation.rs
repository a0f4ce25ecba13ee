//! Does the input explain part of the residuals?
//!
//! ```text
//! r_eu(tau) = sum_k e(k) u(k - tau) / sqrt(sum e^2 sum u^2),   tau = -M .. M,  means removed
//! sqrt(N) R_eu(tau) ~ N(0, P),   P = sum_l R_e(l) R_u(l)
//! bound = 2.58 sqrt(P / (N R_e(0) R_u(0))) = 2.58 sqrt(sum_l r_e(l) r_u(l) / N)                    99 %
//! ```
//!
//! e residual, u command or any function of it, above all x = N(u), N samples, M lags, R covariances, r correlations.
//! The sum for P runs over |l| <= 2 M with the weights 1 - |l|/(2 M + 1). With these it cannot become negative, and a
//! slow u does not turn it into noise.
//!
//! | outside of the bound | meaning |
//! |---|---|
//! | tau >= nk | the model misses dynamics; with a single lag beyond nk + nb, the delay of the model is too small |
//! | 1 <= tau < nk | the delay of the model is too large |
//! | tau <= 0 | the command depends on the output, the record was taken in closed loop: no defect of the model |
//!
//! tau = 0 belongs to the feedback: u(k) is given after y(k) is known, and the newest command that y(k) depends
//! on is u(k-1).
//!
//! Traps: at the lags of the model, residuals of the samples that were fitted are nearly orthogonal to the input
//! whatever the truth is. Judge by the other lags, or by samples that were not fitted. Among M lags some are outside by
//! chance; [`Half::p_value`] takes that into account.
//!
//! Source: Ljung, System Identification, 2nd ed. 1999, section 16.6.

use super::{
    chi_square,
    whiteness::{QUANTILE_99, autocorrelations, centered, lagged_product},
};

/// The cross-correlation of a residual with the input, and its test.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct CrossCorrelation {
    /// r_eu(-M) .. r_eu(M).
    pub correlations: Vec<f64>,
    /// Bound of 99 % of the lags.
    pub bound_99: f64,
    /// tau = 1 .. M: dynamics that are missing in the model.
    pub model: Half,
    /// tau = -M .. 0: feedback in the record.
    pub feedback: Half,
}

/// The lags on one side.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Half {
    /// Share of the lags outside of the bound; 0.01 is expected.
    pub outside: f64,
    /// The lag with the largest correlation.
    pub worst_lag: isize,
    /// The correlation there.
    pub worst: f64,
    /// Upper bound of the probability that chance alone gives as large a correlation at any of these lags.
    pub p_value: f64,
}

impl CrossCorrelation {
    /// Of `residuals` with `inputs`, sample by sample, over `lags` lags to both sides.
    ///
    /// `None` when the test cannot be made: without a lag, with not more samples than lags, with a value that is not
    /// finite, or with residuals or inputs that are all equal.
    ///
    /// # Panics
    ///
    /// When there are not as many residuals as inputs.
    pub fn new(residuals: &[f64], inputs: &[f64], lags: usize) -> Option<Self> {
        assert_eq!(residuals.len(), inputs.len(), "there must be one residual for each input");
        let n = residuals.len();
        if lags == 0 || n <= lags + 1 {
            return None;
        }
        let (e, u) = (centered(residuals), centered(inputs));
        let window = (2 * lags).min(n - 1);
        let (r_e, r_u) = (autocorrelations(&e, window)?, autocorrelations(&u, window)?);
        let weight = |i: usize| 1.0 - (i + 1) as f64 / (window + 1) as f64;
        let sum: f64 = r_e.iter().zip(&r_u).enumerate().map(|(i, (e, u))| weight(i) * e * u).sum();
        let sigma = ((1.0 + 2.0 * sum).max(f64::MIN_POSITIVE) / n as f64).sqrt();

        let size = (lagged_product(&e, &e, 0) * lagged_product(&u, &u, 0)).sqrt();
        let before = (1..=lags).rev().map(|tau| lagged_product(&e, &u, tau));
        let after = (0..=lags).map(|tau| lagged_product(&u, &e, tau));
        let correlations: Vec<f64> = before.chain(after).map(|product| product / size).collect();
        let (feedback, model) = correlations.split_at(lags + 1);
        let (feedback, model) = (Half::new(feedback, -(lags as isize), sigma), Half::new(model, 1, sigma));
        Some(Self { correlations, bound_99: QUANTILE_99 * sigma, model, feedback })
    }
}

impl Half {
    /// From the correlations at the lags from `first` on, each with the standard deviation `sigma`.
    fn new(correlations: &[f64], first: isize, sigma: f64) -> Self {
        let lags = correlations.len() as f64;
        let outside = correlations.iter().filter(|r| r.abs() > QUANTILE_99 * sigma).count() as f64 / lags;
        let (worst_lag, worst) = (first..)
            .zip(correlations.iter().copied())
            .fold((first, 0.0f64), |worst, next| if next.1.abs() > worst.1.abs() { next } else { worst });
        // Bonferroni: at most the sum of the probabilities of the single lags.
        let p_value = (lags * chi_square::upper_tail((worst / sigma).powi(2), 1)).min(1.0);
        Self { outside, worst_lag, worst, p_value }
    }
}

#[cfg(test)]
mod tests {
    use super::{
        super::{noise::Noise, whiteness::LEVEL},
        *,
    };
    use crate::least_squares::Triangle;

    const LAGS: usize = 25;

    /// y(k) = 0.7 y(k-1) + 0.5 u(k-delay) + e(k) with u(k) = r(k) - gain y(k), fitted with the delay `assumed`.
    fn residuals(seed: u64, gain: f64, delay: usize, assumed: usize) -> (Vec<f64>, Vec<f64>) {
        let n = 3000;
        let mut noise = Noise::new(seed);
        let (mut y, mut u) = (vec![0.0; n], vec![0.0; n]);
        let first = delay.max(assumed);
        for k in first..n {
            y[k] = 0.7 * y[k - 1] + 0.5 * u[k - delay] + 0.3 * noise.normal();
            u[k] = noise.normal() - gain * y[k];
        }
        let mut data = Triangle::new(2);
        (first..n).for_each(|k| data.add(&[y[k - 1], u[k - assumed]], y[k]));
        let mut theta = [0.0; 2];
        data.solve(&mut theta);
        let e = (first..n).map(|k| y[k] - theta[0] * y[k - 1] - theta[1] * u[k - assumed]).collect();
        (e, u[first..].to_vec())
    }

    #[test]
    fn the_residuals_of_a_right_model_are_not_correlated_with_the_input() {
        for seed in 0..20 {
            let (e, u) = residuals(seed, 0.0, 1, 1);
            let found = CrossCorrelation::new(&e, &u, LAGS).unwrap();
            assert!(found.model.p_value > 1e-3 && found.feedback.p_value > 1e-3, "{seed} {found:?}");
            assert!(found.correlations[LAGS + 1].abs() < 0.1 * found.bound_99, "the fit is orthogonal to u(k-1)");
        }
    }

    #[test]
    fn a_delay_too_small_or_too_large_shows_at_the_true_one() {
        for (delay, assumed) in [(4, 1), (4, 2), (1, 3), (2, 3)] {
            let (e, u) = residuals(1, 0.0, delay, assumed);
            let found = CrossCorrelation::new(&e, &u, LAGS).unwrap();
            assert_eq!(found.model.worst_lag, delay as isize);
            assert!(found.model.worst > 5.0 * found.bound_99 && found.model.p_value < 1e-9);
            assert!(found.model.outside >= 1.0 / LAGS as f64);
            assert!(found.feedback.p_value > LEVEL, "{found:?}");
        }
    }

    #[test]
    fn a_closed_loop_shows_at_lags_up_to_zero_only() {
        let (e, u) = residuals(2, 0.8, 1, 1);
        let found = CrossCorrelation::new(&e, &u, LAGS).unwrap();
        assert!(found.feedback.p_value < 1e-9 && found.feedback.worst_lag <= 0 && found.feedback.worst < 0.0);
        assert!(found.model.p_value > LEVEL, "{found:?}");
        // It shows at lags below zero too.
        assert!(found.correlations[LAGS - 1].abs() > found.bound_99);
    }

    /// The spread of r_eu over independent records of two slow signals agrees with the bound.
    #[test]
    fn the_bound_is_right_for_coloured_residuals_and_inputs() {
        let coloured = |noise: &mut Noise, pole: f64| {
            let mut last = 0.0;
            let mut next = || {
                last = pole * last + noise.normal();
                last
            };
            (0..1200).map(|_| next()).collect::<Vec<_>>()
        };
        for poles in [(0.0, 0.95), (0.8, 0.8), (-0.5, 0.8)] {
            let (mut outside, trials) = (0.0, 300);
            for seed in 0..trials {
                let mut noise = Noise::new(seed);
                let (e, u) = (coloured(&mut noise, poles.0), coloured(&mut noise, poles.1));
                let found = CrossCorrelation::new(&e, &u, LAGS).unwrap();
                outside += (found.model.outside + found.feedback.outside) / 2.0 / trials as f64;
            }
            assert!((0.004..0.025).contains(&outside), "{poles:?} {outside}");
        }
    }

    #[test]
    fn a_test_that_cannot_be_made_gives_none() {
        let noise = Noise::new(4).normals(30);
        assert!(CrossCorrelation::new(&noise, &noise, 28).is_some());
        assert!(CrossCorrelation::new(&noise, &noise, 29).is_none());
        assert!(CrossCorrelation::new(&noise, &noise, 0).is_none());
        assert!(CrossCorrelation::new(&noise, &[0.0; 30], 5).is_none());
        assert!(CrossCorrelation::new(&[f64::NAN; 30], &noise, 5).is_none());
    }
}
