//! The error of integration: half the step changes no position much.

use std::thread;

use pipeline::machine::Scenario;

use super::*;

/// Positions at every tick of 20 s, with full commands into the stops or with mixed ones.
fn run(machine: &Machine, step_ns: u64, into_stops: bool) -> Vec<[f64; AXES]> {
    let mut sim = PlantSim::with_step(machine, 1, step_ns).unwrap_or_else(|error| panic!("{error}"));
    let tick = |i: u32| {
        let time = 0.01 * f64::from(i);
        let full = [7.0, 5.0, 3.0, 2.0].map(|period: f64| if time % period < 0.5 * period { 1.0 } else { -1.0 });
        sim.command(&commands(if into_stops { full } else { mixed(time) }));
        sim.advance(Duration::from_millis(10));
        positions(&sim)
    };
    (0..2000).map(tick).collect()
}

/// Largest distance of each position from that at half the step, m.
pub fn apart_at_half_the_step(machine: &Machine, into_stops: bool) -> [f64; AXES] {
    let (whole, half) = (run(machine, 100_000, into_stops), run(machine, 50_000, into_stops));
    std::array::from_fn(|axis| whole.iter().zip(&half).map(|(a, b)| (a[axis] - b[axis]).abs()).fold(0.0, f64::max))
}

#[test]
fn half_the_step_moves_no_cylinder_by_a_tenth_of_a_millimetre_under_any_scenario() {
    let cases =
        Scenario::built_in().into_iter().flat_map(|scenario| [false, true].map(|stops| (scenario.name.clone(), stops)));
    thread::scope(|scope| {
        let check = |scenario: String, into_stops: bool| {
            let mut machine = under(&scenario);
            if scenario == "digging" {
                machine.soil = Some(loam(0.5));
            }
            let apart = apart_at_half_the_step(&machine, into_stops);
            println!("{scenario:16} stops {into_stops:5}: {:.2?} um", apart.map(|apart| 1e6 * apart));
            assert!(apart.iter().all(|apart| *apart < 1e-4), "{scenario}, {into_stops}: {apart:?}");
        };
        let runs: Vec<_> = cases.map(|(scenario, stops)| scope.spawn(move || check(scenario, stops))).collect();
        runs.into_iter().for_each(|run| run.join().unwrap());
    });
}
