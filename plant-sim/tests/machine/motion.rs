//! How the axes move, against closed formulas.

use std::{f64::consts::TAU, time::Duration};

use pipeline::machine::Plant;

use super::*;

const STEP: Duration = Duration::from_micros(100);

/// Steady speed under a constant command, from (3) with both edges, (9) without acceleration, and no leakage.
///
/// With the speed w = |v| and s = (w/(k X))^2, extension has p1 = p_s - A1^2 s and p2 = p_0 + A2^2 s, retraction
/// p1 = p_0 + A1^2 s and p2 = p_s - A2^2 s; A1 p1 - A2 p2 = F_L +- F_f(w) gives
///
/// ```text
/// extend:  s = (A1 p_s - A2 p_0 - F_L - F_f(w))/(A1^3 + A2^3)
/// retract: s = (A2 p_s - A1 p_0 + F_L - F_f(w))/(A1^3 + A2^3)
/// ```
fn steady_speed(plant: &Plant, command: f64) -> f64 {
    let (a1, a2) = (plant.piston_area, plant.rod_area);
    let dead_band = if command > 0.0 { plant.dead_band.extend } else { plant.dead_band.retract };
    let opening = (command.abs() - dead_band) / (1.0 - dead_band);
    let edge = plant.rated_flow / plant.rated_pressure_drop.sqrt() * opening;
    let (feeding, draining) = if command > 0.0 { (a1, a2) } else { (a2, a1) };
    let load = plant.load_force * command.signum();
    let mut speed = 0.0;
    for _ in 0..100 {
        let friction = plant.coulomb_friction + plant.viscous_friction * speed;
        let force = feeding * plant.supply_pressure - draining * plant.return_pressure - load - friction;
        speed = edge * (force / (a1.powi(3) + a2.powi(3))).sqrt();
    }
    speed.copysign(command)
}

#[test]
fn the_steady_speed_is_the_formulas_in_both_directions() {
    for command in [0.4, 0.6, 1.0, -0.4, -0.6, -1.0] {
        let mut machine = excavator();
        for axis in 0..machine.axes.len() {
            let stroke = machine.axes[axis].stroke;
            plant_of(&mut machine, axis).initial_position = if command > 0.0 { 0.05 } else { stroke - 0.05 };
        }
        let mut sim = simulate(&machine);
        hold(&mut sim, command, 0.8);
        let begin: Vec<f64> = sim.axes().iter().map(|axis| axis.position).collect();
        hold(&mut sim, command, 0.4);
        for (index, begin) in begin.into_iter().enumerate() {
            let axis = &machine.axes[index];
            let speed = (sim.axes()[index].position - begin) / 0.4;
            let expected = steady_speed(axis.plant.as_ref().unwrap(), command);
            println!("{} {command:+}: {speed:.5} m/s, formula {expected:.5}", axis.name);
            assert!((speed / expected - 1.0).abs() < 0.01, "{} at {command}: {speed}, {expected}", axis.name);
        }
    }
}

#[test]
fn nothing_moves_inside_the_dead_band() {
    let machine = excavator();
    for command in [0.099, -0.079] {
        let (mut moved, mut resting) = (simulate(&machine), simulate(&machine));
        hold(&mut moved, command, 2.0);
        hold(&mut resting, 0.0, 2.0);
        for (moved, resting) in moved.axes().iter().zip(resting.axes()) {
            assert!((moved.spool_position - command).abs() < 1e-9);
            assert_eq!(moved.position, resting.position, "at {command}");
        }
    }
}

#[test]
fn the_spool_moves_exactly_one_dead_time_after_the_command() {
    for dead_time in [0.0, 1e-4, 0.02, 0.5] {
        let mut machine = excavator();
        plant_of(&mut machine, 0).dead_time = dead_time;
        machine.timing.drive_timeout = Duration::from_secs(1);
        let mut sim = simulate(&machine);
        sim.command(&all(1.0));
        sim.advance(Duration::from_secs_f64(dead_time));
        assert_eq!(sim.axes()[0].spool_position, 0.0, "{dead_time} s");
        sim.advance(STEP);
        assert!(sim.axes()[0].spool_position > 0.0, "{dead_time} s");
    }
}

#[test]
fn the_oil_that_flows_in_is_the_oil_that_is_there() {
    let mut machine = excavator();
    plant_of(&mut machine, 0).external_leakage = 1e-12;
    plant_of(&mut machine, 0).return_pressure = 5e5;
    let plant = plant_of(&mut machine, 0).clone();
    let stroke = machine.axes[0].stroke;
    let edge = plant.rated_flow / plant.rated_pressure_drop.sqrt();
    let root = |dp: f64| dp.abs().sqrt().copysign(dp);
    // (flow into the chamber, flow lost by leakage, its volume) for both sides
    let sides = |state: &plant_sim::AxisState| {
        let (p1, p2, x) = (state.piston_pressure, state.rod_pressure, state.spool_position);
        let internal = plant.internal_leakage * (p1 - p2);
        let (into_piston, into_rod) = if x > plant.dead_band.extend {
            let opening = edge * (x - plant.dead_band.extend) / (1.0 - plant.dead_band.extend);
            (opening * root(plant.supply_pressure - p1), -opening * root(p2 - plant.return_pressure))
        } else if x < -plant.dead_band.retract {
            let opening = edge * (-x - plant.dead_band.retract) / (1.0 - plant.dead_band.retract);
            (-opening * root(p1 - plant.return_pressure), opening * root(plant.supply_pressure - p2))
        } else {
            (0.0, 0.0)
        };
        [
            (
                into_piston,
                internal + plant.external_leakage * p1,
                plant.piston_dead_volume + plant.piston_area * state.position,
            ),
            (
                into_rod,
                plant.external_leakage * p2 - internal,
                plant.rod_dead_volume + plant.rod_area * (stroke - state.position),
            ),
        ]
    };

    let mut sim = simulate(&machine);
    let (mut gained, mut stored, mut turned_over) = ([0.0; 2], [0.0; 2], [0.0; 2]);
    for i in 0..30_000 {
        let before = sim.axes()[0];
        sim.command(&all(0.5 * (TAU * 0.5 * f64::from(i) * 1e-4).sin()));
        sim.advance(STEP);
        let after = sim.axes()[0];
        assert!(after.piston_pressure > 0.0 && after.rod_pressure > 0.0);
        let compressed = [after.piston_pressure - before.piston_pressure, after.rod_pressure - before.rod_pressure];
        for (side, (a, b)) in sides(&before).into_iter().zip(sides(&after)).enumerate() {
            gained[side] += 0.5e-4 * (a.0 - a.1 + b.0 - b.1);
            stored[side] += b.2 - a.2 + 0.5 * (a.2 + b.2) * compressed[side] / plant.bulk_modulus;
            turned_over[side] += (0.5e-4 * (a.0 + b.0)).abs();
        }
    }
    for side in 0..2 {
        let lost = (gained[side] - stored[side]) / turned_over[side];
        println!("side {}: {:.3e} of {:.3e} m3 lost", side + 1, lost * turned_over[side], turned_over[side]);
        assert!(turned_over[side] > 1e-3 && lost.abs() < 1e-4, "side {}: {lost:e}", side + 1);
    }
}

#[test]
fn full_command_both_ways_stays_between_the_end_stops() {
    let machine = excavator();
    let mut sim = simulate(&machine);
    for (command, rest) in [(1.0, 1.0), (-1.0, 0.0), (1.0, 1.0)] {
        let mut depth = [0.0f64; 4];
        // 10 s: the slowest axis needs 6 s for its stroke.
        for _ in 0..1000 {
            hold(&mut sim, command, 0.01);
            for (index, state) in sim.axes().iter().enumerate() {
                let stroke = machine.axes[index].stroke;
                assert!(state.velocity.is_finite() && state.piston_pressure.is_finite() && state.rod_pressure >= 0.0);
                depth[index] = depth[index].max(state.position - stroke).max(-state.position);
            }
        }
        for (index, state) in sim.axes().iter().enumerate() {
            let (axis, stop) = (&machine.axes[index], rest * machine.axes[index].stroke);
            let sunk = (state.position - stop).abs();
            println!("{}: {:.2} mm into the stop at most, {:.2} mm at rest", axis.name, 1e3 * depth[index], 1e3 * sunk);
            assert!(depth[index] < 8e-3 && sunk < 4e-3, "{}: {} {sunk}", axis.name, depth[index]);
            assert!(state.velocity.abs() < 1e-4, "{}: {}", axis.name, state.velocity);
        }
    }
}

#[test]
fn a_load_at_rest_is_held_up_to_leakage() {
    let mut machine = excavator();
    plant_of(&mut machine, 1).load_force = -30e3;
    plant_of(&mut machine, 2).load_force = -200e3; // more than the piston side can hold
    plant_of(&mut machine, 3).load_stiffness = 1e5;
    let mut sim = simulate(&machine);
    for _ in 0..10 {
        let before = sim.axes().to_vec();
        sim.advance(Duration::from_secs(1));
        for (axis, (after, before)) in machine.axes.iter().zip(sim.axes().iter().zip(before)) {
            // An ideal incompressible cylinder drifts with the leakage flow over the smaller area.
            let plant = axis.plant.as_ref().unwrap();
            let leakage = plant.internal_leakage * (before.piston_pressure - before.rod_pressure).abs();
            let drift = (after.position - before.position).abs();
            assert!(drift < 1.5 * leakage / plant.rod_area + 1e-6, "{}: {drift}", axis.name);
        }
    }
    assert!((sim.axes()[0].position - 0.65).abs() < 1e-3);
}
