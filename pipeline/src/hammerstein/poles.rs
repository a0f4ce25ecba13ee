//! Where the poles of 1/A lie, without computing them.

use super::{Coefficients, MAX_A};

/// Whether every root of z^n + a_1 z^(n-1) + .. + a_n, n up to [`MAX_A`], lies strictly inside the circle of this
/// radius.
///
/// Schur-Cohn step-down recursion on A(z) with its roots divided by the radius: the last coefficient of each
/// reduced polynomial must be smaller than 1 in magnitude. With a coefficient that is not finite the result is false.
pub fn poles_within(a: &[f64], radius: f64) -> bool {
    let mut reduced = [0.0; MAX_A];
    let mut scale = 1.0;
    for (scaled, coefficient) in reduced.iter_mut().zip(a) {
        scale *= radius;
        *scaled = coefficient / scale;
    }
    for last in (0..a.len()).rev() {
        let k = reduced[last];
        if k.abs() >= 1.0 || k.is_nan() {
            return false;
        }
        let before = reduced;
        for i in 0..last {
            reduced[i] = (before[i] - k * before[last - 1 - i]) / (1.0 - k * k);
        }
    }
    true
}

impl Coefficients {
    /// Whether every pole lies strictly inside the circle of this radius.
    pub fn poles_within(&self, radius: f64) -> bool {
        poles_within(self.a(), radius)
    }

    /// Largest magnitude of a pole, to a relative 1e-9; infinite when a coefficient is not finite.
    pub fn pole_radius(&self) -> f64 {
        if !self.a().iter().all(|a| a.is_finite()) {
            return f64::INFINITY;
        }
        // No root is larger than Cauchy's bound.
        let mut high = 1.0 + self.a().iter().fold(0.0f64, |largest, a| largest.max(a.abs()));
        let mut low = 0.0;
        while high - low > 1e-9 * high {
            let middle = 0.5 * (low + high);
            if self.poles_within(middle) {
                high = middle;
            } else {
                low = middle;
            }
            if high < 1e-9 {
                return 0.0;
            }
        }
        high
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn table_2_has_its_slowest_pole_at_0_963() {
        assert!((Coefficients::TABLE_2.pole_radius() - 0.9633).abs() < 1e-4);
    }

    #[test]
    fn nan_is_never_stable() {
        let mut model = Coefficients::TABLE_2;
        model.a[1] = f64::NAN;
        assert!(!model.poles_within(1e9));
        assert_eq!(model.pole_radius(), f64::INFINITY);
    }

    proptest! {
        /// A built from known roots: one real, two complex pairs.
        #[test]
        fn radius_of_known_roots(
            real in -1.5f64..1.5,
            r1 in 0.05f64..1.5,
            r2 in 0.05f64..1.5,
            t1 in 0.1f64..3.0,
            t2 in 0.1f64..3.0,
        ) {
            let pair = |r: f64, t: f64| vec![1.0, -2.0 * r * t.cos(), r * r];
            let mut a = vec![1.0];
            for factor in [vec![1.0, -real], pair(r1, t1), pair(r2, t2)] {
                let mut product = vec![0.0; a.len() + factor.len() - 1];
                for (i, x) in a.iter().enumerate() {
                    for (j, y) in factor.iter().enumerate() {
                        product[i + j] += x * y;
                    }
                }
                a = product;
            }
            let mut model = Coefficients { na: 5, ..Coefficients::TABLE_2 };
            model.a[..5].copy_from_slice(&a[1..]);
            let largest = real.abs().max(r1).max(r2);
            prop_assert!((model.pole_radius() / largest - 1.0).abs() < 1e-5, "{} {largest}", model.pole_radius());
            // An integrator adds a pole at 1.
            let (integrated, largest) = (model.integrated(), largest.max(1.0));
            prop_assert_eq!(integrated.a().len(), 6);
            let radius = integrated.pole_radius();
            prop_assert!((radius / largest - 1.0).abs() < 1e-3, "{radius} {largest}");
        }
    }
}
