//! The model that a perfect commissioning of the simulated plant would find, from the plant's own parameters.
//!
//! ```text
//! dead band   d + h/2                    what the command must exceed where the spool lags it by half the play
//! s = (A_in p_s - A_out p_0 -+ F_L - F_f(w))/(A_1^3 + A_2^3)         w = k X sqrt(s)
//! ```
//!
//! Steady speed w m/s of a cylinder whose two control edges are both open by X: A_in the side that is fed, A_out the
//! other, m2; p_s supply and p_0 return pressure, Pa; F_L load in the middle of the stroke and F_f friction, N; k =
//! rated flow over the root of its pressure drop, X opening in 0 to 1; d dead band, h width of the hysteresis. It is
//! equation (3) at both edges and (9) without acceleration, and holds without leakage. Dead time and time constant are
//! the valve's.
//!
//! The trap: it is better than any experiment, since it knows what noise and short strokes hide from one.

use pipeline::machine::{Axis, Commissioned, DeadBand, Machine, Plant, Supply, ValveCurve};

/// Openings at which the static curve is known.
const OPENINGS: [f64; 8] = [0.02, 0.05, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8];
/// Rounds in which speed and friction, which depend on one another, agree far below a millionth.
const ROUNDS: usize = 100;

/// Of every axis; none for an axis that is not simulated.
pub fn commissioned(machine: &Machine) -> Vec<Option<Commissioned>> {
    let of = |axis: &Axis| Some(of_plant(axis.plant.as_ref()?, &machine.hydraulics.as_ref()?.supply));
    machine.axes.iter().map(of).collect()
}

fn of_plant(plant: &Plant, supply: &Supply) -> Commissioned {
    let play = 0.5 * plant.hysteresis;
    let dead_band = DeadBand { extend: plant.dead_band.extend + play, retract: plant.dead_band.retract + play };
    // A curve that is flat beyond saturation has no inverse there.
    let fullest = (1.0 - dead_band.extend)
        .min(1.0 - dead_band.retract)
        .min(plant.saturation.extend - plant.dead_band.extend)
        .min(plant.saturation.retract - plant.dead_band.retract);
    let mut openings: Vec<f64> = OPENINGS.into_iter().filter(|opening| *opening < fullest).collect();
    openings.push(fullest);
    let speeds = |extends| openings.iter().map(|opening| steady_speed(plant, supply, *opening, extends)).collect();
    Commissioned {
        dead_time: plant.dead_time,
        time_constant: plant.valve_time_constant,
        dead_band,
        speeds_extend: speeds(true),
        speeds_retract: speeds(false),
        openings,
        fit_percent: 100.0,
    }
}

/// The speed at a command that exceeds the dead band by `opening`, m/s.
fn steady_speed(plant: &Plant, supply: &Supply, opening: f64, extends: bool) -> f64 {
    let (a1, a2) = (plant.piston_area, plant.rod_area);
    let (dead_band, saturation, feeding, draining, load) = if extends {
        (plant.dead_band.extend, plant.saturation.extend, a1, a2, plant.load_force.middle)
    } else {
        (plant.dead_band.retract, plant.saturation.retract, a2, a1, -plant.load_force.middle)
    };
    let c = (opening / (saturation - dead_band)).min(1.0);
    let x = if plant.valve_curve == ValveCurve::S { c * c * (3.0 - 2.0 * c) } else { c };
    let edge = plant.rated_flow / plant.rated_pressure_drop.sqrt() * x;
    let mut speed = 0.0f64;
    for _ in 0..ROUNDS {
        let stribeck =
            (plant.static_friction - plant.coulomb_friction) / (1.0 + (speed / plant.stribeck_speed).powi(2));
        let friction = plant.coulomb_friction + stribeck + plant.viscous_friction * speed;
        let force = feeding * supply.pressure - draining * supply.return_pressure - load - friction;
        speed = edge * (force.max(0.0) / (a1.powi(3) + a2.powi(3))).sqrt();
    }
    speed
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use pipeline::{machine::LoadForce, message::ValveCommand};
    use plant_sim::PlantSim;

    use super::*;

    #[test]
    fn the_simulated_axes_move_as_fast_as_it_says() {
        let tick = Duration::from_millis(10);
        for command in [0.3, -0.3, 0.15, -0.15, 0.7, -0.7] {
            let settings = [("scenario".to_owned(), "nominal".to_owned())];
            let mut machine = Machine::load(None, &settings).unwrap();
            for axis in &mut machine.axes {
                let plant = axis.plant.as_mut().unwrap();
                plant.initial_position = if command > 0.0 { 0.05 } else { axis.stroke - 0.05 };
                plant.load_force = LoadForce::constant(plant.load_force.middle);
            }
            machine.hydraulics.as_mut().unwrap().supply.flow = 1.0;
            let mut sim = PlantSim::new(&machine, 1).unwrap();
            let mut message = ValveCommand::default();
            message.axes.iter_mut().for_each(|axis| axis.command = command);
            let mut hold = |ticks| {
                for _ in 0..ticks {
                    sim.command(&message);
                    sim.advance(tick);
                }
                sim.axes().iter().map(|axis| axis.position).collect::<Vec<_>>()
            };
            let (begin, end) = (hold(80), hold(20));
            for (index, known) in commissioned(&machine).into_iter().enumerate() {
                let (speed, expected) = ((end[index] - begin[index]) / 0.2, known.unwrap().speed(command));
                // Leakage, and straight lines between the points of a curve that friction bends.
                assert!((speed / expected - 1.0).abs() < 0.02, "{index} at {command}: {speed} m/s, {expected}");
            }
        }
    }
}
