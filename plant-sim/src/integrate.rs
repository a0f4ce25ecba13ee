//! One step of the classical Runge-Kutta method of fourth order, for all axes of the machine at once.
//!
//! ```text
//! z(t+h) = z + h/6 (k1 + 2 k2 + 2 k3 + k4)
//! k1 = g(z, X0)   k2 = g(z + h/2 k1, X1)   k3 = g(z + h/2 k2, X1)   k4 = g(z + h k3, X2)
//! ```
//!
//! z = (y, v, p1, p2, z) of every axis, g its rates, X0, X1, X2 the valves' openings at t, t + h/2 and t + h, known
//! beforehand. The axes meet in the pump alone: at each stage it has to know what all ask for.
//!
//! The trap: implicit methods promise larger steps, but friction and end stops are not smooth, and with them a
//! linearised method loses the motion. A fixed small explicit step does not, and it gives the same bits each time.

use crate::{group::Group, lanes::LANES, supply::Supply};

/// The step, ns: 100 us, short for the stiffest part, an almost balanced orifice at a chamber that is almost empty.
pub const STEP_NS: u64 = 100_000;

/// Of each stage: at which opening, its weight, and how far ahead of the begin the next stage is.
const STAGES: [(usize, f64, f64); 4] =
    [(0, 1.0 / 6.0, 0.5), (1, 1.0 / 3.0, 0.5), (1, 1.0 / 3.0, 1.0), (2, 1.0 / 6.0, 0.0)];

/// Advances all axes by one step of `step` s under `commands`, one per axis, or with the pilot pressure `cut_off`.
#[inline]
pub fn runge_kutta(groups: &mut [Group], commands: &[f64], cut_off: bool, supply: &Supply, step: f64) {
    for (group, commands) in groups.iter_mut().zip(commands.chunks(LANES)) {
        group.begin(commands, cut_off);
    }
    for (part, weight, ahead) in STAGES {
        let demand = groups.iter_mut().map(|group| group.demand(part)).sum();
        let share = supply.share(demand);
        for group in groups.iter_mut() {
            group.take_rates(share, weight, ahead * step);
        }
    }
    for group in groups {
        group.end(step);
    }
}
