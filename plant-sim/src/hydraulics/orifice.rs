//! Flow through one control edge.
//!
//! ```text
//! q = k X f(dp)        f(dp) = dp / (dp^2 + p_tr^2)^(1/4)        k = q_rated / sqrt(dp_rated)
//! ```
//!
//! q flow, m3/s; X opening in [0, 1]; dp pressure drop across the edge, Pa; p_tr transition pressure, Pa. Far above
//! p_tr this is equation (3), k X sqrt(dp), with k in place of C_d omega sqrt(2/rho). Far below p_tr the flow is
//! laminar and proportional to dp. The law is odd in dp: the flow changes its direction with the pressure drop.
//!
//! Trap: the slope of the square root is infinite at dp = 0, and so is the stiffness of a small chamber behind it. p_tr
//! makes the slope finite, k X / sqrt(p_tr). A smaller p_tr needs a smaller step ([`crate::plant::stiffness`]).

use crate::lanes::Lanes;

/// p_tr, Pa: 0.2 bar. It lies below any pressure drop that matters, and is the least value with which the step of 100
/// us integrates a cylinder with half a litre of dead volume.
pub const TRANSITION_PRESSURE: f64 = 2e4;

/// k = q_rated / sqrt(dp_rated), m3/(s Pa^(1/2)), of an edge with `rated_flow` m3/s at `rated_pressure_drop` Pa.
pub fn conductance(rated_flow: f64, rated_pressure_drop: f64) -> f64 {
    rated_flow / rated_pressure_drop.sqrt()
}

/// f: square root of `pressure_drop` with its sign, smooth at zero, Pa^(1/2).
#[inline]
pub fn smooth_root(pressure_drop: Lanes) -> Lanes {
    let transition = Lanes::splat(TRANSITION_PRESSURE * TRANSITION_PRESSURE);
    pressure_drop / (pressure_drop * pressure_drop + transition).sqrt().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn root(pressure_drop: f64) -> f64 {
        smooth_root(Lanes::splat(pressure_drop)).to_array()[0]
    }

    #[test]
    fn the_rated_flow_passes_at_the_rated_pressure_drop() {
        let k = conductance(3.33e-3, 1.4e6);
        assert!((k * root(1.4e6) / 3.33e-3 - 1.0).abs() < 1e-4);
        assert!((k * root(4.0 * 1.4e6) / (2.0 * 3.33e-3) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn the_flow_law_is_odd_with_a_finite_slope_at_zero() {
        assert_eq!(root(0.0), 0.0);
        for dp in [1.0, 1e3, 2e4, 1e6, 3e7] {
            assert_eq!(root(-dp), -root(dp));
        }
        assert!((root(1.0) * TRANSITION_PRESSURE.sqrt() - 1.0).abs() < 1e-6);
    }
}
