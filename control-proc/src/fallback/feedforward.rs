//! Velocity feed-forward of the fallback: the command of a coming motion, by the commissioned model.
//!
//! ```text
//! L   = t_d + tau + T/2
//! v_r = (y_r(t + L + T/2) - y_r(t + L - T/2)) / T          straight lines between the references of the ticks
//! u_r = b + (c^-1((v_r + v_F) / g) - b) min(|v_r| / v_s, 1)
//! ```
//!
//! y_r reference in m, t now, T period in s, t_d dead time and tau time constant in s, c static curve of
//! [`Commissioned`], g what the load makes of its speeds and v_F what the forces of the motion take of them ([`Load`]),
//! which neither turns a motion round nor more than doubles it, v_r coming speed in m/s, v_s [`STILL`], u_r command. b
//! is the part of the dead band that is compensated ([`Commissioned::compensated_dead_band`]), in the direction of the
//! motion that begins in the 2 tau_s after t + L, or in the 2 tau_p where these are longer, and 0 where none does;
//! tau_s is tau without the delay of a load that swings, tau_p the time constant of the pump. A command that is sent
//! now acts in the middle of its period and moves the axis after dead time and lag; hence the lead L. Source: the usual
//! loop of mobile hydraulics, with references that are known ahead.
//!
//! Traps: without the lead, feed-forward is late by the dead time, and the feedback corrects an error that is none. The
//! references of a channel end with the preview of its message: beyond it the axis is assumed to stand. And a spool
//! that has to cross its dead band when a motion begins is late by two or three of its time constants, and so is a pump
//! that stands by and sees the load only through an open valve; hence b. Sooner it must not be there: where the dead
//! band has become smaller than b, the axis creeps as long.

use pipeline::machine::Commissioned;

use crate::{load::Load, margins::mean_slope};

/// Speed below which a motion is left to the feedback more and more, m/s: at v_r = 0 the command would jump over the
/// whole dead band.
pub const STILL: f64 = 1e-3;

/// What the references ask for after dead time and lag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coming {
    /// y_r(t + t_d + tau), m.
    pub position: f64,
    /// v_r, m/s.
    pub speed: f64,
    /// u_r.
    pub command: f64,
}

/// Time before the begin of a motion at which the spool is brought to its edge, in tau_s and in tau_p: a pump has built
/// up 0.86 of its pressure then.
const BEFORE: f64 = 2.0;
/// Longest time for which it waits there for the pump, s.
const LONGEST_STANDBY: f64 = 0.3;
/// Parts of the speed of a motion that its forces may take off the command, and add to it: references that jump ask for
/// forces without a bound.
const MOST_OPPOSED: f64 = 0.9;
const MOST_ADDED: f64 = 1.0;

/// Range of commands on either side over which a slope is taken, in parts of the largest opening.
const AROUND: f64 = 0.25;

/// The feed-forward of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Feedforward {
    model: Commissioned,
    /// b before an axis extends and before it retracts.
    edges: [f64; 2],
    /// Mean slope of the curve, m/s.
    mean_slope: f64,
    period: f64,
    /// L - T/2 in ticks.
    lead: f64,
    /// Ticks before the begin of a motion at which the spool is brought to its edge.
    before: usize,
}

impl Feedforward {
    /// Feed-forward by `model` for an axis whose pump follows with the time constant `pump_response` s, for a command
    /// every `period` s.
    pub fn new(model: &Commissioned, pump_response: f64, period: f64) -> Self {
        let edge = model.compensated_dead_band();
        let spool = (model.time_constant - model.swing_delay()).max(0.0);
        Self {
            model: model.clone(),
            edges: [edge.extend, -edge.retract],
            mean_slope: mean_slope(model),
            period,
            lead: model.reaction() / period,
            before: ((BEFORE * spool).max((BEFORE * pump_response).min(LONGEST_STANDBY)) / period).ceil() as usize,
        }
    }

    /// Slope of the speed around this u_r, by the mean slope of the curve.
    pub fn steepness(&self, forward: f64) -> f64 {
        let last = self.model.openings.last().copied().unwrap_or_default();
        let dead_band = self.model.dead_band;
        let edge = if forward >= 0.0 { dead_band.extend } else { dead_band.retract };
        let half = AROUND * last;
        let speed = |opening: f64| self.model.speed((edge + opening).copysign(forward)).abs();
        let at = (forward.abs() - edge).clamp(half, last);
        let slope = (speed(at + half) - speed(at - half)) / (2.0 * half);
        slope / self.mean_slope
    }

    /// Number of coming ticks whose references are used.
    pub fn ahead(&self) -> usize {
        self.lead.floor() as usize + self.before + 2
    }

    /// What comes of y_r(k), y_r(k+1), .. in m, under `load`. Beyond their end the last one counts; without references
    /// all is 0.
    pub fn coming(&self, references: &[f64], load: &Load) -> Coming {
        let Some(last) = references.last() else { return Coming { position: 0.0, speed: 0.0, command: 0.0 } };
        let first = self.lead.floor() as usize;
        let part = self.lead.fract();
        let at = |i: usize| references.get(first + i).unwrap_or(last);
        // The difference of two points on straight lines, one tick apart.
        let speed = |i: usize| ((1.0 - part) * (at(i + 1) - at(i)) + part * (at(i + 2) - at(i + 1))) / self.period;
        let now = speed(0);
        // Not `clamp`, which panics on references that are no number.
        let forces = (load.forces * now.signum()).max(-MOST_OPPOSED * now.abs()).min(MOST_ADDED * now.abs());
        let with_forces = now.abs() + forces;
        let moving = self.model.command(with_forces.copysign(now) / load.faster(now));
        let command = if now.abs() < STILL {
            let next = (1..=self.before).map(speed).find(|speed| speed.abs() >= STILL);
            let edge = next.map_or(0.0, |speed| self.edges[usize::from(speed < 0.0)]);
            edge + (moving - edge) * now.abs() / STILL
        } else {
            moving
        };
        Coming { position: (1.0 - part) * at(0) + part * at(1), speed: now, command }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::models::commissioned;

    const PERIOD: f64 = 0.01;

    #[test]
    fn a_steady_speed_gets_the_command_of_the_static_curve() {
        let feedforward = Feedforward::new(&commissioned(), 0.0, PERIOD);
        for speed in [0.2, 0.005, -0.1] {
            let targets: Vec<f64> = (0..40).map(|k| 0.3 + speed * PERIOD * f64::from(k)).collect();
            let command = feedforward.coming(&targets, &Load::USUAL).command;
            assert!((commissioned().speed(command) - speed).abs() < 1e-9, "{speed}: {command}");
        }
        assert_eq!(feedforward.coming(&[0.3; 40], &Load::USUAL).command, 0.0);
        assert_eq!(feedforward.coming(&[], &Load::USUAL).command, 0.0);
    }

    #[test]
    fn the_command_leads_the_motion_by_dead_time_and_lag() {
        let model = commissioned();
        let feedforward = Feedforward::new(&model, 0.0, PERIOD);
        let ahead = feedforward.ahead();
        let lead = (model.dead_time + model.time_constant) / PERIOD;
        for start in 0..40usize {
            let targets: Vec<f64> = (0..=ahead).map(|k| 0.1 * PERIOD * k.saturating_sub(start) as f64).collect();
            // The reference moves within (lead, lead + 1) ticks from now.
            let expected = (start as f64) < lead + 1.0;
            let command = feedforward.coming(&targets, &Load::USUAL).command;
            assert_eq!(model.speed(command) != 0.0, expected, "{start}: {command}");
        }
    }

    #[test]
    fn before_a_motion_the_spool_is_brought_to_the_edge_of_its_dead_band() {
        let model = commissioned();
        let feedforward = Feedforward::new(&model, 0.0, PERIOD);
        let lead = ((model.dead_time + model.time_constant) / PERIOD) as usize;
        let before = (2.0 * model.time_constant / PERIOD) as usize;
        for (sign, edge) in [(1.0, 0.9 * model.dead_band.extend), (-1.0, -0.9 * model.dead_band.retract)] {
            let command = |start: usize| {
                let targets: Vec<f64> =
                    (0..start + 200).map(|k| sign * 0.1 * PERIOD * k.saturating_sub(start) as f64).collect();
                feedforward.coming(&targets, &Load::USUAL).command
            };
            assert_eq!(command(lead + before + 5), 0.0, "not earlier");
            for start in lead + 3..lead + before {
                assert!((command(start) - edge).abs() < 1e-12, "{start}: {}", command(start));
            }
        }
        // After a motion the valve shuts.
        let stops: Vec<f64> = (0..200).map(|k| 0.1 * PERIOD * f64::from(k.min(2))).collect();
        assert_eq!(feedforward.coming(&stops, &Load::USUAL).command, 0.0);
    }

    /// A pump that stands by sees the load only through an open valve.
    #[test]
    fn a_fast_spool_is_at_its_edge_in_time_for_the_pump() {
        let model = Commissioned { dead_time: 0.0, time_constant: 0.01, ..commissioned() };
        let feedforward = Feedforward::new(&model, 0.1, PERIOD);
        let command = |start: usize| {
            let targets: Vec<f64> = (0..start + 200).map(|k| 0.1 * PERIOD * k.saturating_sub(start) as f64).collect();
            feedforward.coming(&targets, &Load::USUAL).command
        };
        // The reference moves in the tick after `start`; 1 tick of lag, and twice 10 for the pump.
        assert!((command(20) - model.compensated_dead_band().extend).abs() < 1e-12, "{}", command(20));
        assert_eq!(command(23), 0.0);
    }

    #[test]
    fn what_the_forces_take_is_added_and_turns_no_motion_round() {
        let feedforward = Feedforward::new(&commissioned(), 0.0, PERIOD);
        let speed = |speed: f64, forces: f64| {
            let targets: Vec<f64> = (0..40).map(|k| 0.3 + speed * PERIOD * f64::from(k)).collect();
            commissioned().speed(feedforward.coming(&targets, &Load { forces, ..Load::USUAL }).command)
        };
        for (reference, forces, expected) in [
            (0.1, 0.05, 0.15),
            (0.1, -0.05, 0.05),
            (-0.1, 0.05, -0.05),
            (0.1, -0.5, 0.01),
            (-0.1, 0.5, -0.01),
            (0.1, 9.0, 0.2),
        ] {
            assert!(
                (speed(reference, forces) - expected).abs() < 1e-9,
                "{reference} {forces}: {}",
                speed(reference, forces)
            );
        }
        assert_eq!(speed(0.0, 0.1), 0.0, "an axis that stands");
    }

    #[test]
    fn at_rest_the_command_does_not_jump_over_the_dead_band() {
        let feedforward = Feedforward::new(&commissioned(), 0.0, PERIOD);
        let creep = |speed: f64| {
            let targets: Vec<f64> = (0..40).map(|k| speed * PERIOD * f64::from(k)).collect();
            feedforward.coming(&targets, &Load::USUAL).command
        };
        assert!(creep(1e-9).abs() < 1e-6 && creep(-1e-9).abs() < 1e-6);
        assert!(creep(1e-3) > 0.1 && creep(-1e-3) < -0.08);
    }
}
