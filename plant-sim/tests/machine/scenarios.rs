//! Effects of scenarios on the motion.

use pipeline::machine::{Change, Parameter};

use super::*;

#[test]
fn a_change_of_the_flow_gain_changes_the_speed_by_its_factor() {
    let mut machine = excavator();
    machine.scenario.changes =
        vec![Change { axis: Some(0), parameter: Parameter::FlowGain, start: 1.2, end: 1.5, to: 0.5 }];
    let plant = plant_of(&mut machine, 0);
    // Otherwise a lower speed would have a little less friction, and another position another load.
    plant.viscous_friction = 0.0;
    plant.bristle_damping = 0.0;
    plant.load_force = LoadForce::constant(120e3);
    plant.initial_position = 0.1;
    let mut sim = simulate(&machine);
    let mut distance = |seconds| {
        let begin = sim.axes()[0].position;
        hold(&mut sim, 0.4, seconds);
        sim.axes()[0].position - begin
    };
    distance(0.8);
    let before = distance(0.4);
    distance(0.8);
    let after = distance(0.4);
    assert!((after / before - 0.5).abs() < 0.005, "{before} {after}");
}

#[test]
fn every_parameter_of_a_scenario_changes_the_motion() {
    let mut steady = excavator();
    for axis in 0..4 {
        plant_of(&mut steady, axis).external_leakage = 1e-12;
    }
    let run = |machine: &Machine| {
        let mut sim = simulate(machine);
        hold(&mut sim, 0.4, 0.5);
        hold(&mut sim, -0.4, 0.5);
        sim.axes()[0].position
    };
    let unchanged = run(&steady);
    // Payload and soil belong to a mechanism, which this machine does not have.
    let without = [Parameter::Payload, Parameter::Soil];
    for parameter in Parameter::all().filter(|parameter| !without.contains(parameter)) {
        let mut machine = steady.clone();
        let to = match parameter {
            Parameter::Temperature => 20.0,
            Parameter::PumpFlow => 0.2,
            _ => 0.7,
        };
        machine.scenario.changes = vec![Change { axis: None, parameter, start: 0.1, end: 0.2, to }];
        let changed = run(&machine);
        assert!(changed.is_finite() && (changed - unchanged).abs() > 1e-7, "{parameter:?}: {changed} {unchanged}");
    }
}

#[test]
fn a_change_acts_in_the_step_in_which_it_happens() {
    let mut machine = excavator();
    let pushed = Change { axis: Some(0), parameter: Parameter::ExternalForce, start: 0.0105, end: 0.0105, to: 0.5 };
    machine.scenario.changes = vec![pushed];
    let mut sim = simulate(&machine);
    sim.advance(Duration::from_micros(10_500));
    assert!(sim.axes()[0].velocity.abs() < 1e-5, "{:?}", sim.axes()[0]);
    sim.advance(STEP);
    assert!(sim.axes()[0].velocity < -1e-4, "{:?}", sim.axes()[0]);
}

#[test]
fn a_ramp_has_no_stairs() {
    let mut machine = excavator();
    let sag = Change { axis: None, parameter: Parameter::SupplyPressure, start: 0.0, end: 1.0, to: 0.5 };
    machine.scenario.changes = vec![sag];
    let mut sim = simulate(&machine);
    for step in 1..9999 {
        sim.advance(STEP);
        let expected = 25e6 * (1.0 - 0.5e-4 * f64::from(step));
        let found = sim.supply_pressure();
        // Half a step of the ramp is 625 Pa.
        assert!((found - expected).abs() < 630.0, "step {step}: {found} Pa, not {expected} Pa");
    }
}

/// The load pulls the piston out against the pump, because the rod side leaks more than the pump gives. The piston side
/// draws oil back through its edge.
#[test]
fn the_pressure_left_is_never_below_that_of_a_chamber_that_is_fed() {
    let mut machine = excavator();
    machine.axes.truncate(1);
    machine.hydraulics.as_mut().unwrap().supply.flow = 1e-4;
    let plant = plant_of(&mut machine, 0);
    plant.load_force = LoadForce::constant(-2e5);
    plant.external_leakage = 1e-10;
    plant.initial_position = 0.1;
    let mut sim = simulate(&machine);
    let mut steps_with_back_flow = 0;
    for _ in 0..10_000 {
        sim.command(&all(-1.0));
        sim.advance(STEP);
        let (state, left) = (sim.axes()[0], sim.supply_pressure());
        if state.rod_flow < 0.0 {
            assert!(left >= state.rod_pressure, "{left} Pa are left: {state:?}");
            steps_with_back_flow += u32::from(state.piston_flow > 0.0);
        }
    }
    assert!(steps_with_back_flow > 1000, "{steps_with_back_flow}");
}
