//! Is a larger model worth its coefficients?
//!
//! ```text
//! AIC   = N ln(V) + 2 K                                        V = residual / N,  K = d + 1
//! AICc  = AIC + 2 K (K + 1) / (N - K - 1)
//! BIC   = N ln(V) + K ln(N)
//! FPE   = V (1 + d/N) / (1 - d/N)
//! fit   = 100 (1 - sqrt(V / variance of y))
//! ```
//!
//! residual: sum of squares of the one-step residuals of the samples that were fitted; N their number; d number of
//! coefficients that were fitted to them. The variance of the noise is fitted too, hence K. Of models for one set of
//! samples, the one with the least value is to be preferred. V and FPE are in the unit of the output squared, fit in %.
//!
//! Traps: all models have to count the same N samples, so the model with the longest memory decides where counting
//! begins. With ln(V) only differences between models have a meaning. The one-step fit of a position is near 100 % for
//! any model. For a separated model d is na + nb + 2 r, one less than its number of coefficients, because f_1 = 1 is
//! not fitted.
//!
//! Source: Akaike, IEEE Transactions on Automatic Control 19, 1974 (AIC), and Annals of the Institute of Statistical
//! Mathematics 21, 1969 (FPE); Hurvich and Tsai, Biometrika 76, 1989 (AICc); Schwarz, Annals of Statistics 6, 1978
//! (BIC). Discussion: Ljung, System Identification, 2nd ed. 1999, section 16.4.

/// Akaike's information criterion.
pub fn aic(residual: f64, samples: u64, coefficients: usize) -> f64 {
    let n = samples as f64;
    n * (residual / n).ln() + 2.0 * (coefficients as f64 + 1.0)
}

/// Akaike's information criterion corrected for few samples; infinite for so few that the correction does not exist.
pub fn aicc(residual: f64, samples: u64, coefficients: usize) -> f64 {
    let k = coefficients as f64 + 1.0;
    let left = samples as f64 - k - 1.0;
    if left > 0.0 { aic(residual, samples, coefficients) + 2.0 * k * (k + 1.0) / left } else { f64::INFINITY }
}

/// The Bayesian information criterion of Schwarz. From 8 samples on it weighs coefficients more than [`aic`] does.
pub fn bic(residual: f64, samples: u64, coefficients: usize) -> f64 {
    let n = samples as f64;
    n * (residual / n).ln() + (coefficients as f64 + 1.0) * n.ln()
}

/// Akaike's final prediction error: the variance to expect on samples that were not fitted; infinite when there are not
/// more samples than coefficients.
pub fn fpe(residual: f64, samples: u64, coefficients: usize) -> f64 {
    let (n, d) = (samples as f64, coefficients as f64);
    if n > d { residual / n * (n + d) / (n - d) } else { f64::INFINITY }
}

/// The normalised fit in %: 100 for no error, 0 for an error as large as that of the mean. `output_variance` is the
/// mean square of y without its mean.
pub fn fit_percent(residual: f64, samples: u64, output_variance: f64) -> f64 {
    100.0 * (1.0 - (residual / samples as f64 / output_variance).sqrt())
}

#[cfg(test)]
mod tests {
    use super::{super::noise::Noise, *};
    use crate::least_squares::Triangle;

    #[test]
    fn they_are_the_printed_formulas() {
        // V = 0.25, N = 40, d = 4.
        let close = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        let likelihood = 40.0 * 0.25f64.ln();
        close(aic(10.0, 40, 4), likelihood + 10.0);
        close(aicc(10.0, 40, 4), likelihood + 10.0 + 60.0 / 34.0);
        close(bic(10.0, 40, 4), likelihood + 5.0 * 40.0f64.ln());
        close(fpe(10.0, 40, 4), 0.25 * 44.0 / 36.0);
        close(fit_percent(10.0, 40, 1.0), 50.0);
        assert_eq!(fpe(0.0, 4, 4), f64::INFINITY);
        assert_eq!(aicc(0.0, 6, 4), f64::INFINITY);
    }

    /// Autoregressions of order 1 to 8 of a record of order 3.
    #[test]
    fn the_true_order_is_found_and_fpe_is_the_error_on_fresh_samples() {
        let (n, trials) = (400, 100);
        let (mut by_bic, mut by_aic, mut seen, mut promised, mut fresh) = (0, 0, 0.0, 0.0, 0.0);
        for seed in 0..trials {
            let mut noise = Noise::new(seed);
            let mut y = vec![0.0; 8];
            (8..2 * n).for_each(|k| y.push(1.4 * y[k - 1] - 0.9 * y[k - 2] + 0.3 * y[k - 3] + noise.normal()));
            let row = |k: usize, order: usize| (1..=order).map(|i| y[k - i]).collect::<Vec<_>>();
            let fitted: Vec<Triangle> = (1..=8)
                .map(|order| {
                    let mut data = Triangle::new(order);
                    (8..n).for_each(|k| data.add(&row(k, order), y[k]));
                    data
                })
                .collect();
            let best = |criterion: fn(f64, u64, usize) -> f64| {
                let value = |data: &Triangle| criterion(data.residual(), data.count(), data.len());
                fitted.iter().min_by(|a, b| value(a).total_cmp(&value(b))).unwrap().len()
            };
            by_bic += usize::from(best(bic) == 3);
            by_aic += usize::from(best(aic) >= 3 && best(aicc) >= 3);
            let (data, mut theta) = (&fitted[7], [0.0; 8]);
            data.solve(&mut theta);
            let error = |k| y[k] - row(k, 8).iter().zip(&theta).map(|(p, t)| p * t).sum::<f64>();
            seen += data.residual() / data.count() as f64;
            promised += fpe(data.residual(), data.count(), 8);
            fresh += (n..2 * n).map(|k| error(k).powi(2)).sum::<f64>() / n as f64;
        }
        assert!(by_bic > 90 && by_aic > 95, "{by_bic} {by_aic}");
        assert!((promised / fresh - 1.0).abs() < 0.02 && seen / fresh < 0.98, "{seen} {promised} {fresh}");
    }
}
