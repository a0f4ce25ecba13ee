//! The static nonlinearity N(u): for each sign of u a weighted sum of the functions of a basis, eq. (11).
//!
//! ```text
//! x = f_1 phi_1(v) + ... + f_r phi_r(v)   for v >= 0,   g_1 phi_1(v) + ... + g_r phi_r(v)   for v < 0
//! ```
//!
//! v and phi_i by [`InputMap`]; with its default phi_i is the i-th power of u, the polynomial without constant term
//! of the paper. Trap: outside the commands that f and g were identified from, a polynomial is not to be trusted.

use super::{Basis, InputMap, MAX_ORDER};

/// N(u), piecewise through zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nonlinearity {
    /// Number r of coefficients of each branch.
    pub order: usize,
    /// f_1 .. f_r, for u >= 0.
    pub f: [f64; MAX_ORDER],
    /// g_1 .. g_r, for u < 0.
    pub g: [f64; MAX_ORDER],
    /// The dead band and the basis.
    pub input: InputMap,
}

impl Nonlinearity {
    /// x = N(u).
    pub fn evaluate(&self, u: f64) -> f64 {
        let v = self.input.opening(u);
        let branch = if v >= 0.0 { &self.f[..self.order] } else { &self.g[..self.order] };
        match &self.input.basis {
            // Horner's rule from the highest power; the polynomial has no constant term.
            Basis::Powers => branch.iter().rev().fold(0.0, |sum, c| (sum + c) * v),
            Basis::Hinges(knots) => {
                let magnitude = v.abs();
                v.signum() * branch.iter().zip(knots).map(|(c, knot)| c * (magnitude - knot).max(0.0)).sum::<f64>()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn each_sign_has_its_own_polynomial() {
        let n = Nonlinearity {
            order: 3,
            f: [1.0, 0.5, -0.25, 9.0, 9.0],
            g: [2.0, 0.0, 4.0, 9.0, 9.0],
            input: InputMap::PAPER,
        };
        assert_eq!(n.evaluate(0.0), 0.0);
        assert!((n.evaluate(0.4) - (0.4 + 0.5 * 0.16 - 0.25 * 0.064)).abs() < 1e-16);
        assert!((n.evaluate(-0.4) - (-0.8 - 4.0 * 0.064)).abs() < 1e-16);
    }

    #[test]
    fn hinges_are_straight_lines_from_knot_to_knot() {
        let n = Nonlinearity {
            order: 2,
            f: [1.0, 2.0, 9.0, 9.0, 9.0],
            g: [0.5, -0.25, 9.0, 9.0, 9.0],
            input: InputMap { dead_band: (0.1, 0.2), basis: Basis::hinges(&[0.0, 0.3]).unwrap() },
        };
        for (u, x) in [(0.2, 0.0), (0.4, 0.2), (0.5, 0.3), (0.7, 0.9), (-0.1, 0.0), (-0.3, -0.1), (-0.8, -0.25)] {
            assert!((n.evaluate(u) - x).abs() < 1e-15, "{u} {}", n.evaluate(u));
        }
        assert!(n.evaluate(f64::NAN).is_nan());
    }

    proptest! {
        /// The products that the estimator multiplies with f and g are those that N sums up.
        #[test]
        fn it_is_the_sum_over_the_features(
            f in prop::array::uniform5(-2.0f64..2.0),
            g in prop::array::uniform5(-2.0f64..2.0),
            low in 0.0f64..0.9, high in 0.0f64..0.9,
            steps in prop::option::of(prop::collection::vec(0.01f64..0.3, 5)),
            u in -1.5f64..1.5,
        ) {
            let knots = steps.map(|steps| {
                let knots: Vec<f64> = steps.iter().scan(-0.01, |sum, step| { *sum += step; Some(*sum) }).collect();
                Basis::hinges(&knots).unwrap()
            });
            let input = InputMap { dead_band: (low, high), basis: knots.unwrap_or(Basis::Powers) };
            let n = Nonlinearity { order: 5, f, g, input };
            let mut features = [0.0; 10];
            input.features(u, &mut features);
            let sum: f64 = features.iter().zip(f.iter().chain(&g)).map(|(feature, c)| feature * c).sum();
            prop_assert!((sum - n.evaluate(u)).abs() < 1e-12);
        }
    }
}
