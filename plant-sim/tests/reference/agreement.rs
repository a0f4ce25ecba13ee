//! Distance between the positions of simulator and reference.

use std::{thread, time::Duration};

use pipeline::{
    machine::{Directions, LoadForce, LoadHolding, Machine, Plant, Ports, Scenario, SupplyKind, ValveCurve},
    message::ValveCommand,
};
use plant_sim::PlantSim;

use super::{commands::commands, machine::Reference};

/// Time between two commands and between two comparisons, ns.
const TICK: u64 = 10_000_000;

/// Number of ticks of a run: 20 s.
const TICKS: u64 = 2000;

/// Largest distance between a position and that of the reference, m.
const BOUND: f64 = 5e-5;

/// Largest change of a position when the step is halved, m.
const HALVING_BOUND: f64 = 1e-4;

/// Largest change of a position when the tolerance of the reference is divided by a hundred, m.
const TOLERANCE_BOUND: f64 = 1e-6;

/// Half the simulator's step, ns.
const HALF_STEP: u64 = 50_000;

/// Dead volumes of either side of four small cylinders, cm3.
const SMALL_VOLUMES: [u32; 4] = [400, 200, 100, 80];

/// A simulation that is run tick by tick: the simulator or the reference.
trait Run {
    fn tick(&mut self, commands: &[f64]) -> Vec<f64>;
}

impl Run for PlantSim {
    fn tick(&mut self, commands: &[f64]) -> Vec<f64> {
        let mut message = ValveCommand::default();
        message.axes.iter_mut().zip(commands).for_each(|(axis, command)| axis.command = *command);
        self.command(&message);
        self.advance(Duration::from_nanos(TICK));
        self.axes().iter().map(|axis| axis.position).collect()
    }
}

impl Run for Reference {
    fn tick(&mut self, commands: &[f64]) -> Vec<f64> {
        self.command(commands);
        self.advance(TICK);
        self.positions().collect()
    }
}

/// Positions of every axis at every tick.
fn run(machine: &Machine, mut run: impl Run) -> Vec<Vec<f64>> {
    let commands = |tick| commands(&machine.scenario, machine.axes.len(), (tick * TICK) as f64 * 1e-9);
    (0..TICKS).map(|tick| run.tick(&commands(tick))).collect()
}

/// Largest distance between two runs, m, axis by axis.
fn apart(one: &[Vec<f64>], other: &[Vec<f64>]) -> Vec<f64> {
    let mut worst = vec![0.0; one[0].len()];
    for (one, other) in one.iter().zip(other) {
        for (worst, (one, other)) in worst.iter_mut().zip(one.iter().zip(other)) {
            // A position that is not a number counts as infinitely far.
            let distance = if (one - other).is_finite() { (one - other).abs() } else { f64::INFINITY };
            *worst = f64::max(*worst, distance);
        }
    }
    worst
}

/// Largest figures of one axis in one run, m.
struct Figures {
    run: String,
    axis: String,
    /// Distance between simulator and reference.
    error: f64,
    /// Distance between the simulator and itself at half the step.
    halving: f64,
    /// Distance between the reference and itself at a hundredth of its tolerance.
    tolerance: f64,
    /// Largest less smallest position.
    travel: f64,
}

/// Runs `machine` in simulator and reference.
fn figures(machine: &Machine, name: &str) -> Vec<Figures> {
    let simulated = run(machine, PlantSim::new(machine, 1).unwrap());
    let reference = run(machine, Reference::new(machine, 1.0));
    let halving = apart(&simulated, &run(machine, PlantSim::with_step(machine, 1, HALF_STEP).unwrap()));
    let tight = run(machine, Reference::new(machine, 100.0));
    let (error, tolerance) = (apart(&simulated, &reference), apart(&reference, &tight));
    let of = |axis: usize| {
        let positions = || tight.iter().map(|positions| positions[axis]);
        Figures {
            run: name.to_owned(),
            axis: machine.axes[axis].name.clone(),
            error: error[axis],
            halving: halving[axis],
            tolerance: tolerance[axis],
            travel: positions().fold(0.0, f64::max) - positions().fold(f64::INFINITY, f64::min),
        }
    };
    (0..machine.axes.len()).map(of).collect()
}

/// Prints the figures as a table and compares them with their bounds.
fn check(figures: &[Figures]) {
    println!("{:18} {:10} {:>9} {:>9} {:>9} {:>9}", "um", "axis", "error", "half step", "tolerance", "travel mm");
    for Figures { run, axis, error, halving, tolerance, travel } in figures {
        let [error, halving, tolerance] = [error, halving, tolerance].map(|distance| 1e6 * distance);
        println!("{run:18} {axis:10} {error:9.3} {halving:9.3} {tolerance:9.5} {:9.1}", 1e3 * travel);
    }
    for Figures { run, axis, error, halving, tolerance, .. } in figures {
        assert!(*tolerance < TOLERANCE_BOUND, "{run}, {axis}: the reference itself is not accurate, {tolerance} m");
        assert!(*error < BOUND, "{run}, {axis}: {error} m from the reference");
        assert!(*halving < HALVING_BOUND, "{run}, {axis}: half the step changes {halving} m");
    }
}

fn under(scenario: &str) -> Machine {
    Machine::four_axes(&[("scenario".to_owned(), scenario.to_owned())]).unwrap()
}

#[test]
fn the_built_in_machine_is_within_the_bounds_under_every_scenario() {
    let figures: Vec<Figures> = thread::scope(|scope| {
        let scenarios = Scenario::built_in().into_iter();
        let runs = scenarios.map(|scenario| scope.spawn(move || figures(&under(&scenario.name), &scenario.name)));
        let runs: Vec<_> = runs.collect();
        runs.into_iter().flat_map(|run| run.join().unwrap()).collect()
    });
    check(&figures);
    // The commands must move every axis into both stops.
    for Figures { run, axis, travel, .. } in figures.iter().filter(|figures| figures.run == "nominal") {
        let stroke = under(run).axes.iter().find(|other| other.name == *axis).unwrap().stroke;
        assert!(*travel > stroke, "{axis} moved by {travel} m and did not meet both stops");
    }
}

#[test]
fn pilot_valves_with_half_a_second_of_dead_time_are_within_the_bounds() {
    let mut machine = under("everything");
    for (axis, plant) in plants(&mut machine).enumerate() {
        plant.valve_curve = ValveCurve::S;
        (plant.dead_band.extend, plant.saturation.extend) = (0.38, 0.72);
        (plant.dead_band.retract, plant.saturation.retract) = (0.35, 0.7);
        // One dead time is no whole number of milliseconds.
        plant.dead_time = [0.5, 0.5, 0.0123, 0.0][axis];
    }
    check(&figures(&machine, "S, 0.5 s"));
}

#[test]
fn small_dead_volumes_at_the_stops_are_within_the_bounds() {
    let mut machine = under("nominal");
    for (index, plant) in plants(&mut machine).enumerate() {
        // A bucket's cylinder with about the least volumes that the simulator's step can integrate.
        let volume = 1e-6 * f64::from(SMALL_VOLUMES[index]);
        (plant.piston_area, plant.rod_area) = (5e-3, 2.6e-3);
        (plant.piston_dead_volume, plant.rod_dead_volume) = (volume, volume);
        (plant.mass, plant.rated_flow) = (1e3, 8e-4);
        plant.load_force = LoadForce { retracted: 14e3, middle: 10e3, extended: -4e3 };
    }
    check(&figures(&machine, "small volumes"));
}

#[test]
fn open_relief_and_make_up_valves_are_within_the_bounds() {
    let mut machine = under("digging");
    for plant in plants(&mut machine) {
        // Below the pressure that pump and load cause in a chamber.
        plant.relief_pressure = 14e6;
    }
    // The load pulls harder than the rod side can hold, so the piston side draws oil from the tank.
    for change in machine.scenario.changes.iter_mut().filter(|change| change.to < 0.3) {
        change.to = -0.3;
    }
    check(&figures(&machine, "relief, make-up"));
}

#[test]
fn a_load_sensing_pump_and_a_full_valve_block_are_within_the_bounds() {
    let mut machine = under("everything");
    let supply = &mut machine.hydraulics.as_mut().unwrap().supply;
    supply.kind = SupplyKind::LoadSensing { margin: 2e6, response_time: 0.05 };
    (supply.flow, supply.power) = (6e-3, Some(60e3));
    for (axis, plant) in plants(&mut machine).enumerate() {
        plant.ports = Ports {
            meter_out: Directions { extend: 0.5, retract: 0.4 },
            regeneration: Directions { extend: [0.0, 0.4, 0.0, 0.2][axis], retract: [0.3, 0.0, 0.0, 0.0][axis] },
            counterbalance: Directions { extend: [0.0, 0.0, 9e6, 0.0][axis], retract: [0.0, 0.0, 0.0, 15e6][axis] },
            pilot_ratio: 0.5,
            spool_leakage: 1e-12,
            load_holding: [LoadHolding::Piston, LoadHolding::Rod, LoadHolding::None, LoadHolding::Both][axis],
            piston_hose_volume: 1e-3,
            rod_hose_volume: 5e-4,
            ..plant.ports
        };
    }
    check(&figures(&machine, "load-sensing"));
}

fn plants(machine: &mut Machine) -> impl Iterator<Item = &mut Plant> {
    machine.axes.iter_mut().map(|axis| axis.plant.as_mut().unwrap())
}
