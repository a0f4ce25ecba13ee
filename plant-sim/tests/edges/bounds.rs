//! What physics allows a machine, and a run that is held to it.
//!
//! ```text
//! p <= max((|F_L| + A p_s)/min(A1, A2), p_r + A v/g_r)        g_r = q_rated/(0.05 p_r)
//! s <= F/k_s + sqrt((F/k_s)^2 + m v^2/k_s)                    F = A p + |F_L|
//! m v^2/2 <= W + 2 F (L + 2 s) + p V
//! ```
//!
//! p largest pressure, v largest speed and s deepest place in a stop of a run; A the larger area. A chamber above what
//! pump and load make of it at rest gets oil from nowhere, is pressed by the piston alone and gives to the relief
//! valve: the first. At the deepest place all that the mass had and the force did is in the spring: the second. W what
//! the pump gave, p V more than the oil held: the third. Where an integrator is unstable, the first is the one that
//! breaks: pressures chatter without a speed that would explain them.

use std::time::Duration;

use pipeline::{machine::Machine, message::ValveCommand};
use plant_sim::{PlantSim, hydraulics::oil::LOWEST_PRESSURE};

/// What a run met, of one axis; SI units.
#[derive(Debug, Clone, Copy, Default)]
struct Met {
    pressure: f64,
    least_pressure: f64,
    speed: f64,
    sink: f64,
}

/// Of a run, s.
const DURATION: u64 = 20;

/// By which an orifice at the limit of its step may chatter, Pa; see `plant_sim::stiffness`.
const CHATTER: f64 = 6e5;

/// Largest factor of the load and of the mass under the scenario `everything`.
const HEAVIEST: (f64, f64) = (1.6, 2.0);

/// Full reversals, for each of four axes in its own time.
fn commands(time: f64) -> ValveCommand {
    let mut message = ValveCommand::default();
    for (axis, period) in message.axes.iter_mut().zip([7.0, 3.0, 1.1, 0.4]) {
        axis.command = if (time / period).fract() < 0.5 { 1.0 } else { -1.0 };
    }
    message
}

/// Runs `machine` and holds each of its axes to the bounds.
pub fn hold(machine: &Machine, what: &str) {
    let mut sim = PlantSim::new(machine, 1).unwrap_or_else(|error| panic!("{what}: {error}"));
    let mut met = vec![Met::default(); machine.axes.len()];
    for tick in 0..100 * DURATION {
        sim.command(&commands(tick as f64 * 0.01));
        for _ in 0..100 {
            sim.advance(Duration::from_micros(100));
            for ((met, state), axis) in met.iter_mut().zip(sim.axes()).zip(&machine.axes) {
                let (p1, p2) = (state.piston_pressure, state.rod_pressure);
                let numbers = [state.position, state.velocity, p1, p2, state.spool_position];
                assert!(numbers.iter().all(|number| number.is_finite()), "{what}, {}: {state:?}", axis.name);
                met.pressure = met.pressure.max(p1).max(p2);
                met.least_pressure = met.least_pressure.min(p1).min(p2);
                met.speed = met.speed.max(state.velocity.abs());
                met.sink = met.sink.max(-state.position).max(state.position - axis.stroke);
            }
        }
    }
    for (axis, met) in met.iter().enumerate() {
        let limit = limits(machine, axis, met);
        let within = met.least_pressure >= limit.least_pressure
            && met.pressure <= limit.pressure + CHATTER
            && met.speed <= limit.speed
            && met.sink <= limit.sink;
        assert!(within, "{what}, axis {axis}: met {met:?}\nallowed {limit:?}\n{:?}", machine.axes[axis].plant);
    }
}

/// The bounds; where one of them follows from another quantity, from what was `met` of that.
fn limits(machine: &Machine, axis: usize, met: &Met) -> Met {
    let (hydraulics, stroke) = (machine.hydraulics.unwrap(), machine.axes[axis].stroke);
    let plant = machine.axes[axis].plant.as_ref().unwrap();
    let supply = hydraulics.supply;
    let (area, least_area) = (plant.piston_area.max(plant.rod_area), plant.piston_area.min(plant.rod_area));
    let forces = plant.load_force;
    let largest = forces.retracted.abs().max(forces.middle.abs()).max(forces.extended.abs());
    // A parabola through three forces is nowhere more than twice the largest.
    let load = HEAVIEST.0 * 2.0 * largest + 0.5 * plant.load_stiffness * stroke;
    let at_rest = (load + area * supply.pressure) / least_area;
    let relief_gain = plant.rated_flow / (0.05 * plant.relief_pressure);
    let pressure = at_rest.max(plant.relief_pressure + area * met.speed / relief_gain);
    let force = area * met.pressure + load;
    let (soft, mass) = (force / plant.end_stop_stiffness, HEAVIEST.1 * plant.mass);
    let sink = soft + (soft * soft + mass * met.speed.powi(2) / plant.end_stop_stiffness).sqrt();
    let volume = plant.piston_dead_volume + plant.rod_dead_volume + area * stroke;
    let edge = plant.rated_flow / plant.rated_pressure_drop.sqrt() * supply.pressure.sqrt();
    let pumped = supply.pressure * supply.flow.min(edge) * DURATION as f64;
    let work = pumped + 2.0 * force * (stroke + 2.0 * sink) + pressure * volume;
    Met { pressure, least_pressure: LOWEST_PRESSURE, speed: (2.0 * work / plant.mass).sqrt(), sink }
}
