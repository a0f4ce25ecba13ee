//! What the simulated machine costs: ten milliseconds of it, a hundred steps, by number of axes and by scenario.
//!
//! `cargo bench --bench plant`; `--quick` for a short run, `--json FILE` for programs. All contestants take turns, so
//! that a busy machine disturbs all alike. Ratios are to the built-in machine with its four axes when nothing changes;
//! the last column is how many times faster than real time it is, by the mean.

mod arguments;
mod figures;

use std::{fs, hint::black_box, time::Instant};

use pipeline::{machine::Machine, message::ValveCommand};
use plant_sim::PlantSim;
use serde_json::json;

use arguments::Arguments;
use figures::{Figures, head};

/// The built-in machine under a scenario, with so many axes: the first ones, or all and the first ones again.
fn machine(scenario: &str, axes: usize) -> Machine {
    let settings = [("scenario".to_owned(), scenario.to_owned())];
    let mut machine = Machine::load(None, &settings).expect("the built-in machine");
    machine.axes = machine.axes.iter().cycle().take(axes).cloned().collect();
    machine
}

struct Contestant {
    name: String,
    machine: Machine,
    plant: PlantSim,
    times: Vec<f64>,
}

fn main() {
    let arguments = Arguments::read();
    let samples = if arguments.quick { 200 } else { 20_000 };
    let cases = [("nominal", 4), ("nominal", 1), ("nominal", 8), ("cold-start", 4), ("everything", 4)];
    let mut contestants = cases.map(|(scenario, axes)| {
        let machine = machine(scenario, axes);
        let plant = PlantSim::new(&machine, 1).expect("the built-in plant");
        Contestant { name: format!("{scenario}, {axes} axes"), machine, plant, times: Vec::with_capacity(samples) }
    });
    for tick in 0..samples {
        let mut command = ValveCommand::default();
        for (i, axis) in command.axes.iter_mut().enumerate() {
            axis.command = 0.5 * (0.01 * tick as f64 * (1.0 + 0.2 * i as f64)).sin();
        }
        for Contestant { machine, plant, times, .. } in &mut contestants {
            plant.command(black_box(&command));
            let started = Instant::now();
            plant.advance(machine.timing.period);
            times.push(started.elapsed().as_nanos() as f64);
            // A scenario is over after 20 s: begin again.
            if tick % 2000 == 1999 {
                *plant = PlantSim::new(machine, 1).expect("the built-in plant");
            }
        }
    }
    let load = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    println!("load {}", load.split(' ').next().unwrap_or("unknown"));
    head("10 ms, 100 steps", "     ratio  times real time");
    let period = contestants[0].machine.timing.period.as_nanos() as f64;
    let figures = contestants.map(|contestant| (contestant.name, Figures::new(contestant.times)));
    let first = figures[0].1.p50;
    for (name, figures) in &figures {
        figures.print(name);
        println!(" {:>9.2} {:>16.0}", figures.p50 / first, period / figures.mean);
    }
    if let Some(path) = arguments.json {
        let rows: Vec<_> = figures.iter().map(|(name, figures)| figures.json(name)).collect();
        let text = serde_json::to_string_pretty(&json!({ "load": load.trim(), "plant": rows })).expect("numbers");
        fs::write(path, text).expect("the file for the figures");
    }
}
