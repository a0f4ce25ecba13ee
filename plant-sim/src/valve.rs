//! The proportional valve: from the command to the opening of its control edges.
//!
//! ```text
//! tau_v dx_v/dt + x_v = u(t - t_d)                                     (1), K_1 = 1
//! X = (x_v - d_e)/(1 - d_e)   for x_v > d_e                            extends
//! X = (x_v + d_r)/(1 - d_r)   for x_v < -d_r                           retracts
//! X = 0                       between
//! ```
//!
//! u command and x_v spool position, both in [-1, 1]; t_d dead time s; tau_v s; d_e and d_r dead bands; X opening,
//! held in [-1, 1]. A spool at 1 is open fully whatever the dead band is.
//!
//! The command is constant over a step, so (1) has a solution in closed form, u + (x_v - u) exp(-t/tau_v); it is used
//! in place of the numerical one, and no time constant is too short for the step.
//!
//! The trap: dead time and tau_v are not the same thing. The first moves the answer, the second bends it; only the
//! first asks for samples of delay in an identified model.

use pipeline::machine::DeadBand;

/// The widest dead band; a schedule could otherwise close a valve for good and divide by zero.
pub const WIDEST_DEAD_BAND: f64 = 0.95;

/// Commands on their way: what is put in comes out a fixed number of steps later.
#[derive(Debug, Clone)]
pub struct DelayLine {
    commands: Box<[f64]>,
    oldest: usize,
}

impl DelayLine {
    /// A line of `steps` steps that starts with neutral commands.
    pub fn new(steps: usize) -> Self {
        Self { commands: vec![0.0; steps].into(), oldest: 0 }
    }

    /// Puts in the command of this step and takes out the one that acts in it.
    #[inline]
    pub fn pass(&mut self, command: f64) -> f64 {
        let Some(slot) = self.commands.get_mut(self.oldest) else {
            return command;
        };
        let acting = std::mem::replace(slot, command);
        self.oldest += 1;
        if self.oldest == self.commands.len() {
            self.oldest = 0;
        }
        acting
    }
}

/// The spool and its control edges, without the dead time.
#[derive(Debug, Clone, Copy)]
pub struct Valve {
    /// exp(-(step/2)/tau_v): what is left of the distance to the command after half a step.
    half_step_decay: f64,
    dead_band: DeadBand,
}

impl Valve {
    /// A valve with `time_constant` s and `dead_band`, advanced in steps of `step` s.
    pub fn new(time_constant: f64, dead_band: DeadBand, step: f64) -> Self {
        Self {
            half_step_decay: (-0.5 * step / time_constant).exp(),
            dead_band: DeadBand {
                extend: dead_band.extend.min(WIDEST_DEAD_BAND),
                retract: dead_band.retract.min(WIDEST_DEAD_BAND),
            },
        }
    }

    /// Spool position half a step and a whole step after `spool` under a constant command, equation (1).
    #[inline]
    pub fn spool_after(&self, spool: f64, command: f64) -> (f64, f64) {
        let distance = spool - command;
        let decay = self.half_step_decay;
        (command + distance * decay, command + distance * decay * decay)
    }

    /// Opening X of the edges in [-1, 1], positive extends.
    #[inline]
    pub fn opening(&self, spool: f64) -> f64 {
        let DeadBand { extend, retract } = self.dead_band;
        if spool > extend {
            ((spool - extend) / (1.0 - extend)).min(1.0)
        } else if spool < -retract {
            ((spool + retract) / (1.0 - retract)).max(-1.0)
        } else {
            0.0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 1e-4;

    fn valve() -> Valve {
        Valve::new(0.05, DeadBand { extend: 0.1, retract: 0.08 }, STEP)
    }

    #[test]
    fn the_delay_is_exact_in_steps() {
        for steps in [0, 1, 2, 200] {
            let mut line = DelayLine::new(steps);
            for i in 0..3 * steps + 3 {
                let expected = if i < steps { 0.0 } else { (i - steps + 1) as f64 };
                assert_eq!(line.pass((i + 1) as f64), expected, "{steps} steps, step {i}");
            }
        }
    }

    #[test]
    fn the_spool_follows_the_exponential() {
        let mut spool = 0.0;
        for _ in 0..500 {
            spool = valve().spool_after(spool, 0.7).1;
        }
        assert!((spool - 0.7 * (1.0 - (-1.0f64).exp())).abs() < 1e-12);
    }

    #[test]
    fn the_edges_stay_shut_inside_the_dead_band_and_open_fully_at_one() {
        for spool in [-0.08, -0.05, 0.0, 0.05, 0.1] {
            assert_eq!(valve().opening(spool), 0.0);
        }
        assert!((valve().opening(0.55) - 0.5).abs() < 1e-12);
        assert!((valve().opening(-0.54) + 0.5).abs() < 1e-12);
        for (spool, opening) in [(1.0, 1.0), (1.5, 1.0), (-1.0, -1.0), (-1.5, -1.0)] {
            assert_eq!(valve().opening(spool), opening);
        }
    }

    #[test]
    fn a_dead_band_beyond_the_widest_is_held_at_it() {
        let valve = Valve::new(0.05, DeadBand { extend: 18.0, retract: 18.0 }, STEP);
        assert_eq!((valve.opening(1.0), valve.opening(-1.0), valve.opening(0.94)), (1.0, -1.0, 0.0));
    }
}
