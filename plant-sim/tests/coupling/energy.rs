//! Conservation of energy.

use pipeline::machine::{Directions, Ports, SupplyKind};
use plant_sim::plant::energy::{EnergyObserver, Power};

use super::*;

/// Energy that went each way, J, by the trapezoidal rule.
fn add(sum: &mut Power, before: &Power, after: &Power, step: f64) {
    let half = 0.5 * step;
    sum.pump += half * (before.pump + after.pump);
    sum.oil += half * (before.oil + after.oil);
    sum.valves += half * (before.valves + after.valves);
    sum.leakage += half * (before.leakage + after.leakage);
    sum.ports += half * (before.ports + after.ports);
    sum.friction += half * (before.friction + after.friction);
    sum.stops += half * (before.stops + after.stops);
    sum.external += half * (before.external + after.external);
    sum.soil += half * (before.soil + after.soil);
}

/// Balance of a minute of mixed motion: what came in less what went out and what is stored, J, and the turnover, J.
fn imbalance(machine: &Machine) -> (f64, f64) {
    let mut sim = simulate(machine);
    let observer = EnergyObserver::new(&sim);
    let (mut before, begin) = observer.observe(&sim);
    let start = positions(&sim);
    let (mut sum, mut turnover) = (Power::default(), 0.0);
    let step = STEP.as_secs_f64();
    for i in 0..600_000 {
        // Drawn back to the start: the stops are so stiff that the sum below would not see how they push.
        let (motion, now) = (mixed(step * f64::from(i)), positions(&sim));
        sim.command(&commands(std::array::from_fn(|axis| 0.7 * motion[axis] - (now[axis] - start[axis]))));
        sim.advance(STEP);
        let (after, _) = observer.observe(&sim);
        add(&mut sum, &before, &after, step);
        turnover += step * (after.pump.abs() + after.soil.abs());
        before = after;
    }
    let end = observer.observe(&sim).1;
    println!("{sum:?}\n{begin:?}\n{end:?}");
    assert!(sum.valves > 0.0 && sum.leakage > 0.0 && sum.ports >= 0.0 && sum.friction > 0.0 && sum.soil >= 0.0);
    assert_eq!(sum.stops, 0.0);
    (sum.growth() - (end.total() - begin.total()), turnover)
}

#[test]
fn the_work_of_the_pump_is_lost_or_stored() {
    let mut digging = excavator();
    digging.soil = Some(loam(0.5));
    digging.scenario.changes = vec![step_to(Parameter::Soil, 0.0, 1.0)];
    let mut sensing = excavator();
    sensing.hydraulics.as_mut().unwrap().supply.kind = SupplyKind::LoadSensing { margin: 2e6, response_time: 0.1 };
    let mut block = excavator();
    for (axis, plant) in plants(&mut block).enumerate() {
        plant.ports = Ports {
            meter_out: Directions::both(0.4),
            regeneration: Directions::both(if axis == 1 { 0.3 } else { 0.0 }),
            spool_leakage: 1e-13,
            piston_hose_volume: 2e-3,
            rod_hose_volume: 2e-3,
            ..Ports::NONE
        };
    }
    let cases = [("air", excavator()), ("soil", digging), ("load-sensing", sensing), ("valve block", block)];
    for (name, machine) in cases {
        let (lost, turnover) = imbalance(&machine);
        println!("{name}: {lost:+.3} J of {turnover:.0} J, {:.2e}", lost / turnover);
        assert!(turnover > 5e5 && lost.abs() < 1e-6 * turnover, "{name}: {lost} J of {turnover} J");
    }
}

#[test]
fn a_linkage_that_swings_on_oil_without_friction_keeps_its_energy() {
    let mut machine = excavator();
    without_leakage(&mut machine);
    for plant in plants(&mut machine) {
        (plant.coulomb_friction, plant.static_friction, plant.viscous_friction) = (0.0, 0.0, 0.0);
        (plant.bristle_stiffness, plant.bristle_damping) = (0.0, 0.0);
        // So much oil is a soft spring: the linkage swings slowly, and far enough to change its posture.
        (plant.piston_dead_volume, plant.rod_dead_volume) = (1.0, 1.0);
    }
    machine.scenario.changes = vec![step_to(Parameter::Payload, 1e-3, 1000.0)];
    let mut sim = simulate(&machine);
    sim.advance(Duration::from_millis(2));
    let observer = EnergyObserver::new(&sim);
    let begin = observer.observe(&sim).1;
    let (mut least, mut most) = (positions(&sim), positions(&sim));
    let (mut swung, mut worst) = (0.0f64, 0.0f64);
    for _ in 0..1000 {
        sim.advance(Duration::from_millis(10));
        let now = observer.observe(&sim).1;
        swung = swung.max(now.kinetic);
        worst = worst.max((now.total() - begin.total()).abs());
        for (axis, position) in positions(&sim).into_iter().enumerate() {
            least[axis] = least[axis].min(position);
            most[axis] = most[axis].max(position);
        }
    }
    let travel: Vec<f64> = (0..AXES).map(|axis| most[axis] - least[axis]).collect();
    println!("{worst:.2e} J of {swung:.0} J in 10 s, {:.1e}; travel {travel:.3?} m", worst / swung);
    assert!(travel.iter().all(|travel| *travel > 0.03) && swung > 1e3, "{travel:?} {swung}");
    assert!(worst < 1e-9 * swung, "{worst} J of {swung} J");
}
