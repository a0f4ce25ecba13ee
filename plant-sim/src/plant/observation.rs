//! What can be seen of the machine from outside at one time.
//!
//! The machine is integrated in whole steps. A time between two steps lies in a step that has been made already, and
//! the states at that time are interpolated:
//!
//! ```text
//! x(t) = x_0 + (x_1 - x_0) (t - t_0)/h
//! ```
//!
//! x_0 and x_1 states at begin and end of the step; t_0 begin of the step, s; h step, s. The error is at most h^2/8
//! times the second derivative: for the position at 10 m/s2 and a step of 100 us, 13 nm.

use mechanism::{AXES, Vector};

use crate::integration::TrueState;

/// True states of all axes, the pressure of the supply and what sensors at joints see at one time.
#[derive(Debug, Clone, Default)]
pub struct Observation {
    /// States of all axes, in the machine's order.
    pub states: Vec<TrueState>,
    /// Supply pressure that is left, Pa.
    pub supply_pressure: f64,
    /// Directions that sensors at the joints of a mechanism see, as cosine and sine; zero without such sensors.
    pub seen: [Vector; AXES],
}

impl Observation {
    /// An observation with room for `axes` axes.
    pub fn with_room(axes: usize) -> Self {
        Self { states: Vec::with_capacity(axes), supply_pressure: 0.0, seen: [Vector::default(); AXES] }
    }

    /// Takes the values at the part `part` of the way from `begin` to `end`.
    pub fn interpolate(&mut self, begin: &Self, end: &Self, part: f64) {
        let between = |begin: f64, end: f64| begin + (end - begin) * part;
        self.supply_pressure = between(begin.supply_pressure, end.supply_pressure);
        self.seen = std::array::from_fn(|i| begin.seen[i] + part * (end.seen[i] - begin.seen[i]));
        self.states.clear();
        self.states.extend(begin.states.iter().zip(&end.states).map(|(begin, end)| TrueState {
            position: between(begin.position, end.position),
            velocity: between(begin.velocity, end.velocity),
            piston_pressure: between(begin.piston_pressure, end.piston_pressure),
            rod_pressure: between(begin.rod_pressure, end.rod_pressure),
            spool_position: between(begin.spool_position, end.spool_position),
            piston_flow: between(begin.piston_flow, end.piston_flow),
            rod_flow: between(begin.rod_flow, end.rod_flow),
            pump_flow: between(begin.pump_flow, end.pump_flow),
        }));
    }
}
