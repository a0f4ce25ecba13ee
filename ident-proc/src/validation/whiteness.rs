//! Is a residual predictable from its own past?
//!
//! ```text
//! r(tau) = sum_k e(k) e(k + tau) / sum_k e(k)^2,   tau = 1 .. M,  mean of e removed
//! |r(tau)| < 1.96 / sqrt(N) for 95 %, 2.58 / sqrt(N) for 99 % of the lags of independent residuals
//! Q = N (N + 2) sum_tau r(tau)^2 / (N - tau)   ~   chi-square with M - p degrees of freedom
//! ```
//!
//! e residual, N samples, M lags. p is the number of coefficients of past outputs (na) that were fitted to these
//! samples, and 0 for samples that were not fitted: a fit makes the first lags smaller than chance would.
//!
//! Traps: choose M far above p and far below N, 20 to 40 for a servo. At N = 16 M the test still fails 16 of 1000 white
//! residuals instead of 10. Residuals over a gap in the record do not belong together. An output error model need not
//! have white residuals: the noise may be coloured although all dynamics were found. Then look at
//! [`super::cross_correlation`].
//!
//! Source: Ljung, System Identification, 2nd ed. 1999, section 16.6; Ljung and Box, Biometrika 65, 1978.

use super::chi_square;

/// Two-sided quantile of the normal distribution, 95 %.
pub const QUANTILE_95: f64 = 1.96;
/// Two-sided quantile of the normal distribution, 99 %.
pub const QUANTILE_99: f64 = 2.58;
/// Probability below which a test counts as failed.
pub const LEVEL: f64 = 0.01;

/// The autocorrelation of a residual, and its test.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Whiteness {
    /// r(1) .. r(M).
    pub correlations: Vec<f64>,
    /// Bound of 95 % of the lags.
    pub bound_95: f64,
    /// Bound of 99 % of the lags.
    pub bound_99: f64,
    /// Share of the lags outside of the 95 % bound; 0.05 is expected.
    pub outside_95: f64,
    /// Share of the lags outside of the 99 % bound; 0.01 is expected.
    pub outside_99: f64,
    /// Q of Ljung and Box.
    pub statistic: f64,
    /// The probability of such a Q or a larger one for independent residuals.
    pub p_value: f64,
    /// Whether the residuals count as independent: a p-value of at least 1 %.
    pub white: bool,
}

impl Whiteness {
    /// Of `residuals` over `lags` lags; `fitted` is p.
    ///
    /// `None` when the test cannot be made: with not more samples than lags, with not more lags than `fitted`, with a
    /// residual that is not finite, or with residuals that are all equal.
    pub fn new(residuals: &[f64], lags: usize, fitted: usize) -> Option<Self> {
        let n = residuals.len();
        if n <= lags + 1 || lags <= fitted {
            return None;
        }
        let e = centered(residuals);
        let correlations = autocorrelations(&e, lags)?;
        let samples = n as f64;
        let sum: f64 = correlations.iter().enumerate().map(|(i, r)| r * r / (n - i - 1) as f64).sum();
        let statistic = samples * (samples + 2.0) * sum;
        let p_value = chi_square::upper_tail(statistic, lags - fitted);
        let (bound_95, bound_99) = (QUANTILE_95 / samples.sqrt(), QUANTILE_99 / samples.sqrt());
        let outside = |bound: f64| correlations.iter().filter(|r| r.abs() > bound).count() as f64 / lags as f64;
        let (outside_95, outside_99) = (outside(bound_95), outside(bound_99));
        let white = p_value >= LEVEL;
        Some(Self { correlations, bound_95, bound_99, outside_95, outside_99, statistic, p_value, white })
    }
}

/// The values without their mean.
pub(super) fn centered(values: &[f64]) -> Vec<f64> {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    values.iter().map(|v| v - mean).collect()
}

/// sum_k x(k) y(k + tau).
pub(super) fn lagged_product(x: &[f64], y: &[f64], tau: usize) -> f64 {
    x.iter().zip(y.iter().skip(tau)).map(|(x, y)| x * y).sum()
}

/// r(1) .. r(lags) of values without mean; `None` when they are all zero or not finite.
pub(super) fn autocorrelations(values: &[f64], lags: usize) -> Option<Vec<f64>> {
    let square = lagged_product(values, values, 0);
    (square > 0.0 && square.is_finite())
        .then(|| (1..=lags).map(|tau| lagged_product(values, values, tau) / square).collect())
}

#[cfg(test)]
mod tests {
    use super::{super::noise::Noise, *};

    const LAGS: usize = 25;

    fn passed(trials: u64, record: impl Fn(&mut Noise) -> Vec<f64>) -> f64 {
        let white = |seed| Whiteness::new(&record(&mut Noise::new(seed)), LAGS, 0).unwrap().white;
        (0..trials).filter(|seed| white(*seed)).count() as f64 / trials as f64
    }

    #[test]
    fn white_noise_passes_99_times_in_100_and_a_coloured_residual_never() {
        let share = passed(500, |noise| noise.normals(400));
        assert!((0.97..=1.0).contains(&share), "{share}");
        let share = passed(100, |noise| {
            let mut last = 0.0;
            let mut next = || {
                last = 0.3 * last + noise.normal();
                last
            };
            (0..1000).map(|_| next()).collect()
        });
        assert_eq!(share, 0.0);
    }

    #[test]
    fn the_shares_outside_are_those_of_the_bounds_whatever_the_mean_and_the_unit() {
        let residuals: Vec<f64> = Noise::new(3).normals(50_000).iter().map(|e| 1e-6 * (e + 40.0)).collect();
        let found = Whiteness::new(&residuals, 2000, 0).unwrap();
        assert!((found.outside_95 - 0.05).abs() < 0.02, "{}", found.outside_95);
        assert!((found.outside_99 - 0.01).abs() < 0.008, "{}", found.outside_99);
    }

    #[test]
    fn a_residual_of_a_moving_average_shows_at_its_lag() {
        let noise = Noise::new(5).normals(20_000);
        let residuals: Vec<f64> = (3..noise.len()).map(|k| noise[k] + 0.5 * noise[k - 3]).collect();
        let found = Whiteness::new(&residuals, LAGS, 0).unwrap();
        for (i, r) in found.correlations.iter().enumerate() {
            // 0.5 / (1 + 0.5^2) at lag 3 and nothing elsewhere.
            let expected = if i + 1 == 3 { 0.4 } else { 0.0 };
            assert!((r - expected).abs() < 0.03, "lag {} {r}", i + 1);
        }
        assert!(!found.white && found.p_value < 1e-9);
    }

    #[test]
    fn residuals_of_the_samples_that_were_fitted_have_fewer_degrees_of_freedom() {
        // AR(2), fitted by least squares. Two degrees of freedom are a large part of six lags.
        let trials = 500;
        let (mut sum_all, mut sum_fewer) = (0.0, 0.0);
        for seed in 0..trials {
            let mut noise = Noise::new(seed);
            let mut y = vec![0.0, 0.0];
            (2..500).for_each(|k| y.push(1.2 * y[k - 1] - 0.5 * y[k - 2] + noise.normal()));
            let mut data = crate::least_squares::Triangle::new(2);
            (2..500).for_each(|k| data.add(&[y[k - 1], y[k - 2]], y[k]));
            let mut theta = [0.0; 2];
            data.solve(&mut theta);
            let residuals: Vec<f64> = (2..500).map(|k| y[k] - theta[0] * y[k - 1] - theta[1] * y[k - 2]).collect();
            sum_all += Whiteness::new(&residuals, 6, 0).unwrap().p_value;
            sum_fewer += Whiteness::new(&residuals, 6, 2).unwrap().p_value;
        }
        // p-values of a true hypothesis are uniform: mean 0.5, here +- 0.013.
        assert!((sum_fewer / trials as f64 - 0.5).abs() < 0.05, "{}", sum_fewer / trials as f64);
        assert!(sum_all / trials as f64 > 0.6, "{}", sum_all / trials as f64);
    }

    #[test]
    fn a_test_that_cannot_be_made_gives_none() {
        let noise = Noise::new(1).normals(30);
        assert!(Whiteness::new(&noise, 28, 0).is_some());
        assert!(Whiteness::new(&noise, 29, 0).is_none());
        assert!(Whiteness::new(&noise, 3, 3).is_none());
        assert!(Whiteness::new(&[], 0, 0).is_none());
        assert!(Whiteness::new(&[0.0; 100], 5, 0).is_none());
        let mut broken = noise;
        broken[7] = f64::NAN;
        assert!(Whiteness::new(&broken, 5, 0).is_none());
    }
}
