//! The fallback: PI with dead-band compensation.
//!
//! ```text
//! e(k) = y_r(k) - y(k)          v(k) = kp e(k) + I(k)          I(k+1) = I(k) + ki T e(k)
//! u(k) = v + d(v) min(|v| / w, 1)           d(v) = +d_extend for v > 0, -d_retract for v < 0
//! ```
//!
//! e error in m, kp in 1/m, ki in 1/(m s), T period in s, d calibrated dead band, w [`BLEND_WIDTH`]. It needs no
//! model: it controls while the identifier learns, and takes over whenever the model may not be used. Source: the
//! usual loop of mobile hydraulics.
//!
//! Traps: a jump over the whole dead band at v = 0 chatters with every count of noise, so it is blended in over
//! |v| < w. The calibrated dead band must not exceed the valve's: too much of it is a relay, and a relay cycles. The
//! integral stops while the limits cut the command off and the error would only push further.

use pipeline::machine::Control;

use crate::limits::Limits;

/// Magnitude of v (command) below which the dead band is compensated in part only. With a kp of 4 1/m this is an
/// error of 2.5 mm, some tens of encoder counts and so well above the noise.
pub const BLEND_WIDTH: f64 = 0.01;

/// The fallback controller of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Fallback {
    kp: f64,
    /// ki T, 1/m.
    ki_period: f64,
    extend: f64,
    retract: f64,
    limits: Limits,
    integral: f64,
}

impl Fallback {
    /// Gains and dead band from the machine file; `period` in s.
    pub fn new(control: &Control, period: f64) -> Self {
        Self {
            kp: control.kp,
            ki_period: control.ki * period,
            extend: control.dead_band.extend,
            retract: control.dead_band.retract,
            limits: Limits::new(control, period),
            integral: 0.0,
        }
    }

    /// Forgets the integral: the axis stands.
    pub fn reset(&mut self) {
        self.integral = 0.0;
    }

    /// Takes over from another controller that sent `last`, at an error of `error` m: the next command for the same
    /// error is `last` again, as long as the integral that this takes is one the fallback could have by itself.
    pub fn resume(&mut self, last: f64, error: f64) {
        self.integral = self.bounded(self.uncompensated(last) - self.kp * error);
    }

    /// The command for an error of `error` m after the command `last`, within the limits.
    pub fn update(&mut self, error: f64, last: f64) -> f64 {
        let wanted = self.compensated(self.kp * error + self.integral);
        let command = self.limits.apply(wanted, last);
        if (wanted - command) * error <= 0.0 {
            self.integral = self.bounded(self.integral + self.ki_period * error);
        }
        command
    }

    /// u(v).
    fn compensated(&self, v: f64) -> f64 {
        v + self.dead_band(v) * (v.abs() / BLEND_WIDTH).min(1.0)
    }

    /// v(u), its inverse.
    fn uncompensated(&self, u: f64) -> f64 {
        let dead_band = self.dead_band(u);
        if u.abs() < BLEND_WIDTH + dead_band.abs() {
            u * BLEND_WIDTH / (BLEND_WIDTH + dead_band.abs())
        } else {
            u - dead_band
        }
    }

    fn dead_band(&self, direction: f64) -> f64 {
        if direction >= 0.0 { self.extend } else { -self.retract }
    }

    /// More integral than a full command takes would only have to be unwound.
    fn bounded(&self, integral: f64) -> f64 {
        let (low, high) = self.limits.range();
        integral.max(self.uncompensated(low)).min(self.uncompensated(high))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fallback() -> Fallback {
        Fallback::new(&crate::tests::machine(1).axes[0].control, 0.01)
    }

    #[test]
    fn the_command_is_proportional_and_integral_beyond_the_dead_band() {
        let mut fallback = fallback();
        // kp 4, ki 1, dead band 0.08 and 0.07, no rate limit met: last is near.
        assert!((fallback.update(0.05, 0.28) - (0.2 + 0.08)).abs() < 1e-12);
        assert!((fallback.update(0.05, 0.28) - (0.2 + 0.0005 + 0.08)).abs() < 1e-12);
        fallback.reset();
        assert!((fallback.update(-0.05, -0.27) - (-0.2 - 0.07)).abs() < 1e-12);
        fallback.reset();
        // Inside the blend: v = 0.004 takes 0.4 of the dead band.
        assert!((fallback.update(0.001, 0.0) - (0.004 + 0.4 * 0.08)).abs() < 1e-12);
    }

    #[test]
    fn the_integral_does_not_wind_up() {
        let mut fallback = fallback();
        let mut last = 0.0;
        for _ in 0..10_000 {
            last = fallback.update(10.0, last);
        }
        assert_eq!(last, 1.0);
        assert!(fallback.integral.abs() < 1e-12, "{}", fallback.integral);
    }

    proptest! {
        #[test]
        fn taking_over_is_without_a_bump(last in -1.0f64..1.0, error in -0.02f64..0.02) {
            let mut fallback = fallback();
            fallback.resume(last, error);
            let within = (fallback.uncompensated(last) - 4.0 * error).abs() < 0.9;
            prop_assert!(!within || (fallback.update(error, last) - last).abs() < 1e-12);
        }

        #[test]
        fn compensation_is_inverted(u in -1.0f64..1.0) {
            let fallback = fallback();
            prop_assert!((fallback.compensated(fallback.uncompensated(u)) - u).abs() < 1e-12);
        }
    }
}
