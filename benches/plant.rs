//! Time that the simulated machine needs for ten milliseconds of model time, a hundred steps, for several numbers of
//! axes and scenarios.
//!
//! `cargo bench --bench plant`; `--quick` for a short run, `--json FILE` for programs. All contestants take turns, so
//! that a busy computer disturbs all of them equally. Ratios are to the built-in machine with its four axes under the
//! scenario `nominal`. The last column is the mean speed in multiples of real time.

mod arguments;
mod contest;
mod report;

use std::hint::black_box;

use pipeline::{machine::Machine, message::ValveCommand};
use plant_sim::PlantSim;
use serde_json::json;

use arguments::Arguments;
use contest::{Contestant, head};

/// Samples after which each plant begins anew; all scenarios have ended by then.
const RESTART: usize = 2000;

/// The built-in machine under a scenario with the number of axes `axes`: its first ones, or all and the first ones
/// again.
fn machine(scenario: &str, axes: usize) -> Machine {
    let settings = [("scenario".to_owned(), scenario.to_owned())];
    let mut machine = Machine::load(None, &settings).expect("the built-in machine");
    machine.axes = machine.axes.iter().cycle().take(axes).cloned().collect();
    machine
}

/// A machine, and its plant in motion.
struct Subject {
    machine: Machine,
    plant: PlantSim,
}

fn main() {
    let arguments = Arguments::read();
    let samples = if arguments.quick { 200 } else { 20_000 };
    let cases = [("nominal", 4), ("nominal", 1), ("nominal", 8), ("cold-start", 4), ("everything", 4)];
    let mut contestants = cases.map(|(scenario, axes)| {
        let machine = machine(scenario, axes);
        let plant = PlantSim::new(&machine, 1).expect("the built-in plant");
        Contestant::new(format!("{scenario}, {axes} axes"), Subject { machine, plant })
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
