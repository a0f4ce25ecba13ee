//! Motion of the axes compared with closed formulas.

use super::*;

/// Steady speed under a constant command, from (3) with both edges, (9) without acceleration, and no leakage.
///
/// With the speed w = |v| and s = (w/(k X))^2, extension has p1 = p_s - A1^2 s and p2 = p_0 + A2^2 s, retraction
/// p1 = p_0 + A1^2 s and p2 = p_s - A2^2 s; A1 p1 - A2 p2 = F_L +- F_f(w) gives
///
/// ```text
/// extend:  s = (A1 p_s - A2 p_0 - F_L - F_f(w))/(A1^3 + A2^3)
/// retract: s = (A2 p_s - A1 p_0 + F_L - F_f(w))/(A1^3 + A2^3)
/// ```
///
/// The first, with p_0 = 0, A1 p_L = F_L + F_f and n = A2/A1, is (4): A1 w = k X sqrt((p_s - p_L)/(1 + n^3)).
fn steady_speed(machine: &Machine, axis: usize, command: f64) -> f64 {
    let (plant, supply) = (machine.axes[axis].plant.as_ref().unwrap(), machine.hydraulics.unwrap().supply);
    let (a1, a2) = (plant.piston_area, plant.rod_area);
    let dead_band = if command > 0.0 { plant.dead_band.extend } else { plant.dead_band.retract };
    // The spool follows the command by half the width of the hysteresis.
    let spool = command.abs() - 0.5 * plant.hysteresis;
    let edge = plant.rated_flow / plant.rated_pressure_drop.sqrt() * (spool - dead_band) / (1.0 - dead_band);
    let (feeding, draining) = if command > 0.0 { (a1, a2) } else { (a2, a1) };
    let load = plant.load_force.middle * command.signum();
    let mut speed = 0.0f64;
    for _ in 0..100 {
        let stribeck =
            (plant.static_friction - plant.coulomb_friction) / (1.0 + (speed / plant.stribeck_speed).powi(2));
        let friction = plant.coulomb_friction + stribeck + plant.viscous_friction * speed;
        let force = feeding * supply.pressure - draining * supply.return_pressure - load - friction;
        speed = edge * (force / (a1.powi(3) + a2.powi(3))).sqrt();
    }
    speed.copysign(command)
}

#[test]
fn the_steady_speed_follows_the_formula_in_both_directions() {
    let mut ratios = [[0.0; 2]; 4];
    for command in [0.3, 0.6, 1.0, -0.3, -0.6, -1.0] {
        let mut machine = excavator();
        // The formula assumes enough flow for all axes and a load that does not depend on the position.
        machine.hydraulics.as_mut().unwrap().supply.flow = 1.0;
        for axis in 0..machine.axes.len() {
            let stroke = machine.axes[axis].stroke;
            let plant = plant_of(&mut machine, axis);
            plant.initial_position = if command > 0.0 { 0.05 } else { stroke - 0.05 };
            plant.load_force = LoadForce::constant(plant.load_force.middle);
        }
        let mut sim = simulate(&machine);
        hold(&mut sim, command, 0.6);
        let begin: Vec<f64> = sim.axes().iter().map(|axis| axis.position).collect();
        hold(&mut sim, command, 0.2);
        for (index, begin) in begin.into_iter().enumerate() {
            let axis = &machine.axes[index];
            let speed = (sim.axes()[index].position - begin) / 0.2;
            let expected = steady_speed(&machine, index, command);
            println!("{} {command:+}: {speed:.5} m/s, formula {expected:.5}", axis.name);
            assert!((speed / expected - 1.0).abs() < 0.005, "{} at {command}: {speed}, {expected}", axis.name);
            if command.abs() == 1.0 {
                ratios[index][usize::from(command < 0.0)] = speed.abs();
            }
        }
    }
    for (axis, [extend, retract]) in ratios.into_iter().enumerate() {
        println!("axis {axis}: retracts {:.3} times as fast as it extends", retract / extend);
        assert!(
            (retract / extend - 1.0).abs() > 0.02,
            "a cylinder with one rod has different speeds in both directions"
        );
    }
}

#[test]
fn nothing_moves_inside_the_dead_band() {
    let machine = excavator();
    for command in [0.104, -0.084] {
        let (mut moved, mut resting) = (simulate(&machine), simulate(&machine));
        hold(&mut moved, command, 2.0);
        hold(&mut resting, 0.0, 2.0);
        for (moved, resting) in moved.axes().iter().zip(resting.axes()) {
            assert!((moved.spool_position - command).abs() < 0.0051, "{moved:?}");
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
fn full_commands_in_both_directions_stay_between_the_end_stops() {
    let machine = excavator();
    let mut sim = simulate(&machine);
    for (command, rest) in [(1.0, 1.0), (-1.0, 0.0), (1.0, 1.0)] {
        let mut depth = [0.0f64; 4];
        // 10 s: the slowest axis needs 6 s for its stroke.
        for _ in 0..1000 {
            hold(&mut sim, command, 0.01);
            for (index, state) in sim.axes().iter().enumerate() {
                let stroke = machine.axes[index].stroke;
                assert!(
                    state.velocity.is_finite() && state.piston_pressure.is_finite() && state.rod_pressure >= -101_325.0
                );
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
