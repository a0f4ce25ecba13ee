//! Soil at the teeth of the moving excavator.

use super::*;

/// Distance by which the arm draws the teeth in, m, through soil of a strength.
fn drawn_in(strength: f64) -> f64 {
    let mut machine = excavator();
    let prepared = mechanism().prepared();
    let tip = |sim: &PlantSim| prepared.pose(&positions(sim)).tip;
    let level = tip(&simulate(&machine)).z + 0.3;
    machine.soil = Some(loam(level));
    machine.scenario.changes = vec![step_to(Parameter::Soil, 0.0, strength)];
    let mut sim = simulate(&machine);
    let begin = tip(&sim);
    for _ in 0..100 {
        sim.command(&commands([0.0, 0.35, 0.0, 0.0]));
        sim.advance(Duration::from_millis(10));
    }
    begin.x - tip(&sim).x
}

#[test]
fn soil_slows_the_arm_and_its_strength_comes_from_the_scenario() {
    let [air, soft, hard] = [0.0, 0.5, 2.0].map(drawn_in);
    println!("drawn in by {air:.4} m in air, {soft:.4} m and {hard:.4} m in soil");
    assert!(air > 0.1 && soft < 0.995 * air && hard < 0.99 * soft, "{air} {soft} {hard}");
}

#[test]
fn soil_takes_the_place_of_external_forces() {
    let mut machine = under("digging");
    machine.soil = Some(loam(-50.0)); // far below the teeth
    let mut free = machine.clone();
    free.scenario.changes.clear();
    let run = |machine: &Machine| {
        let mut sim = simulate(machine);
        sim.advance(Duration::from_secs(12));
        positions(&sim)
    };
    assert_eq!(run(&machine), run(&free));
    machine.soil = None;
    assert_ne!(run(&machine), run(&free));
}
