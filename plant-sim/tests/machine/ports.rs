//! Edges, valves and hoses between spool and cylinder compared with closed formulas.

use pipeline::machine::{Directions, LoadHolding};
use plant_sim::TrueState;

use super::*;

/// The boom alone, with the constant load `load` N and no friction but viscous friction.
fn boom(load: f64) -> Machine {
    let mut machine = excavator();
    machine.axes.truncate(1);
    machine.hydraulics.as_mut().unwrap().supply.flow = 1.0;
    let plant = plant_of(&mut machine, 0);
    plant.load_force = LoadForce::constant(load);
    (plant.coulomb_friction, plant.static_friction) = (0.0, 0.0);
    (plant.bristle_stiffness, plant.bristle_damping) = (0.0, 0.0);
    plant.internal_leakage = 0.0;
    machine
}

/// Mean speed after the start has rung out, m/s, and mean pressures of piston and rod side, Pa.
fn steady(machine: &Machine, command: f64) -> (f64, [f64; 2]) {
    let from = if command > 0.0 { 0.05 } else { machine.axes[0].stroke - 0.05 };
    steady_from(machine, command, from)
}

/// Means as of [`steady`] for an axis that starts at `from` m.
fn steady_from(machine: &Machine, command: f64, from: f64) -> (f64, [f64; 2]) {
    let mut machine = machine.clone();
    plant_of(&mut machine, 0).initial_position = from;
    let mut sim = simulate(&machine);
    hold(&mut sim, command, 2.5);
    let (begin, mut pressures) = (sim.axes()[0].position, [0.0; 2]);
    for _ in 0..50 {
        hold(&mut sim, command, 0.01);
        pressures[0] += 0.02 * sim.axes()[0].piston_pressure;
        pressures[1] += 0.02 * sim.axes()[0].rod_pressure;
    }
    ((sim.axes()[0].position - begin) / 0.5, pressures)
}

/// k X of the boom under `command`.
fn opening(plant: &Plant, command: f64) -> f64 {
    let dead_band = if command > 0.0 { plant.dead_band.extend } else { plant.dead_band.retract };
    let spool = command.abs() - 0.5 * plant.hysteresis;
    plant.rated_flow / plant.rated_pressure_drop.sqrt() * (spool - dead_band) / (1.0 - dead_band)
}

/// With s = (w/(k X))^2, extension has p1 = p_s - A1^2 s and p2 = p_0 + (A2/m)^2 s; retraction is its mirror image.
#[test]
fn a_narrow_edge_to_the_tank_slows_the_axis_by_the_formula() {
    for (command, meter_out) in [(0.5, 0.3), (0.5, 0.6), (-0.4, 0.3), (-0.4, 1.0)] {
        let mut machine = boom(1e5);
        let supply = machine.hydraulics.unwrap().supply;
        let plant = plant_of(&mut machine, 0);
        // The other direction stays as it is.
        plant.ports.meter_out = Directions::both(1.0);
        let narrowed = &mut plant.ports.meter_out;
        *(if command > 0.0 { &mut narrowed.extend } else { &mut narrowed.retract }) = meter_out;
        let (a1, a2, edge) = (plant.piston_area, plant.rod_area, opening(plant, command));
        let viscous = plant.viscous_friction;
        let (feeds, drains, load) = if command > 0.0 { (a1, a2, 1e5) } else { (a2, a1, -1e5) };
        let mut speed = 0.0;
        for _ in 0..100 {
            let force = feeds * supply.pressure - drains * supply.return_pressure - load - viscous * speed;
            speed = edge * (force / (feeds.powi(3) + drains.powi(3) / (meter_out * meter_out))).sqrt();
        }
        let found = steady(&machine, command).0.abs();
        println!("m = {meter_out}, {command:+}: {found:.5} m/s for {speed:.5} m/s");
        assert!((found / speed - 1.0).abs() < 0.005, "{found} for {speed}");
    }
}

/// A load that pushes the piston in while the pump gives nothing. With s = (w/(k X))^2 the rod side is fed through the
/// regenerating edge alone, and the rest of the oil goes to the tank:
///
/// ```text
/// p1 = p_0 + ((A1 - A2)/m)^2 s      p2 = p1 - (A2/r)^2 s      A1 p1 - A2 p2 = F - B_p w
/// s = (F - B_p w - (A1 - A2) p_0)/((A1 - A2)^3/m^2 + A2^3/r^2)
/// ```
#[test]
fn a_load_sinks_on_its_own_oil_by_the_formula_of_regeneration() {
    let (load, command) = (3e5, -0.3);
    let mut machine = boom(load);
    machine.hydraulics.as_mut().unwrap().supply.flow = 1e-6;
    let return_pressure = machine.hydraulics.unwrap().supply.return_pressure;
    let plant = plant_of(&mut machine, 0);
    plant.ports.regeneration = Directions { extend: 0.0, retract: 0.5 };
    plant.ports.meter_out = Directions { extend: 1.0, retract: 0.4 };
    let (a1, a2, edge, viscous) = (plant.piston_area, plant.rod_area, opening(plant, command), plant.viscous_friction);
    let (left, mut speed, mut s) = (a1 - a2, 0.0, 0.0);
    for _ in 0..100 {
        s = (load - viscous * speed - left * return_pressure) / (left.powi(3) / 0.16 + a2.powi(3) / 0.25);
        speed = edge * f64::sqrt(s);
    }
    let p1 = return_pressure + left.powi(2) / 0.16 * s;
    let p2 = p1 - a2.powi(2) / 0.25 * s;
    let (found, pressures) = steady(&machine, command);
    println!("{found:.5} m/s for {speed:.5} m/s; {pressures:?} Pa for {p1:.0}, {p2:.0} Pa");
    assert!((found / -speed - 1.0).abs() < 0.005);
    assert!((pressures[0] / p1 - 1.0).abs() < 0.005 && (pressures[1] / p2 - 1.0).abs() < 0.02);

    // Without the edge the rod side has to draw its oil from the tank.
    plant_of(&mut machine, 0).ports.regeneration = Directions::both(0.0);
    assert!(steady(&machine, command).1[1] < 0.0);
}

/// A load pulls the piston out faster than the pump can fill its side. The counterbalance valve lets it go as fast as
/// the pump fills: w = Q/A1 with the opening o = A2 w/(k X f(p2 - p_0)), at p2 + R p1 = (1 + 0.2 o) p_cb.
#[test]
fn a_load_does_not_run_ahead_of_the_pump_with_a_counterbalance_valve() {
    let (load, command, setting, ratio) = (-1.5e5, 0.5, 18e6, 0.5);
    let mut machine = boom(load);
    machine.hydraulics.as_mut().unwrap().supply.flow = 2e-3;
    let return_pressure = machine.hydraulics.unwrap().supply.return_pressure;
    let (runaway, torn) = steady(&machine, command);
    let plant = plant_of(&mut machine, 0);
    plant.ports.counterbalance = Directions { extend: setting, retract: 0.0 };
    plant.ports.pilot_ratio = ratio;
    let (a1, a2, edge, viscous) = (plant.piston_area, plant.rod_area, opening(plant, command), plant.viscous_friction);
    let speed = 2e-3 / a1;
    let (mut p1, mut p2) = (0.0, setting);
    for _ in 0..100 {
        let open = a2 * speed / (edge * f64::sqrt(p2 - return_pressure));
        // A1 p1 - A2 p2 = F + B_p w.
        p1 = ((1.0 + 0.2 * open) * setting + (load + viscous * speed) / a2) / (a1 / a2 + ratio);
        p2 = (a1 * p1 - load - viscous * speed) / a2;
    }
    let (found, pressures) = steady_from(&machine, command, 0.6);
    println!(
        "{runaway:.5} and {found:.5} m/s for {speed:.5} m/s; {torn:?} and {pressures:?} Pa for {p1:.0}, {p2:.0} Pa"
    );
    assert!(runaway > 1.2 * speed && torn[0] < 0.0, "without the valve the load runs ahead");
    assert!((found / speed - 1.0).abs() < 0.005, "{found} for {speed}");
    assert!((pressures[0] / p1 - 1.0).abs() < 0.02 && (pressures[1] / p2 - 1.0).abs() < 0.02, "{pressures:?}");
}

#[test]
fn a_counterbalance_valve_holds_its_load_without_the_pump_and_opens_fully_for_a_load_that_is_lifted() {
    let mut machine = boom(-1.5e5);
    machine.hydraulics.as_mut().unwrap().supply.flow = 1e-6;
    plant_of(&mut machine, 0).ports.counterbalance = Directions { extend: 18e6, retract: 0.0 };
    let mut sim = simulate(&machine);
    hold(&mut sim, 0.8, 2.0);
    let moved = sim.axes()[0].position - machine.axes[0].plant.as_ref().unwrap().initial_position;
    println!("{moved} m in 2 s");
    assert!(moved.abs() < 5e-3, "{moved} m");

    let mut lifting = boom(4.8e5);
    let without = steady(&lifting, 0.5);
    let ports = &mut plant_of(&mut lifting, 0).ports;
    (ports.counterbalance, ports.pilot_ratio) = (Directions { extend: 12e6, retract: 0.0 }, 3.0);
    assert_eq!(steady(&lifting, 0.5), without);
}

/// Speed of a loaded axis with a shut valve, as in the tests of the axes at rest, with the leakage of the spool.
fn creep(machine: &Machine, state: &TrueState) -> f64 {
    let plant = machine.axes[0].plant.as_ref().unwrap();
    let (a1, a2) = (plant.piston_area, plant.rod_area);
    let (p1, p2) = (state.piston_pressure, state.rod_pressure);
    let c1 = (plant.piston_dead_volume + a1 * state.position) * compressibility(machine, p1);
    let rod_volume = plant.rod_dead_volume + a2 * (machine.axes[0].stroke - state.position);
    let c2 = rod_volume * compressibility(machine, p2);
    let internal = plant.internal_leakage * (p1 - p2);
    let spool = |p: f64| plant.ports.spool_leakage * (p - machine.hydraulics.unwrap().supply.return_pressure);
    -(a1 * (internal + spool(p1)) / c1 + a2 * (internal - spool(p2)) / c2) / (a1 * a1 / c1 + a2 * a2 / c2)
}

#[test]
fn a_loaded_boom_sinks_by_the_leakage_of_its_spool() {
    for (spool, sinks) in [(0.0, false), (1e-12, true)] {
        let mut machine = boom(1.2e5);
        let plant = plant_of(&mut machine, 0);
        (plant.internal_leakage, plant.ports.spool_leakage) = (2e-13, spool);
        let mut sim = simulate(&machine);
        sim.advance(Duration::from_secs(30));
        let (begin, mut expected) = (sim.axes()[0].position, 0.0);
        for _ in 0..3000 {
            let before = creep(&machine, &sim.axes()[0]);
            sim.advance(TICK);
            expected += 0.005 * (before + creep(&machine, &sim.axes()[0]));
        }
        let drift = sim.axes()[0].position - begin;
        println!("C_s = {spool:e}: {:+.4} mm in 30 s, formula {:+.4} mm", 1e3 * drift, 1e3 * expected);
        assert_eq!(drift < 0.0, sinks, "{drift}");
        assert!((drift / expected - 1.0).abs() < 0.02, "{drift} for {expected}");
    }
}

#[test]
fn a_load_holding_valve_keeps_a_boom_from_sinking() {
    let mut machine = boom(1.2e5);
    let ports = &mut plant_of(&mut machine, 0).ports;
    (ports.spool_leakage, ports.load_holding) = (1e-11, LoadHolding::Piston);
    let mut sim = simulate(&machine);
    // The rod side empties into the return line first.
    sim.advance(Duration::from_secs(60));
    let settled = sim.axes()[0];
    assert!((settled.rod_pressure / machine.hydraulics.unwrap().supply.return_pressure - 1.0).abs() < 1e-3);
    sim.advance(Duration::from_secs(60));
    let drift = sim.axes()[0].position - settled.position;
    println!("{drift:e} m in 60 s");
    assert!(drift.abs() < 1e-7, "{drift:e} m");
}

#[test]
fn keys_without_what_they_belong_to_change_no_bits() {
    let run = |change: fn(&mut Plant)| {
        let mut machine = excavator();
        (0..4).for_each(|axis| change(plant_of(&mut machine, axis)));
        let mut sim = simulate(&machine);
        for command in [0.9, -0.4, 0.13] {
            hold(&mut sim, command, 1.0);
        }
        sim.axes().to_vec()
    };
    let plain = run(|_| ());
    assert_eq!(plain, run(|plant| plant.ports.load_holding = LoadHolding::Both), "no leakage to keep");
    assert_eq!(plain, run(|plant| plant.ports.hose_modulus = 1e8), "no hose");
    assert_ne!(plain, run(|plant| plant.ports.piston_hose_volume = 1e-3));
}
