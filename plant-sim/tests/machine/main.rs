//! The simulated machine as a whole: the built-in excavator and variations of it.

mod drive;
mod linear;
mod motion;
mod oil;
mod order;
mod ports;
mod rest;
mod scenarios;
mod supply;

use std::time::Duration;

use pipeline::{
    machine::{LoadForce, Machine, Plant},
    message::ValveCommand,
};
use plant_sim::PlantSim;

const TICK: Duration = Duration::from_millis(10);

/// The step of the simulator.
const STEP: Duration = Duration::from_micros(100);

/// The built-in machine under one of its scenarios.
fn under(scenario: &str) -> Machine {
    Machine::four_axes(&[("scenario".to_owned(), scenario.to_owned())]).unwrap()
}

/// The built-in machine with constant parameters.
fn excavator() -> Machine {
    under("nominal")
}

fn plant_of(machine: &mut Machine, axis: usize) -> &mut Plant {
    machine.axes[axis].plant.as_mut().unwrap()
}

fn simulate(machine: &Machine) -> PlantSim {
    PlantSim::new(machine, 1).unwrap()
}

/// 1/beta_e of the machine's oil at `pressure` Pa above the atmosphere.
fn compressibility(machine: &Machine, pressure: f64) -> f64 {
    const ATMOSPHERE: f64 = 101_325.0;
    let oil = machine.hydraulics.unwrap().oil;
    let absolute = pressure + ATMOSPHERE;
    let air = oil.air * (ATMOSPHERE / absolute).powf(1.0 / 1.4);
    (1.0 / oil.bulk_modulus + air / (1.4 * absolute)) / (1.0 + air)
}

/// A message with `command` for every axis.
fn all(command: f64) -> ValveCommand {
    let mut message = ValveCommand::default();
    message.axes.iter_mut().for_each(|axis| axis.command = command);
    message
}

/// Runs for `seconds` under one command, which is sent at every tick.
fn hold(sim: &mut PlantSim, command: f64, seconds: f64) {
    for _ in 0..(seconds / TICK.as_secs_f64()).round() as usize {
        sim.command(&all(command));
        sim.advance(TICK);
    }
}
