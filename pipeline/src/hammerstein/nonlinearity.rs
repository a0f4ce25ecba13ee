//! The static nonlinearity N(u): one polynomial without constant term for each sign of u, eq. (11).

use super::MAX_ORDER;

/// N(u), piecewise polynomial through zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nonlinearity {
    /// Order r of both polynomials.
    pub order: usize,
    /// f_1 .. f_r, for u >= 0.
    pub f: [f64; MAX_ORDER],
    /// g_1 .. g_r, for u < 0.
    pub g: [f64; MAX_ORDER],
}

impl Nonlinearity {
    /// x = N(u).
    pub fn evaluate(&self, u: f64) -> f64 {
        let branch = if u >= 0.0 { &self.f } else { &self.g };
        // Horner's rule from the highest power; the polynomial has no constant term.
        branch[..self.order].iter().rev().fold(0.0, |sum, c| (sum + c) * u)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sign_has_its_own_polynomial() {
        let n = Nonlinearity { order: 3, f: [1.0, 0.5, -0.25, 9.0, 9.0], g: [2.0, 0.0, 4.0, 9.0, 9.0] };
        assert_eq!(n.evaluate(0.0), 0.0);
        assert!((n.evaluate(0.4) - (0.4 + 0.5 * 0.16 - 0.25 * 0.064)).abs() < 1e-16);
        assert!((n.evaluate(-0.4) - (-0.8 - 4.0 * 0.064)).abs() < 1e-16);
    }
}
