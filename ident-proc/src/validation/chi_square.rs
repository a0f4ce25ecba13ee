//! The upper tail of the chi-square distribution.
//!
//! ```text
//! p = Q(n/2, x/2),   Q(a, x) = 1/Gamma(a) integral from x to infinity of t^(a-1) exp(-t) dt = 1 - P(a, x)
//! P(a, x) = x^a exp(-x) / Gamma(a + 1) [1 + x/(a+1) + x^2/((a+1)(a+2)) + ..]                x < a + 1
//! Q(a, x) = x^a exp(-x) / Gamma(a) / (x+1-a - 1(1-a)/(x+3-a - 2(2-a)/(x+5-a - ..)))         else
//! ```
//!
//! n degrees of freedom, x statistic, p probability that chance alone gives x or more. Trap: neither of the two
//! expansions is enough. Far from its own side of a + 1 each loses all digits or does not converge in time.
//!
//! Source: Abramowitz and Stegun, Handbook of Mathematical Functions, 1964, 6.1.41, 6.5.29 and 6.5.31; the continued
//! fraction is evaluated by Lentz' method (Press and others, Numerical Recipes).

/// Largest number of terms of a series; near x = a about 6 times the root of a are needed.
const MAX_TERMS: usize = 100_000;

/// The probability that a chi-square variable with `freedom` degrees of freedom is at least `x`.
///
/// NaN for an `x` that is NaN. A variable without a degree of freedom is 0.
pub fn upper_tail(x: f64, freedom: usize) -> f64 {
    if x.is_nan() {
        return f64::NAN;
    }
    if x <= 0.0 {
        return 1.0;
    }
    if freedom == 0 || x.is_infinite() {
        return 0.0;
    }
    let (a, x) = (0.5 * freedom as f64, 0.5 * x);
    let front = (a * x.ln() - x - ln_gamma(a)).exp();
    let tail = if x < a + 1.0 { 1.0 - front / a * series(a, x) } else { front * continued_fraction(a, x) };
    tail.clamp(0.0, 1.0)
}

fn series(a: f64, x: f64) -> f64 {
    let (mut term, mut sum) = (1.0, 1.0);
    for n in 1..MAX_TERMS {
        term *= x / (a + n as f64);
        sum += term;
        if term < f64::EPSILON * sum {
            break;
        }
    }
    sum
}

fn continued_fraction(a: f64, x: f64) -> f64 {
    let mut b = x + 1.0 - a;
    let mut c = f64::INFINITY;
    let mut d = 1.0 / b;
    let mut value = d;
    for n in 1..MAX_TERMS {
        let n = n as f64;
        let numerator = n * (a - n);
        b += 2.0;
        d = 1.0 / nonzero(b + numerator * d);
        c = nonzero(b + numerator / c);
        value *= c * d;
        if (c * d - 1.0).abs() < f64::EPSILON {
            break;
        }
    }
    value
}

fn nonzero(value: f64) -> f64 {
    if value.abs() < f64::MIN_POSITIVE { f64::MIN_POSITIVE } else { value }
}

/// ln Gamma(z) for z > 0: Stirling's series from 10 on, and Gamma(z) = Gamma(z + 1) / z below.
fn ln_gamma(z: f64) -> f64 {
    let (mut z, mut product) = (z, 1.0);
    while z < 10.0 {
        product *= z;
        z += 1.0;
    }
    let w = 1.0 / (z * z);
    let series = (1.0 / 12.0 - w * (1.0 / 360.0 - w * (1.0 / 1260.0 - w * (1.0 / 1680.0 - w / 1188.0)))) / z;
    (z - 0.5) * z.ln() - z + 0.5 * (2.0 * std::f64::consts::PI).ln() + series - f64::ln(product)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_printed_table() {
        let table = [
            (1, 3.841459, 0.05),
            (1, 6.634897, 0.01),
            (2, 9.210340, 0.01),
            (5, 11.07050, 0.05),
            (5, 15.08627, 0.01),
            (10, 18.30704, 0.05),
            (10, 3.940299, 0.95),
            (20, 37.56623, 0.01),
            (25, 37.65248, 0.05),
            (30, 29.33603, 0.5),
            (100, 135.8067, 0.01),
            (100, 77.92947, 0.95),
        ];
        for (freedom, x, p) in table {
            assert!((upper_tail(x, freedom) / p - 1.0).abs() < 1e-5, "{freedom} {x}: {}", upper_tail(x, freedom));
        }
    }

    #[test]
    fn even_degrees_have_a_closed_form() {
        for x in [1e-3, 0.5, 3.0, 5.9, 6.1, 20.0, 100.0, 900.0] {
            let h: f64 = 0.5 * x;
            for (freedom, polynomial) in [(2, 1.0), (4, 1.0 + h), (6, 1.0 + h + h * h / 2.0)] {
                let exact = (-h).exp() * polynomial;
                assert!((upper_tail(x, freedom) / exact - 1.0).abs() < 1e-11, "{freedom} {x}");
            }
        }
    }

    #[test]
    fn many_degrees_are_nearly_normal_and_the_ends_are_exact() {
        // Wilson and Hilferty: the median is n (1 - 2/(9n))^3.
        let n = 20_000.0f64;
        assert!((upper_tail(n * (1.0 - 2.0 / (9.0 * n)).powi(3), 20_000) - 0.5).abs() < 1e-5);
        assert_eq!(upper_tail(0.0, 3), 1.0);
        assert_eq!(upper_tail(f64::INFINITY, 3), 0.0);
        assert_eq!(upper_tail(1e6, 3), 0.0);
        assert!(upper_tail(f64::NAN, 3).is_nan());
    }

    #[test]
    fn the_gamma_function_is_the_factorial() {
        for (z, gamma) in [(0.5, std::f64::consts::PI.sqrt()), (1.0, 1.0), (5.0, 24.0), (11.0, 3_628_800.0)] {
            assert!((ln_gamma(z) - f64::ln(gamma)).abs() < 1e-13, "{z}");
        }
    }
}
