//! Soft end stops: how far a command may go towards a soft limit.
//!
//! ```text
//! d    = way to the limit that the command moves the axis to
//! v_s  = sqrt((a t_r)^2 + 2 a d) - a t_r                from which it stops in d: d = v_s t_r + v_s^2 / (2 a)
//! u    = 0 for v > 2 v_s + 10 mm/s, and for d <= 0      every command
//! |u| <= c^-1(v_s), or d_0 + (u_max - d_0) v_s / v_max  all commands except those of a commissioning
//! ```
//!
//! d in m, v speed towards the limit m/s, a `stop_deceleration` m/s2, t_r `stop_reaction` s
//! ([`pipeline::machine::MotionLimits`]), c static curve of a commissioned axis, d_0 calibrated dead band, u_max
//! `command_limit`, v_max `max_speed`. Close to the limit v_s is d / t_r: the axis approaches as slowly as the valve
//! can still follow. Away from a limit every command is allowed.
//!
//! A commissioning program has a window of its own and has to know what it commands. So its commands are cut only where
//! they could not stop the axis any more. It finds the axis anew. So its a is at most 0.5 m/s2 and its t_r at least
//! 0.3 s, whatever an earlier model or the machine file says.
//!
//! Trap: what is under way in valve and pilot lines comes out whatever is commanded now. A rule without t_r lets the
//! axis overrun its limit.

use pipeline::machine::{Axis, Commissioned, Control, MotionLimits};

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
    /// a, m/s2, and t_r, s.
    stop: (f64, f64),
}

impl EndStops {
    /// The end stops at the soft limits of `axis`; `period` in s.
    pub fn new(axis: &Axis, period: f64) -> Self {
        let MotionLimits { stop_deceleration, stop_reaction, .. } = axis.motion_limits(period);
        Self {
            limits: axis.soft_limits,
            control: axis.control,
            max_speed: axis.max_speed,
            commissioned: axis.commissioned.clone(),
            stop: (stop_deceleration, stop_reaction),
        }
    }

    /// The allowed part of the command `wanted` at this position (m) and speed (m/s). `gently`: the command also
    /// becomes smaller towards the limit, not only neutral.
    pub fn apply(&self, wanted: f64, position: f64, speed: f64, gently: bool) -> f64 {
        if wanted == 0.0 {
            return 0.0;
        }
        let sign = wanted.signum();
        let (deceleration, reaction) = self.stop;
        let careful =
            (deceleration.min(MotionLimits::UNKNOWN_DECELERATION), reaction.max(MotionLimits::UNKNOWN_REACTION));
        let stopping = self.stopping(if gently { self.stop } else { careful }, sign, position);
        if stopping <= 0.0 {
            return 0.0;
        }
        if speed * sign > TOO_FAST_FACTOR * stopping + TOO_FAST_MARGIN {
            return 0.0;
        }
        if gently { sign * wanted.abs().min(self.command(sign, stopping)) } else { wanted }
    }

    /// v_s, m/s: the speed in the direction `sign` from which the axis stops before the limit. It is 0 at the limit and
    /// beyond it, and for a position that is not a number.
    pub fn stopping_speed(&self, sign: f64, position: f64) -> f64 {
        self.stopping(self.stop, sign, position)
    }

    fn stopping(&self, (deceleration, reaction): (f64, f64), sign: f64, position: f64) -> f64 {
        let way = if sign > 0.0 { self.limits.1 - position } else { position - self.limits.0 };
        let head = deceleration * reaction;
        (head * head + 2.0 * deceleration * way.max(0.0)).sqrt() - head
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
    use crate::{
        tests::{machine, models::commissioned},
        tuning::{PLANTS, Plant},
    };
    use pipeline::machine::LimitSettings;
    use proptest::prelude::*;
    use std::collections::VecDeque;

    fn stops(model: bool) -> EndStops {
        let mut axis = machine(1).axes[0].clone();
        axis.commissioned = model.then(commissioned);
        EndStops::new(&axis, 0.01)
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
            prop_assert!(v * stops.stop.1 + v * v / (2.0 * stops.stop.0) <= way * 1.000_001, "{v}");
        }
    }

    /// An axis that is commanded at full speed towards its upper limit from 0.6 m away.
    #[derive(Debug, Clone, Copy)]
    struct Approach {
        /// Dead time and lag as commissioned, s.
        delay: (f64, f64),
        /// Largest speed as commissioned, m/s.
        speed: f64,
        /// Of the controller, s.
        period: f64,
        /// How the real axis differs.
        plant: Plant,
        gently: bool,
    }

    impl Approach {
        /// How far it passes the limit, m, and when it comes within 1 mm of it, s. With these limits of its motion.
        fn run(&self, settings: LimitSettings) -> (f64, f64) {
            let Self { delay: (dead_time, time_constant), speed, period, plant, gently } = *self;
            let speeds = || vec![0.1 * speed, speed];
            let model = Commissioned {
                dead_time,
                time_constant,
                speeds_extend: speeds(),
                speeds_retract: speeds(),
                ..commissioned()
            };
            let mut axis = machine(1).axes[0].clone();
            (axis.control.limits, axis.commissioned) = (settings, Some(model.clone()));
            let stops = EndStops::new(&axis, period);
            let step = 0.1 * period;
            let decay = (-step / (plant.lag * time_constant)).exp();
            let underway = (plant.dead_time * dead_time / step).round() as usize;
            let mut underway: VecDeque<f64> = std::iter::repeat_n(0.0, underway).collect();
            let (mut position, mut spool) = (0.684, 0.0);
            let mut positions = VecDeque::from(vec![position; (0.04 / period) as usize]);
            let (mut furthest, mut arrival) = (position, f64::INFINITY);
            for tick in 0..(60.0 / period) as usize {
                positions.push_back(position);
                let before = positions.pop_front().unwrap();
                let measured = (position - before) / (positions.len() as f64 * period);
                let command = stops.apply(1.0, position, measured, gently);
                for _ in 0..10 {
                    underway.push_back(command);
                    let acting = underway.pop_front().unwrap();
                    spool = acting + (spool - acting) * decay;
                    position += plant.gain * model.speed(spool) * step;
                }
                furthest = f64::max(furthest, position);
                if position > 1.283 {
                    arrival = arrival.min(tick as f64 * period);
                }
            }
            (furthest - 1.284, arrival)
        }
    }

    /// The limits of every axis before they followed from the commissioned model.
    fn constants((dead_time, lag): (f64, f64)) -> LimitSettings {
        let stop_reaction = Some(f64::max(0.3, 3.0 * (dead_time + lag)));
        LimitSettings { stop_deceleration: Some(0.5), stop_reaction, ..LimitSettings::default() }
    }

    #[test]
    fn slow_and_fast_axes_pass_their_limit_by_no_more_than_with_the_limits_of_an_unknown_axis() {
        for (delay, speed, period) in [
            ((0.15, 0.13), 0.25, 0.01),
            ((0.6, 0.3), 0.25, 0.01),
            ((0.05, 0.045), 0.6, 0.01),
            ((0.01, 0.037), 0.5, 0.01),
            ((0.005, 0.02), 1.0, 0.01),
            ((0.002, 0.005), 1.0, 0.001),
            ((0.0, 0.003), 2.0, 0.001),
            ((0.01, 1.0), 0.1, 0.02),
        ] {
            for (plant, gently) in PLANTS.into_iter().flat_map(|plant| [(plant, true), (plant, false)]) {
                let approach = Approach { delay, speed, period, plant, gently };
                let (before, _) = approach.run(constants(delay));
                let (now, arrival) = approach.run(LimitSettings::default());
                // A tenth of a count is not seen.
                assert!(now <= before.max(0.0) + 1e-5, "{approach:?}: {now} m, was {before} m");
                assert!(arrival < 60.0, "{approach:?}");
            }
        }
    }

    #[test]
    fn a_servo_comes_to_its_limit_sooner_than_an_unknown_axis_and_as_it_is_told() {
        let plant = PLANTS[1];
        let servo = Approach { delay: (0.002, 0.005), speed: 1.0, period: 0.001, plant, gently: true };
        let ((_, unknown), (_, known)) = (servo.run(constants(servo.delay)), servo.run(LimitSettings::default()));
        assert!(known < 0.6 * unknown, "{known} s, {unknown} s");
        let settings =
            LimitSettings { stop_deceleration: Some(10.0), stop_reaction: Some(0.03), ..LimitSettings::default() };
        let (overrun, told) = servo.run(settings);
        assert!(told < 0.7 * known && overrun < 1e-5, "{told} s, {known} s, {overrun} m");
    }
}
