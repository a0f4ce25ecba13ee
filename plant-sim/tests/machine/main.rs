//! The simulated machine from outside: the built-in excavator and variations of it.

mod drive;
mod motion;
mod order;
mod scenarios;

use std::time::Duration;

use pipeline::{
    machine::{LoadForce, Machine, Plant},
    message::ValveCommand,
};
use plant_sim::PlantSim;

const TICK: Duration = Duration::from_millis(10);

/// The built-in machine under one of its scenarios.
fn under(scenario: &str) -> Machine {
    Machine::load(None, &[("scenario".to_owned(), scenario.to_owned())]).unwrap()
}

/// The built-in machine; nothing changes.
fn excavator() -> Machine {
    under("nominal")
}

fn plant_of(machine: &mut Machine, axis: usize) -> &mut Plant {
    machine.axes[axis].plant.as_mut().unwrap()
}

fn simulate(machine: &Machine) -> PlantSim {
    PlantSim::new(machine, 1).unwrap()
}

/// The same command for every axis.
fn all(command: f64) -> ValveCommand {
    let mut message = ValveCommand::default();
    message.axes.iter_mut().for_each(|axis| axis.command = command);
    message
}

/// Runs for `seconds` under one command, given anew at every tick.
fn hold(sim: &mut PlantSim, command: f64, seconds: f64) {
    for _ in 0..(seconds / TICK.as_secs_f64()).round() as usize {
        sim.command(&all(command));
        sim.advance(TICK);
    }
}
