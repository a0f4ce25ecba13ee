//! Soft end stops: how far a command by hand may go towards a soft limit.
//!
//! ```text
//! d    = way to the limit that the command moves the axis to
//! v_s  = sqrt((a t_r)^2 + 2 a d) - a t_r                from which it stops in d: d = v_s t_r + v_s^2 / (2 a)
//! u    = 0 for v > 2 v_s + 10 mm/s, and for d <= 0      also where a person does not command it
//! |u| <= c^-1(v_s), or d_0 + (u_max - d_0) v_s / v_max  manual only
//! ```
//!
//! d in m, v speed towards the limit m/s, a 0.5 m/s2, t_r three times dead time and lag, 0.3 s where nothing is known of
//! them, c static curve of a commissioned axis, d_0 calibrated dead band, u_max `command_limit`, v_max `max_speed`. Close
//! to the limit v_s is d / t_r: the axis nears it as slowly as the valve can still follow. Away from a limit all is
//! allowed.
//!
//! A commissioning program has a window of its own and has to know what it commands, so its commands are cut only where
//! they would not stop.
//!
//! Trap: what is under way in valve and pilot lines comes out whatever is commanded now; a rule without t_r overruns.

use pipeline::machine::{Axis, Commissioned, Control};

/// Deceleration that is counted on, m/s2.
const DECELERATION: f64 = 0.5;
/// Reactions, dead time and lag, in t_r: with fewer the nearing of the limit would overshoot.
const REACTIONS: f64 = 3.0;
/// Least t_r, and that of an axis of which nothing is known, s.
const REACTION_TIME: f64 = 0.3;
/// How much faster than v_s the axis may be before the command is neutral: a factor, and m/s for the encoder's steps.
const FASTER: (f64, f64) = (2.0, 0.01);

/// The soft end stops of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct EndStops {
    limits: (f64, f64),
    control: Control,
    max_speed: f64,
    commissioned: Option<Commissioned>,
    reaction: f64,
}

impl EndStops {
    /// By the axis' soft limits.
    pub fn new(axis: &Axis) -> Self {
        let found = axis.commissioned.as_ref().map_or(0.0, |model| REACTIONS * (model.dead_time + model.time_constant));
        Self {
            limits: axis.soft_limits,
            control: axis.control,
            max_speed: axis.max_speed,
            commissioned: axis.commissioned.clone(),
            reaction: REACTION_TIME.max(found),
        }
    }

    /// What is allowed of `wanted` at this position (m) and speed (m/s); `gently` for a person's command.
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
        if speed * sign > FASTER.0 * stopping + FASTER.1 {
            return 0.0;
        }
        if gently { sign * wanted.abs().min(self.command(sign, stopping)) } else { wanted }
    }

    /// The magnitude of a command that makes at most this speed, m/s.
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
    fn far_from_the_limits_and_away_from_them_nothing_is_cut() {
        for stops in [stops(false), stops(true)] {
            assert_eq!(stops.apply(0.3, 0.6, 0.0, true), 0.3);
            assert_eq!(stops.apply(-0.3, 1.284, 0.3, true), -0.3);
            assert_eq!(stops.apply(0.3, 0.0, -0.5, true), 0.3);
            assert_eq!(stops.apply(0.0, 0.6, 0.0, true), 0.0);
        }
    }

    #[test]
    fn at_a_limit_and_beyond_and_where_it_would_not_stop_the_command_is_neutral() {
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
        fn a_commissioned_axis_gets_no_more_than_stops(way in 1e-4f64..1.0, extends: bool) {
            let stops = stops(true);
            let position = if extends { 1.284 - way } else { 0.05 + way };
            let command = stops.apply(if extends { 1.0 } else { -1.0 }, position, 0.0, true);
            let v = commissioned().speed(command).abs();
            prop_assert!(v * stops.reaction + v * v / (2.0 * DECELERATION) <= way * 1.000_001, "{v}");
        }
    }
}
