//! Friction of the piston, after Stribeck.
//!
//! ```text
//! F(v) = (F_c + (F_s - F_c) exp(-(v/v_s)^2)) tanh(v/v_e) + B_p v
//! ```
//!
//! F N, v m/s, F_c Coulomb and F_s static friction N, v_s Stribeck speed m/s, B_p N s/m as in equation (9).
//!
//! The trap: the sign function at v = 0 cannot be integrated at a fixed step; tanh takes its place. At rest there is
//! thus no sticking: under a constant excess force below F_s the piston creeps, at up to v_e. In a closed cylinder the
//! oil holds the load, not friction, so only leakage makes it drift.

/// v_e, m/s: a tenth of an ordinary Stribeck speed, so that the Stribeck hump keeps its height.
pub const REGULARISATION_SPEED: f64 = 1e-3;

/// (v/v_s)^2 beyond which the exponential is below half a bit of 1, so that its evaluation can be spared.
const EXPONENT_LIMIT: f64 = 40.0;

/// Friction of one axis.
#[derive(Debug, Clone, Copy)]
pub struct Friction {
    /// F_c, N.
    pub coulomb: f64,
    /// F_s, N.
    pub static_friction: f64,
    /// v_s, m/s.
    pub stribeck_speed: f64,
    /// B_p, N s/m.
    pub viscous: f64,
}

impl Friction {
    /// Force against the motion at `velocity` m/s, N, with the velocity's sign.
    #[inline]
    pub fn force(&self, velocity: f64) -> f64 {
        let ratio = velocity / self.stribeck_speed;
        let exponent = ratio * ratio;
        let hump =
            if exponent < EXPONENT_LIMIT { (self.static_friction - self.coulomb) * (-exponent).exp() } else { 0.0 };
        (self.coulomb + hump) * (velocity / REGULARISATION_SPEED).tanh() + self.viscous * velocity
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOOM: Friction = Friction { coulomb: 4e3, static_friction: 7e3, stribeck_speed: 0.01, viscous: 20e3 };

    #[test]
    fn fast_motion_meets_coulomb_and_viscous_friction_only() {
        assert!((BOOM.force(0.5) - (4e3 + 0.5 * 20e3)).abs() < 1e-9);
    }

    #[test]
    fn slow_motion_meets_static_friction() {
        let peak = (1..100).map(|i| BOOM.force(1e-4 * f64::from(i))).fold(0.0, f64::max);
        assert!(peak > 0.95 * 7e3 && peak < 7.1e3, "{peak}");
    }

    #[test]
    fn friction_opposes_the_motion_and_is_zero_at_rest() {
        assert_eq!(BOOM.force(0.0), 0.0);
        for v in [1e-6, 1e-3, 0.02, 1.0] {
            assert_eq!(BOOM.force(-v), -BOOM.force(v));
            assert!(BOOM.force(v) > 0.0);
        }
    }
}
