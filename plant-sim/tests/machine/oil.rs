//! Conservation of the oil: oil that has flowed into a chamber is there, has leaked, or has flowed back to the tank.

use std::f64::consts::TAU;

use plant_sim::TrueState;

use super::*;

/// Integral of dp/beta_e between two close pressures by Gauss' rule of three points.
fn compression(machine: &Machine, from: f64, to: f64) -> f64 {
    let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
    let at = |x: f64| compressibility(machine, middle + half * x);
    let outer = 0.6f64.sqrt();
    half / 9.0 * (5.0 * at(-outer) + 8.0 * at(0.0) + 5.0 * at(outer))
}

/// Balance of the oil of one chamber. Volumes count at the density that the oil had at the start.
#[derive(Default)]
struct Balance {
    /// Natural logarithm of the density divided by that at the start.
    density: f64,
    /// Oil that has flowed in, less oil that has flowed out, m3.
    received: f64,
    /// Sum of the absolute flows, m3.
    turned_over: f64,
}

/// Volume of a chamber, m3, and its inflow, m3/s: flow through the valve less leakage.
fn chamber(machine: &Machine, axis: usize, state: &TrueState, side: usize) -> (f64, f64) {
    let (plant, stroke) = (machine.axes[axis].plant.as_ref().unwrap(), machine.axes[axis].stroke);
    let internal = plant.internal_leakage * (state.piston_pressure - state.rod_pressure);
    if side == 0 {
        let volume = plant.piston_dead_volume + plant.piston_area * state.position;
        (volume, state.piston_flow - internal - plant.external_leakage * state.piston_pressure)
    } else {
        let volume = plant.rod_dead_volume + plant.rod_area * (stroke - state.position);
        (volume, internal - state.rod_flow - plant.external_leakage * state.rod_pressure)
    }
}

#[test]
fn oil_is_conserved() {
    let mut machine = excavator();
    for axis in 0..4 {
        plant_of(&mut machine, axis).external_leakage = 1e-12;
    }
    let pressure = |state: &TrueState, side: usize| [state.piston_pressure, state.rod_pressure][side];
    let mut sim = simulate(&machine);
    let begin = sim.axes().to_vec();
    let mut balances = <[[Balance; 2]; 4]>::default();
    let mut before = begin.clone();
    let step = STEP.as_secs_f64();
    for i in 0..600_000 {
        sim.command(&all(0.5 * (TAU * 0.5 * f64::from(i) * step).sin()));
        sim.advance(STEP);
        for (axis, after) in sim.axes().iter().enumerate() {
            let relief = machine.axes[axis].plant.as_ref().unwrap().relief_pressure;
            for (side, balance) in balances[axis].iter_mut().enumerate() {
                let (old, new) = (pressure(&before[axis], side), pressure(after, side));
                assert!(new > 0.0 && new < relief, "relief and make-up valve have to stay shut");
                let density = balance.density + compression(&machine, old, new);
                let inflow = (chamber(&machine, axis, &before[axis], side).1, chamber(&machine, axis, after, side).1);
                // Trapezoidal rule for density times flow.
                balance.received += 0.5 * step * (balance.density.exp() * inflow.0 + density.exp() * inflow.1);
                balance.turned_over += step * inflow.1.abs();
                balance.density = density;
            }
            before[axis] = *after;
        }
    }
    for (axis, balances) in balances.iter().enumerate() {
        for (side, balance) in balances.iter().enumerate() {
            let there = balance.density.exp() * chamber(&machine, axis, &before[axis], side).0;
            let lost = balance.received - (there - chamber(&machine, axis, &begin[axis], side).0);
            println!("axis {axis} side {}: {lost:+.2e} m3 of {:.3} m3 turned over", side + 1, balance.turned_over);
            assert!(balance.turned_over > 0.02 && lost.abs() < 1e-9, "axis {axis} side {}: {lost:e}", side + 1);
        }
    }
}
