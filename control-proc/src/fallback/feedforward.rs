//! What the fallback adds for a motion that it sees coming: velocity feed-forward by the commissioned model.
//!
//! ```text
//! L   = t_d + tau + T/2
//! v_r = (y_r(t + L + T/2) - y_r(t + L - T/2)) / T          straight lines between the ticks' targets
//! u_r = c^-1(v_r) min(|v_r| / v_s, 1)
//! ```
//!
//! y_r target in m, t now, T period in s, t_d dead time and tau time constant in s, c static curve of
//! [`Commissioned`], v_r coming speed in m/s, v_s [`STILL`], u_r command. What is sent now acts in the middle of its
//! period and moves the axis after dead time and lag: hence L. Source: the usual loop of mobile hydraulics, with the
//! targets taken ahead.
//!
//! Traps: without the lead, feed-forward is late by the dead time and the feedback corrects an error that is not one.
//! Targets from a channel end with the preview of their message: beyond it the axis is taken to stand.

use pipeline::machine::Commissioned;

/// Slower than this, in m/s, a motion is left to the feedback more and more: at v_r = 0 the command would jump over the
/// whole dead band.
pub const STILL: f64 = 1e-3;

/// The feed-forward of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Feedforward {
    model: Commissioned,
    period: f64,
    /// L - T/2 in ticks.
    lead: f64,
}

impl Feedforward {
    /// By `model`, for a command every `period` s.
    pub fn new(model: &Commissioned, period: f64) -> Self {
        Self { model: model.clone(), period, lead: (model.dead_time + model.time_constant) / period }
    }

    /// Ticks ahead of the last target that is used.
    pub fn ahead(&self) -> usize {
        self.lead.floor() as usize + 2
    }

    /// u_r for y_r(k), y_r(k+1), .. in m; beyond their end the last one counts, and no targets ask for nothing.
    pub fn command(&self, targets: &[f64]) -> f64 {
        let Some(last) = targets.last() else { return 0.0 };
        let first = self.lead.floor() as usize;
        let part = self.lead.fract();
        let target = |i: usize| targets.get(first + i).unwrap_or(last);
        // The difference of two points on straight lines, one tick apart.
        let speed = ((1.0 - part) * (target(1) - target(0)) + part * (target(2) - target(1))) / self.period;
        self.model.command(speed) * (speed.abs() / STILL).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::models::commissioned;

    const PERIOD: f64 = 0.01;

    #[test]
    fn a_steady_speed_gets_the_command_that_makes_it() {
        let feedforward = Feedforward::new(&commissioned(), PERIOD);
        for speed in [0.2, 0.005, -0.1] {
            let targets: Vec<f64> = (0..40).map(|k| 0.3 + speed * PERIOD * f64::from(k)).collect();
            let command = feedforward.command(&targets);
            assert!((commissioned().speed(command) - speed).abs() < 1e-9, "{speed}: {command}");
        }
        assert_eq!(feedforward.command(&[0.3; 40]), 0.0);
        assert_eq!(feedforward.command(&[]), 0.0);
    }

    #[test]
    fn a_motion_is_met_a_dead_time_and_a_lag_before_it_begins() {
        let model = commissioned();
        let feedforward = Feedforward::new(&model, PERIOD);
        let ahead = feedforward.ahead();
        let lead = (model.dead_time + model.time_constant) / PERIOD;
        for start in 0..40usize {
            let targets: Vec<f64> = (0..=ahead).map(|k| 0.1 * PERIOD * k.saturating_sub(start) as f64).collect();
            // Moves within (lead, lead + 1) ticks from now.
            let expected = (start as f64) < lead + 1.0;
            assert_eq!(feedforward.command(&targets) != 0.0, expected, "{start}");
        }
    }

    #[test]
    fn at_rest_it_does_not_jump_over_the_dead_band() {
        let feedforward = Feedforward::new(&commissioned(), PERIOD);
        let creep = |speed: f64| {
            let targets: Vec<f64> = (0..40).map(|k| speed * PERIOD * f64::from(k)).collect();
            feedforward.command(&targets)
        };
        assert!(creep(1e-9).abs() < 1e-6 && creep(-1e-9).abs() < 1e-6);
        assert!(creep(1e-3) > 0.1 && creep(-1e-3) < -0.08);
    }
}
