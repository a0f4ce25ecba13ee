//! Bounds that physics sets for any machine, and a run that is compared with them.
//!
//! ```text
//! p <= max((|F_L| + A p_s)/min(A1, A2), p_r + A v/g_r)        g_r = q_rated/(0.05 p_r)
//! s <= F/k_s + sqrt((F/k_s)^2 + m v^2/k_s)                    F = A p + |F_L|
//! m v^2/2 <= W + 2 F (L + 2 s) + p V
//! ```
//!
//! p largest pressure, Pa; v largest speed, m/s; s largest depth in a stop, m; A the larger area, m2; W work of the
//! pump, J; all of one run.
//!
//! - First bound: a chamber with a higher pressure than pump and load cause at rest gets no oil from the pump. Only the
//!   piston compresses it, and the relief valve lets oil out.
//! - Second bound: at the largest depth the spring of the stop holds the energy of the mass and the work of the force.
//! - Third bound: the mass gets its energy from the pump, from the load and from the oil, which held less than p V.
//!
//! Where an integrator is unstable, the first bound is the one that is broken: pressures chatter without a speed that
//! would explain them.

use std::time::Duration;

use pipeline::{machine::Machine, message::ValveCommand};
use plant_sim::{PlantSim, hydraulics::oil::LOWEST_PRESSURE};

/// Extreme values of one axis in a run, or their bounds; SI units.
#[derive(Debug, Clone, Copy, Default)]
struct Extremes {
    pressure: f64,
    least_pressure: f64,
    speed: f64,
    /// Depth in a stop.
    sink: f64,
}

/// Duration of a run, s.
const DURATION: u64 = 20;

/// Pressure by which an orifice may chatter at the limit of the step, Pa; see `plant_sim::plant::stiffness`.
const CHATTER: f64 = 6e5;

/// Largest factor of the load under the scenario `everything`.
const LARGEST_LOAD: f64 = 1.6;

/// Largest factor of the mass under the scenario `everything`.
const LARGEST_MASS: f64 = 2.0;

/// Full reversals with a different period for each of four axes.
fn commands(time: f64) -> ValveCommand {
    let mut message = ValveCommand::default();
    for (axis, period) in message.axes.iter_mut().zip([7.0, 3.0, 1.1, 0.4]) {
        axis.command = if (time / period).fract() < 0.5 { 1.0 } else { -1.0 };
    }
    message
}

/// Runs `machine` and compares each of its axes with the bounds.
pub fn check(machine: &Machine, what: &str) {
    let mut sim = PlantSim::new(machine, 1).unwrap_or_else(|error| panic!("{what}: {error}"));
    let mut met = vec![Extremes::default(); machine.axes.len()];
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

/// The bounds of an axis. Where a bound depends on another quantity, the value that was `met` in the run is used.
fn limits(machine: &Machine, axis: usize, met: &Extremes) -> Extremes {
    let (hydraulics, stroke) = (machine.hydraulics.unwrap(), machine.axes[axis].stroke);
    let plant = machine.axes[axis].plant.as_ref().unwrap();
    let supply = hydraulics.supply;
    let (area, least_area) = (plant.piston_area.max(plant.rod_area), plant.piston_area.min(plant.rod_area));
    let forces = plant.load_force;
    let largest = forces.retracted.abs().max(forces.middle.abs()).max(forces.extended.abs());
    // A parabola through three forces is nowhere more than twice the largest.
    let load = LARGEST_LOAD * 2.0 * largest + 0.5 * plant.load_stiffness * stroke;
    let at_rest = (load + area * supply.pressure) / least_area;
    let relief_gain = plant.rated_flow / (0.05 * plant.relief_pressure);
    let pressure = at_rest.max(plant.relief_pressure + area * met.speed / relief_gain);
    let force = area * met.pressure + load;
    let (soft, mass) = (force / plant.end_stop_stiffness, LARGEST_MASS * plant.mass);
    let sink = soft + (soft * soft + mass * met.speed.powi(2) / plant.end_stop_stiffness).sqrt();
    let hoses = plant.ports.piston_hose_volume + plant.ports.rod_hose_volume;
    // Walls that give way store energy, as much oil of that compliance would.
    let walls = hoses * pressure / plant.ports.hose_modulus;
    let volume = plant.piston_dead_volume + plant.rod_dead_volume + hoses + walls + area * stroke;
    let edge = plant.rated_flow / plant.rated_pressure_drop.sqrt() * supply.pressure.sqrt();
    let pumped = supply.pressure * supply.flow.min(edge) * DURATION as f64;
    let work = pumped + 2.0 * force * (stroke + 2.0 * sink) + pressure * volume;
    Extremes { pressure, least_pressure: LOWEST_PRESSURE, speed: (2.0 * work / plant.mass).sqrt(), sink }
}
