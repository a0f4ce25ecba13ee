//! Soft end stops: how far a command may go towards a soft limit.
//!
//! ```text
//! d    = way to the limit that the command moves the axis to
//! v_s  = sqrt((a t_r)^2 + 2 a d) - a t_r                from which it stops in d: d = v_s t_r + v_s^2 / (2 a)
//! u    = 0 for v > 2 v_s + 10 mm/s, and for d <= 0      every command
//! |u| <= c^-1(v_s), or d_0 + (u_max - d_0) v_s / v_max  all commands except those of a commissioning
//! ```
//!
//! d in m, v speed towards the limit m/s, a 0.5 m/s2, t_r three times dead time and lag, but at least 0.3 s, c static
//! curve of a commissioned axis, d_0 calibrated dead band, u_max `command_limit`, v_max `max_speed`. Close to the limit
//! v_s is d / t_r: the axis approaches as slowly as the valve can still follow. Away from a limit every command is
//! allowed.
//!
//! A commissioning program has a window of its own and has to know what it commands. So its commands are cut only where
//! they could not stop the axis any more.
//!
//! Trap: what is under way in valve and pilot lines comes out whatever is commanded now. A rule without t_r lets the
//! axis overrun its limit.

use pipeline::machine::{Axis, Commissioned, Control};

/// Deceleration that the axis can rely on, m/s2.
const DECELERATION: f64 = 0.5;
/// t_r as multiple of dead time and lag: with less the approach to the limit would overshoot.
const REACTIONS: f64 = 3.0;
/// Least t_r, which is also that of an axis that is not commissioned, s.
const REACTION_TIME: f64 = 0.3;
/// Factor of v_s from which on the command is neutral.
const TOO_FAST_FACTOR: f64 = 2.0;
/// Addition to that speed for the steps of the encoder, m/s.
const TOO_FAST_MARGIN: f64 = 0.01;

/// The soft end stops of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct EndStops {
    /// Soft limits, m.
    limits: (f64, f64),
    control: Control,
    max_speed: f64,
    commissioned: Option<Commissioned>,
    /// t_r, s.
    reaction: f64,
}

impl EndStops {
    /// The end stops at the soft limits of `axis`.
    pub fn new(axis: &Axis) -> Self {
        let found = axis.commissioned.as_ref().map_or(0.0, |model| REACTIONS * model.reaction());
        Self {
            limits: axis.soft_limits,
            control: axis.control,
            max_speed: axis.max_speed,
            commissioned: axis.commissioned.clone(),
            reaction: REACTION_TIME.max(found),
        }
    }

    /// The allowed part of the command `wanted` at this position (m) and speed (m/s). `gently`: the command also
    /// becomes smaller towards the limit, not only neutral.
    pub fn apply(&self, wanted: f64, position: f64, speed: f64, gently: bool) -> f64 {
        if wanted == 0.0 {
            return 0.0;
        }
        let sign = wanted.signum();
        let way = if sign > 0.0 { self.limits.1 - position } else { position - self.limits.0 };
        if way.is_nan() || way <= 0.0 {
            return 0.0;
        }
        let head = DECELERATION * self.reaction;
        let stopping = (head * head + 2.0 * DECELERATION * way).sqrt() - head;
        if speed * sign > TOO_FAST_FACTOR * stopping + TOO_FAST_MARGIN {
            return 0.0;
        }
        if gently { sign * wanted.abs().min(self.command(sign, stopping)) } else { wanted }
    }

    /// The magnitude of a command that makes at most this speed (m/s).
    fn command(&self, sign: f64, speed: f64) -> f64 {
        if let Some(model) = &self.commissioned {
            return model.command(sign * speed).abs();
        }
        let Control { dead_band, command_limit, .. } = self.control;
        let closed = if sign > 0.0 { dead_band.extend } else { dead_band.retract };
        closed + (command_limit - closed).max(0.0) * speed / self.max_speed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{machine, models::commissioned};
    use proptest::prelude::*;

    fn stops(model: bool) -> EndStops {
        let mut axis = machine(1).axes[0].clone();
        axis.commissioned = model.then(commissioned);
        EndStops::new(&axis)
    }

    #[test]
    fn a_command_far_from_the_limits_or_away_from_them_is_not_cut() {
        for stops in [stops(false), stops(true)] {
            assert_eq!(stops.apply(0.3, 0.6, 0.0, true), 0.3);
            assert_eq!(stops.apply(-0.3, 1.284, 0.3, true), -0.3);
            assert_eq!(stops.apply(0.3, 0.0, -0.5, true), 0.3);
            assert_eq!(stops.apply(0.0, 0.6, 0.0, true), 0.0);
        }
    }

    #[test]
    fn the_command_is_neutral_at_a_limit_and_where_the_axis_could_not_stop() {
        for gently in [true, false] {
            let stops = stops(false);
            assert_eq!(stops.apply(0.3, 1.284, 0.0, gently), 0.0);
            assert_eq!(stops.apply(-0.3, 0.01, 0.0, gently), 0.0);
            assert_eq!(stops.apply(0.3, f64::NAN, 0.0, gently), 0.0);
            // 20 mm away v_s is 57 mm/s.
            assert_eq!(stops.apply(0.3, 1.264, 0.13, gently), 0.0);
            assert!(stops.apply(0.3, 1.264, 0.11, gently) > 0.0);
        }
    }

    proptest! {
        #[test]
        fn a_commissioned_axis_gets_no_more_than_it_can_stop_from(way in 1e-4f64..1.0, extends: bool) {
            let stops = stops(true);
            let position = if extends { 1.284 - way } else { 0.05 + way };
            let command = stops.apply(if extends { 1.0 } else { -1.0 }, position, 0.0, true);
            let v = commissioned().speed(command).abs();
            prop_assert!(v * stops.reaction + v * v / (2.0 * DECELERATION) <= way * 1.000_001, "{v}");
        }
    }
}
