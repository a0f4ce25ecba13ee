//! From a command to the features of N: a calibrated dead band is subtracted, then the functions of a basis are taken.
//!
//! ```text
//! v = u - high  for u > high,    u + low  for u < -low,    else 0
//! powers:   phi_i(v) = v^i                                                                        (11)
//! hinges:   phi_i(v) = sign(v) max(0, |v| - knot_i)
//! ```
//!
//! u valve command, v the part of it that opens the valve, both without unit; low and high magnitudes, `dead_band`. A
//! weighted sum of hinges is a straight line from knot to knot. It bends only at the knots and goes on straight beyond
//! the data (linear splines; Hastie, Tibshirani and Friedman, The Elements of Statistical Learning, chapter 5).
//!
//! Trap: a dead band that is calibrated wider than the valve's hides commands that move the axis. A dead band that is a
//! little too narrow only costs one more bend.

use super::MAX_ORDER;

/// The dead band and the basis in front of the coefficients of N.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputMap {
    /// Dead band: largest magnitudes below and above zero that do not open the valve, both at least 0.
    pub dead_band: (f64, f64),
    /// Functions that the coefficients of N multiply.
    pub basis: Basis,
}

/// The functions that the coefficients of N multiply, r of them for each sign of the command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Basis {
    /// v, v^2 .. v^r, as in the paper.
    Powers,
    /// Hinges at these knots: the first r knots count and rise from at least 0, the others are zero.
    Hinges([f64; MAX_ORDER]),
}

impl Basis {
    /// Hinges at 1 to [`MAX_ORDER`] finite and rising `knots` of at least 0, or `None` for others.
    pub fn hinges(knots: &[f64]) -> Option<Self> {
        let rise = knots.windows(2).all(|pair| pair[0] < pair[1]);
        let finite = knots.iter().all(|knot| knot.is_finite() && *knot >= 0.0);
        if !rise || !finite || !(1..=MAX_ORDER).contains(&knots.len()) {
            return None;
        }
        let mut all = [0.0; MAX_ORDER];
        all[..knots.len()].copy_from_slice(knots);
        Some(Self::Hinges(all))
    }
}

impl InputMap {
    /// No dead band, and powers, as in the paper.
    pub const PAPER: Self = Self { dead_band: (0.0, 0.0), basis: Basis::Powers };

    /// v, the part of the command `u` that opens the valve.
    pub fn opening(&self, u: f64) -> f64 {
        let (low, high) = self.dead_band;
        if u > high {
            u - high
        } else if u < -low {
            u + low
        } else {
            // Zero; NaN stays NaN.
            0.0 * u
        }
    }

    /// Writes the 2 r features of the command `u`: those of the positive branch, then those of the negative one.
    pub fn features(&self, u: f64, features: &mut [f64]) {
        features.fill(0.0);
        let v = self.opening(u);
        let (positive, negative) = features.split_at_mut(features.len() / 2);
        let branch = if v >= 0.0 { positive } else { negative };
        match &self.basis {
            Basis::Powers => {
                branch.iter_mut().fold(1.0, |power, feature| {
                    *feature = power * v;
                    *feature
                });
            }
            Basis::Hinges(knots) => {
                for (feature, knot) in branch.iter_mut().zip(knots) {
                    *feature = v.signum() * (v.abs() - knot).max(0.0);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dead_band_is_taken_off_the_command() {
        let input = InputMap { dead_band: (0.1, 0.2), ..InputMap::PAPER };
        for (u, v) in [(0.2, 0.0), (0.5, 0.3), (1.0, 0.8), (0.0, 0.0), (-0.1, 0.0), (-0.5, -0.4), (0.15, 0.0)] {
            assert!((input.opening(u) - v).abs() < 1e-16, "{u}");
        }
        assert!(input.opening(f64::NAN).is_nan());
        assert_eq!(InputMap::PAPER.opening(-0.3), -0.3);
    }

    #[test]
    fn features_are_those_of_the_sign_of_the_command() {
        let mut features = [9.0; 6];
        InputMap::PAPER.features(-0.5, &mut features);
        assert_eq!(features, [0.0, 0.0, 0.0, -0.5, 0.25, -0.125]);
        let hinges = InputMap { dead_band: (0.0, 0.25), basis: Basis::hinges(&[0.0, 0.25, 0.5]).unwrap() };
        hinges.features(0.75, &mut features);
        assert_eq!(features, [0.5, 0.25, 0.0, 0.0, 0.0, 0.0]);
        hinges.features(-0.75, &mut features);
        assert_eq!(features, [0.0, 0.0, 0.0, -0.75, -0.5, -0.25]);
    }

    #[test]
    fn knots_that_do_not_rise_from_zero_are_none() {
        let six = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5];
        assert!(Basis::hinges(&six[..MAX_ORDER]).is_some());
        for knots in [&six[..], &[], &[0.1, 0.1], &[0.2, 0.1], &[-0.1], &[f64::NAN], &[0.1, f64::INFINITY]] {
            assert_eq!(Basis::hinges(knots), None, "{knots:?}");
        }
    }
}
