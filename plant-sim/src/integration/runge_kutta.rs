//! One step of the classical Runge-Kutta method of fourth order, for all axes of the machine at once.
//!
//! ```text
//! z(t+h) = z + h/6 (k1 + 2 k2 + 2 k3 + k4)
//! k1 = g(z, X0)   k2 = g(z + h/2 k1, X1)   k3 = g(z + h/2 k2, X1)   k4 = g(z + h k3, X2)
//! ```
//!
//! z state (y, v, p1, p2, z) of every axis, and the pump's pressure; g its rates of change; h step, s; X0, X1 and X2
//! openings of the valves at t, t + h/2 and t + h, which are known before the step. The axes influence each other
//! through the pump only: at each stage the pump's share follows from the demand of all axes.
//!
//! Trap: implicit methods allow larger steps, but friction and end stops are not smooth, and a linearised method loses
//! the motion there. A small explicit step of fixed length does not, and it gives the same bits in every run.

use super::FourAxes;
use crate::{
    hydraulics::supply::{Demand, Pump},
    lanes::LANES,
};

/// The step, ns: 100 us, short enough for the stiffest part, an almost balanced orifice at an almost empty chamber.
pub const STEP_NS: u64 = 100_000;

/// Longest step, ns. A step divides it, so that a control period of whole milliseconds is a whole number of steps.
pub const LONGEST_STEP_NS: u64 = 1_000_000;

/// One stage of the step.
struct Stage {
    /// Index of the opening: 0 at the begin of the step, 1 in the middle, 2 at the end.
    part: usize,
    /// Weight of the stage's rates in the sum.
    weight: f64,
    /// Time of the next stage after the begin of the step, in steps.
    ahead: f64,
}

const STAGES: [Stage; 4] = [
    Stage { part: 0, weight: 1.0 / 6.0, ahead: 0.5 },
    Stage { part: 1, weight: 1.0 / 3.0, ahead: 0.5 },
    Stage { part: 1, weight: 1.0 / 3.0, ahead: 1.0 },
    Stage { part: 2, weight: 1.0 / 6.0, ahead: 0.0 },
];

/// Advances all axes and the pump by one step of `step` s under `commands`, one for each axis, or with the pilot
/// pressure `cut_off`.
#[inline]
pub fn runge_kutta(axes: &mut [FourAxes], commands: &[f64], cut_off: bool, pump: &mut Pump, step: f64) {
    for (four, commands) in axes.iter_mut().zip(commands.chunks(LANES)) {
        four.begin(commands, cut_off);
    }
    pump.begin();
    for Stage { part, weight, ahead } in STAGES {
        let supply = pump.stage_pressure();
        let demand = axes.iter_mut().map(|four| four.demand(part, supply)).fold(Demand::NONE, Demand::and);
        let share = pump.share(&demand, supply);
        pump.take_rate(&demand, weight, ahead * step);
        for four in axes.iter_mut() {
            four.take_rates(share, weight, ahead * step);
        }
    }
    pump.end(step);
    for four in axes {
        four.end(step);
    }
}
