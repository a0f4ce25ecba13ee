//! The excavator with the hydraulics of such a machine: a load-sensing pump, narrow edges to the tank, regeneration on
//! the arm, a spool that leaks, a valve that holds the boom, hoses.

use pipeline::machine::{Directions, LoadHolding, Ports, SupplyKind};

use super::{halving::apart_at_half_the_step, *};

/// The excavator with these hydraulics.
fn hydraulic(scenario: &str) -> Machine {
    let mut machine = under(scenario);
    let supply = &mut machine.hydraulics.as_mut().unwrap().supply;
    supply.kind = SupplyKind::LoadSensing { margin: 2e6, response_time: 0.1 };
    (supply.pressure, supply.power) = (34e6, Some(110e3));
    for (axis, plant) in plants(&mut machine).enumerate() {
        plant.ports = Ports {
            meter_out: Directions::both(0.4),
            regeneration: Directions { extend: if axis == 1 { 0.4 } else { 0.0 }, retract: 0.0 },
            spool_leakage: 1e-12,
            load_holding: if axis == 0 { LoadHolding::Piston } else { LoadHolding::None },
            piston_hose_volume: 2e-3,
            rod_hose_volume: 2e-3,
            ..Ports::NONE
        };
        plant.hysteresis = 0.04;
    }
    machine
}

#[test]
fn half_the_step_moves_no_cylinder_by_a_tenth_of_a_millimetre() {
    for scenario in ["nominal", "everything"] {
        for into_stops in [false, true] {
            let apart = apart_at_half_the_step(&hydraulic(scenario), into_stops);
            println!("{scenario:16} stops {into_stops:5}: {:.2?} um", apart.map(|apart| 1e6 * apart));
            assert!(apart.iter().all(|apart| *apart < 1e-4), "{scenario}, {into_stops}: {apart:?}");
        }
    }
}

/// Time in which the boom rises from 0.75 to 0.85 m under a constant command, s, and the pump's mean pressure, Pa.
fn lift(payload: f64) -> (f64, f64) {
    let mut machine = hydraulic("nominal");
    machine.mechanism.as_mut().unwrap().masses.payload.mass = payload;
    let mut sim = simulate(&machine);
    let (mut begin, mut pressure, mut steps) = (None, 0.0, 0.0);
    for i in 0..80_000 {
        sim.command(&commands([0.4, 0.0, 0.0, 0.0]));
        sim.advance(STEP);
        let (time, position) = (STEP.as_secs_f64() * f64::from(i), positions(&sim)[0]);
        if position > 0.75 {
            let begin = *begin.get_or_insert(time);
            pressure += sim.supply_pressure();
            steps += 1.0;
            if position > 0.85 {
                return (time - begin, pressure / steps);
            }
        }
    }
    panic!("the boom does not rise: {:?}", sim.axes()[0]);
}

#[test]
fn a_payload_changes_the_speed_of_the_boom_by_less_than_two_percent() {
    let (empty, loaded) = (lift(0.0), lift(1500.0));
    let change = empty.0 / loaded.0 - 1.0;
    println!(
        "1.5 t change the speed by {:+.2} %, the pressure from {:.3e} to {:.3e} Pa",
        100.0 * change,
        empty.1,
        loaded.1
    );
    assert!(change.abs() < 0.02, "{change}");
    assert!(loaded.1 - empty.1 > 2e6, "{} and {} Pa", empty.1, loaded.1);
}
