//! Axes at rest: the oil holds the load, and only leakage moves the piston.

use plant_sim::TrueState;

use super::*;

/// Speed of a loaded axis whose valve is shut, from (6) and from (9) with a constant force:
///
/// ```text
/// A1 dp1 = A2 dp2     =>     v = -(A1 q_1/C1 + A2 q_2/C2)/(A1^2/C1 + A2^2/C2)
/// ```
///
/// with the leakage q_1 = C_ip (p1 - p2) + C_ep p1 out of the piston side, q_2 = C_ip (p1 - p2) - C_ep p2 into the rod
/// side, and the compliances C = V/beta_e.
fn creep(machine: &Machine, axis: usize, state: &TrueState) -> f64 {
    let plant = machine.axes[axis].plant.as_ref().unwrap();
    let (a1, a2) = (plant.piston_area, plant.rod_area);
    let (p1, p2) = (state.piston_pressure, state.rod_pressure);
    let c1 = (plant.piston_dead_volume + a1 * state.position) * compressibility(machine, p1);
    let rod_volume = plant.rod_dead_volume + a2 * (machine.axes[axis].stroke - state.position);
    let c2 = rod_volume * compressibility(machine, p2);
    let internal = plant.internal_leakage * (p1 - p2);
    let (q1, q2) = (internal + plant.external_leakage * p1, internal - plant.external_leakage * p2);
    -(a1 * q1 / c1 + a2 * q2 / c2) / (a1 * a1 / c1 + a2 * a2 / c2)
}

/// The built-in machine with constant loads in both directions, and with this leakage.
fn loaded(internal: f64, external: f64) -> Machine {
    let mut machine = excavator();
    for (axis, load) in [200e3, -60e3, 30e3, -20e3].into_iter().enumerate() {
        let plant = plant_of(&mut machine, axis);
        plant.load_force = LoadForce::constant(load);
        (plant.internal_leakage, plant.external_leakage) = (internal, external);
    }
    machine
}

#[test]
fn a_loaded_axis_drifts_by_the_formula_of_its_leakage() {
    for (internal, external) in [(2e-12, 0.0), (5e-13, 1e-12)] {
        let machine = loaded(internal, external);
        let mut sim = simulate(&machine);
        // After 3 s the bristles slide and friction is constant, as the load is.
        sim.advance(Duration::from_secs(3));
        let (begin, mut expected) = (sim.axes().to_vec(), [0.0; 4]);
        for _ in 0..400 {
            let speeds: Vec<f64> = (0..4).map(|axis| creep(&machine, axis, &sim.axes()[axis])).collect();
            sim.advance(TICK);
            for (axis, speed) in speeds.into_iter().enumerate() {
                expected[axis] += 0.01 * 0.5 * (speed + creep(&machine, axis, &sim.axes()[axis]));
            }
        }
        for axis in 0..4 {
            let drift = sim.axes()[axis].position - begin[axis].position;
            println!("axis {axis}: {:+.4} mm in 4 s, formula {:+.4} mm", 1e3 * drift, 1e3 * expected[axis]);
            assert!((drift / expected[axis] - 1.0).abs() < 0.05, "axis {axis}: {drift} for {}", expected[axis]);
            assert!(drift.abs() > 2e-4, "the drift is large enough to be measured");
        }
    }
}

#[test]
fn without_leakage_a_loaded_axis_stays_where_it_was_stopped() {
    let machine = loaded(0.0, 0.0);
    let mut sim = simulate(&machine);
    hold(&mut sim, 0.5, 1.0);
    hold(&mut sim, -0.3, 0.5);
    // After 30 s load and oil no longer oscillate. Bristles that are shaken let a load slip, as real seals do.
    sim.advance(Duration::from_secs(30));
    let stopped = sim.axes().to_vec();
    sim.advance(Duration::from_secs(60));
    for (axis, (now, stopped)) in sim.axes().iter().zip(stopped).enumerate() {
        let drift = now.position - stopped.position;
        println!("axis {axis}: {drift:+.1e} m in 60 s");
        assert!(drift.abs() < 1e-6, "axis {axis}: {drift:e} m");
    }
}

#[test]
fn friction_alone_holds_a_load_below_static_friction_and_does_not_creep() {
    let mut machine = excavator();
    for axis in 0..4 {
        let plant = plant_of(&mut machine, axis);
        plant.load_force = LoadForce::constant(0.8 * plant.static_friction);
        plant.external_leakage = 1e-9; // empties both chambers
    }
    let mut sim = simulate(&machine);
    sim.advance(Duration::from_secs(30));
    let settled = sim.axes().to_vec();
    sim.advance(Duration::from_secs(60));
    for (axis, (now, settled)) in sim.axes().iter().zip(&settled).enumerate() {
        let plant = machine.axes[axis].plant.as_ref().unwrap();
        let oil = plant.piston_area * now.piston_pressure - plant.rod_area * now.rod_pressure;
        println!("axis {axis}: {:+.1e} m in 60 s; the oil holds {oil:.1e} N", now.position - settled.position);
        assert!(oil.abs() < 0.01 * plant.static_friction && (now.position - settled.position).abs() < 1e-6);
    }
}
