//! What the axes do to one another.

use super::*;

/// The excavator with the teeth 6.9 m out and 2.2 m below the ground, boom and arm at 38 and 34 % of their strokes,
/// telescope retracted, bucket at 27 %.
fn reaching() -> Machine {
    let mut machine = excavator();
    without_leakage(&mut machine);
    for (plant, position) in plants(&mut machine).zip([0.5, 0.5, 0.0, 0.3]) {
        plant.initial_position = position;
    }
    machine
}

/// Largest motion of the boom's piston, m, while the arm alone moves at a command of 0.6 for half a second and stops.
fn boom_under_arm_step(machine: &Machine) -> f64 {
    let mut sim = simulate(machine);
    let begin = positions(&sim)[0];
    let mut most = 0.0f64;
    for tick in 0..200 {
        sim.command(&commands([0.0, if tick < 50 { 0.6 } else { 0.0 }, 0.0, 0.0]));
        for _ in 0..10 {
            sim.advance(Duration::from_millis(1));
            most = most.max((positions(&sim)[0] - begin).abs());
        }
    }
    most
}

#[test]
fn an_arm_that_starts_and_stops_moves_the_boom_by_a_few_millimetres() {
    for payload in [0.0, 1000.0] {
        let mut machine = reaching();
        machine.mechanism.as_mut().unwrap().masses.payload.mass = payload;
        let moved = boom_under_arm_step(&machine);
        println!("{payload} kg: {:.2} mm", 1e3 * moved);
        if payload == 0.0 {
            assert!((2e-3..4e-3).contains(&moved), "{moved}");
        } else {
            assert!((4e-3..5e-3).contains(&moved), "{moved}");
        }
    }
}

#[test]
fn axes_without_a_mechanism_leave_each_other_alone() {
    let mut machine = reaching();
    machine.mechanism = None;
    plants(&mut machine).zip([40e3, 12e3, 3e3, 4e3]).for_each(|(plant, mass)| plant.mass = mass);
    let moved = boom_under_arm_step(&machine);
    assert!(moved < 1e-6, "{moved}");
}

#[test]
fn a_payload_lowers_the_boom_and_bends_all_springs_of_oil() {
    let mut machine = reaching();
    machine.scenario.changes = vec![step_to(Parameter::Payload, 1.0, 1500.0)];
    let mut sim = simulate(&machine);
    sim.advance(Duration::from_secs(1));
    let before = sim.axes().to_vec();
    sim.advance(Duration::from_secs(5));
    let prepared = |payload: f64| {
        let mut mechanism = mechanism();
        mechanism.masses.payload.mass = payload;
        mechanism.prepared()
    };
    let loaded = prepared(1500.0);
    let weights = loaded.dynamics(&loaded.pose(&positions(&sim)), &[0.0; AXES], Vector::default()).load;
    for (axis, state) in sim.axes().iter().enumerate() {
        let plant = machine.axes[axis].plant.as_ref().unwrap();
        let oil = plant.piston_area * state.piston_pressure - plant.rod_area * state.rod_pressure;
        println!(
            "axis {axis}: {:+.2} mm; oil {oil:.0} N, weight {:.0} N",
            1e3 * (state.position - before[axis].position),
            weights[axis]
        );
        // What is missing is held by friction.
        assert!((oil - weights[axis]).abs() <= plant.static_friction, "axis {axis}: {oil} {}", weights[axis]);
    }
    assert!(sim.axes()[0].position < before[0].position - 1e-3);
}
