//! Velocity feed-forward of the fallback: the command of a coming motion, by the commissioned model.
//!
//! ```text
//! L   = t_d + tau + T/2
//! v_r = (y_r(t + L + T/2) - y_r(t + L - T/2)) / T          straight lines between the references of the ticks
//! u_r = c^-1(v_r) min(|v_r| / v_s, 1)
//! ```
//!
//! y_r reference in m, t now, T period in s, t_d dead time and tau time constant in s, c static curve of
//! [`Commissioned`], v_r coming speed in m/s, v_s [`STILL`], u_r command. A command that is sent now acts in the middle
//! of its period and moves the axis after dead time and lag; hence the lead L. Source: the usual loop of mobile
//! hydraulics, with references that are known ahead.
//!
//! Traps: without the lead, feed-forward is late by the dead time, and the feedback corrects an error that is none. The
//! references of a channel end with the preview of its message: beyond it the axis is assumed to stand.

use pipeline::machine::Commissioned;

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

/// The feed-forward of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Feedforward {
    model: Commissioned,
    period: f64,
    /// L - T/2 in ticks.
    lead: f64,
}

impl Feedforward {
    /// Feed-forward by `model`, for a command every `period` s.
    pub fn new(model: &Commissioned, period: f64) -> Self {
        Self { model: model.clone(), period, lead: model.reaction() / period }
    }

    /// Number of coming ticks whose references are used.
    pub fn ahead(&self) -> usize {
        self.lead.floor() as usize + 2
    }

    /// What comes of y_r(k), y_r(k+1), .. in m. Beyond their end the last one counts; without references all is 0.
    pub fn coming(&self, references: &[f64]) -> Coming {
        let Some(last) = references.last() else { return Coming { position: 0.0, speed: 0.0, command: 0.0 } };
        let first = self.lead.floor() as usize;
        let part = self.lead.fract();
        let at = |i: usize| references.get(first + i).unwrap_or(last);
        // The difference of two points on straight lines, one tick apart.
        let speed = ((1.0 - part) * (at(1) - at(0)) + part * (at(2) - at(1))) / self.period;
        let position = (1.0 - part) * at(0) + part * at(1);
        Coming { position, speed, command: self.model.command(speed) * (speed.abs() / STILL).min(1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::models::commissioned;

    const PERIOD: f64 = 0.01;

    #[test]
    fn a_steady_speed_gets_the_command_of_the_static_curve() {
        let feedforward = Feedforward::new(&commissioned(), PERIOD);
        for speed in [0.2, 0.005, -0.1] {
            let targets: Vec<f64> = (0..40).map(|k| 0.3 + speed * PERIOD * f64::from(k)).collect();
            let command = feedforward.coming(&targets).command;
            assert!((commissioned().speed(command) - speed).abs() < 1e-9, "{speed}: {command}");
        }
        assert_eq!(feedforward.coming(&[0.3; 40]).command, 0.0);
        assert_eq!(feedforward.coming(&[]).command, 0.0);
    }

    #[test]
    fn the_command_leads_the_motion_by_dead_time_and_lag() {
        let model = commissioned();
        let feedforward = Feedforward::new(&model, PERIOD);
        let ahead = feedforward.ahead();
        let lead = (model.dead_time + model.time_constant) / PERIOD;
        for start in 0..40usize {
            let targets: Vec<f64> = (0..=ahead).map(|k| 0.1 * PERIOD * k.saturating_sub(start) as f64).collect();
            // The reference moves within (lead, lead + 1) ticks from now.
            let expected = (start as f64) < lead + 1.0;
            assert_eq!(feedforward.coming(&targets).command != 0.0, expected, "{start}");
        }
    }

    #[test]
    fn at_rest_the_command_does_not_jump_over_the_dead_band() {
        let feedforward = Feedforward::new(&commissioned(), PERIOD);
        let creep = |speed: f64| {
            let targets: Vec<f64> = (0..40).map(|k| speed * PERIOD * f64::from(k)).collect();
            feedforward.coming(&targets).command
        };
        assert!(creep(1e-9).abs() < 1e-6 && creep(-1e-9).abs() < 1e-6);
        assert!(creep(1e-3) > 0.1 && creep(-1e-3) < -0.08);
    }
}
