//! Time that the simulated machine needs for ten milliseconds of model time, a hundred steps, for several numbers of
//! axes and scenarios, with and without a linkage that couples the first four axes.
//!
//! `cargo bench --bench plant`; `--quick` for a short run, `--json FILE` for programs. All contestants take turns, so
//! that a busy computer disturbs all of them equally. Ratios are to four axes without a linkage under the scenario
//! `nominal`. The last column is the mean speed in multiples of real time.

mod arguments;
mod contest;
mod report;

use std::{hint::black_box, path::Path};

use mechanism::Mechanism;
use pipeline::{
    machine::{FOUR_AXES, Machine, Soil},
    message::ValveCommand,
};
use plant_sim::PlantSim;
use serde_json::json;

use arguments::Arguments;
use contest::{Contestant, head};

/// Samples after which each plant begins anew; all scenarios have ended by then.
const RESTART: usize = 2000;

/// Pins and masses of an excavator of 20 t, and loam that its teeth reach.
const EXCAVATOR: &str = include_str!("../examples/mechanism.toml");
const LOAM: &str = r#"
[soil]
level = 1.0
unit_weight = 18e3
cohesion = 10e3
friction_angle = 30
steel_friction_angle = 20
width = 1.05
heap = 0.3
penetration_resistance = 5e5
"#;

/// Mass of each axis in a machine without a mechanism, kg.
const MASSES: [f64; 4] = [40e3, 12e3, 3e3, 4e3];

/// The built-in machine under a scenario with the number of axes `axes`: its first ones, or all and the first ones
/// again. The first four are coupled by a linkage, or each has its own mass.
fn machine(scenario: &str, axes: usize, is_coupled: bool) -> Machine {
    let settings = [("scenario".to_owned(), scenario.to_owned())];
    let mut machine = Machine::four_axes(&settings).expect("the built-in machine");
    let linkage = linkage();
    (machine.mechanism, machine.soil) = if is_coupled { linkage } else { (None, None) };
    for (axis, mass) in machine.axes.iter_mut().zip(MASSES) {
        axis.plant.as_mut().expect("a simulated axis").mass = mass;
    }
    machine.axes = machine.axes.iter().cycle().take(axes).cloned().collect();
    machine
}

/// The mechanism of [`EXCAVATOR`] and its soil.
fn linkage() -> (Option<Mechanism>, Option<Soil>) {
    let own = |line: &&str| !["mass =", "load_force =", "load_stiffness ="].iter().any(|key| line.starts_with(key));
    // The tables of the built-in machine, without those that may be in it already.
    let mut is_kept = true;
    let kept = FOUR_AXES.lines().filter(|line| {
        if line.starts_with('[') {
            is_kept = !line.starts_with("[mechanism") && !line.starts_with("[soil]");
        }
        is_kept
    });
    let text: Vec<&str> = kept.filter(own).chain([EXCAVATOR, LOAM]).collect();
    let machine = Machine::parse(&text.join("\n"), "excavator", Path::new("."), &[]).expect("an excavator");
    (machine.mechanism, machine.soil)
}

/// A machine, and its plant in motion.
struct Subject {
    machine: Machine,
    plant: PlantSim,
}

fn main() {
    let arguments = Arguments::read(&[]);
    let samples = if arguments.quick { 200 } else { 20_000 };
    let cases = [
        ("nominal", 4, false),
        ("nominal", 1, false),
        ("nominal", 8, false),
        ("cold-start", 4, false),
        ("everything", 4, false),
        ("nominal", 4, true),
        ("nominal", 8, true),
        ("everything", 4, true),
        ("digging", 4, true),
    ];
    let mut contestants = cases.map(|(scenario, axes, is_coupled)| {
        let machine = machine(scenario, axes, is_coupled);
        let plant = PlantSim::new(&machine, 1).expect("the built-in plant");
        let coupled = if is_coupled { ", coupled" } else { "" };
        Contestant::new(format!("{scenario}, {axes} axes{coupled}"), Subject { machine, plant })
    });
    for tick in 0..samples {
        let mut command = ValveCommand::default();
        for (i, axis) in command.axes.iter_mut().enumerate() {
            axis.command = 0.5 * (0.01 * tick as f64 * (1.0 + 0.2 * i as f64)).sin();
        }
        for contestant in &mut contestants {
            contestant.subject.plant.command(black_box(&command));
            contestant.time(1, |Subject { machine, plant }| plant.advance(machine.timing.period));
            if tick % RESTART == RESTART - 1 {
                let Subject { machine, plant } = &mut contestant.subject;
                *plant = PlantSim::new(machine, 1).expect("the built-in plant");
            }
        }
    }
    let load = report::load();
    println!("load {load}");
    head("10 ms, 100 steps", "     ratio  times real time");
    let period = contestants[0].subject.machine.timing.period.as_nanos() as f64;
    let figures = contestants.map(Contestant::figures);
    let first = figures[0].1.p50;
    for (name, figures) in &figures {
        figures.print(name);
        println!(" {:>9.2} {:>16.0}", figures.p50 / first, period / figures.mean);
    }
    let rows: Vec<_> = figures.iter().map(|(name, figures)| figures.json(name)).collect();
    report::write(arguments.json.as_deref(), &json!({ "load": load, "plant": rows }));
}
