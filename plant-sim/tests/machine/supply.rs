//! The pump: with load-sensing a load changes the pressure, not the speed.

use pipeline::machine::SupplyKind;

use super::*;

const MARGIN: f64 = 2e6;

/// The built-in machine with a load-sensing pump that has enough flow, and loads that do not change.
fn load_sensing() -> Machine {
    let mut machine = excavator();
    let supply = &mut machine.hydraulics.as_mut().unwrap().supply;
    supply.kind = SupplyKind::LoadSensing { margin: MARGIN, response_time: 0.05 };
    supply.flow = 20e-3;
    for axis in 0..4 {
        let plant = plant_of(&mut machine, axis);
        plant.load_force = LoadForce::constant(plant.load_force.middle);
        plant.initial_position = 0.1;
        plant.internal_leakage = 0.0;
    }
    machine
}

/// Means over a second of motion, after the start has rung out.
struct Means {
    speeds: Vec<f64>,
    /// Of the boom's piston side, Pa.
    chamber: f64,
    /// Pressure that is left, Pa.
    supply: f64,
    flow: f64,
}

fn run(machine: &Machine, command: f64) -> Means {
    let mut sim = simulate(machine);
    hold(&mut sim, command, 4.0);
    let begin: Vec<f64> = sim.axes().iter().map(|state| state.position).collect();
    let (mut chamber, mut supply, mut flow) = (0.0, 0.0, 0.0);
    for _ in 0..100 {
        hold(&mut sim, command, 0.01);
        chamber += 0.01 * sim.axes()[0].piston_pressure;
        supply += 0.01 * sim.supply_pressure();
        flow += 0.01 * sim.axes().iter().map(|state| state.piston_flow).sum::<f64>();
    }
    let speeds = sim.axes().iter().zip(begin).map(|(state, begin)| state.position - begin).collect();
    Means { speeds, chamber, supply, flow }
}

#[test]
fn a_payload_changes_the_pressure_and_not_the_speed() {
    let [empty, loaded] = [120e3, 250e3].map(|load| {
        let mut machine = load_sensing();
        machine.axes.truncate(1);
        plant_of(&mut machine, 0).load_force = LoadForce::constant(load);
        run(&machine, 0.5)
    });
    let change = loaded.speeds[0] / empty.speeds[0] - 1.0;
    println!("the payload changes the speed by {:.3} %", 100.0 * change);
    assert!(change.abs() < 0.02, "{change}");
    for means in [&empty, &loaded] {
        let (supply, chamber) = (means.supply, means.chamber);
        assert!((supply - chamber - MARGIN).abs() < 0.02 * MARGIN, "{supply} and {chamber} Pa");
    }
    let (risen, expected) = (loaded.chamber - empty.chamber, (250e3 - 120e3) / 0.0226);
    assert!((risen / expected - 1.0).abs() < 0.02, "{risen} for {expected} Pa");
}

#[test]
fn at_the_margin_the_speed_is_that_of_the_rated_pressure_drop() {
    let machine = load_sensing();
    for (axis, speed) in machine.axes.iter().zip(run(&machine, 0.4).speeds) {
        let plant = axis.plant.as_ref().unwrap();
        let opening = (0.4 - 0.5 * plant.hysteresis - plant.dead_band.extend) / (1.0 - plant.dead_band.extend);
        let expected = plant.rated_flow * opening / plant.piston_area;
        println!("{}: {speed:.5} m/s for {expected:.5} m/s", axis.name);
        assert!((speed / expected - 1.0).abs() < 0.005, "{}: {speed}", axis.name);
    }
}

#[test]
fn short_of_flow_or_power_all_axes_slow_down_by_the_same_part() {
    let enough = run(&load_sensing(), 0.4);
    let mut short = load_sensing();
    short.hydraulics.as_mut().unwrap().supply.flow = 0.6 * enough.flow;
    let mut weak = load_sensing();
    // The pump's pressure follows the highest load, and the sag is less than the margin.
    weak.hydraulics.as_mut().unwrap().supply.power = Some(0.6 * enough.flow * enough.supply);
    for (machine, least, most) in [(short, 0.598, 0.602), (weak, 0.598, 0.75)] {
        let means = run(&machine, 0.4);
        let parts: Vec<f64> = means.speeds.iter().zip(&enough.speeds).map(|(some, all)| some / all).collect();
        println!("{parts:?}, {} Pa are left of {} Pa", means.supply, enough.supply);
        assert!(parts.iter().all(|part| (part - parts[0]).abs() < 0.003 && (least..most).contains(part)), "{parts:?}");
        assert!(means.supply < enough.supply);
        if let Some(power) = machine.hydraulics.unwrap().supply.power {
            let delivered = means.flow * means.supply;
            assert!((delivered / power - 1.0).abs() < 0.001, "{delivered} W for {power} W");
        }
    }
}

#[test]
fn a_load_waits_until_the_pump_has_passed_its_pressure() {
    let mut machine = load_sensing();
    machine.axes.truncate(1);
    let plant = plant_of(&mut machine, 0);
    plant.dead_time = 0.0;
    plant.valve_time_constant = 1e-3;
    // Seals that hardly give way keep the pressure while the rod side is relieved.
    (plant.static_friction, plant.coulomb_friction, plant.bristle_stiffness) = (1e6, 1e6, 1e10);
    let mut sim = simulate(&machine);
    let load = sim.axes()[0].piston_pressure;
    let idle = sim.supply_pressure();
    assert_eq!(idle, 3e5 + MARGIN);
    let mut time = 0.0;
    while sim.axes()[0].piston_flow == 0.0 {
        sim.command(&all(1.0));
        sim.advance(STEP);
        time += STEP.as_secs_f64();
        assert!(time < 1.0);
    }
    let expected = 0.05 * ((load + MARGIN - idle) / MARGIN).ln();
    println!("{time} s for {expected} s");
    assert!((time - expected).abs() < 1e-3, "{time} s for {expected} s");
}
