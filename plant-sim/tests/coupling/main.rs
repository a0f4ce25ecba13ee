//! An excavator of 20 t whose axes are coupled by their linkage: cylinders, valves and oil of the built-in machine,
//! pins and masses of an excavator of that size.

mod energy;
mod halving;
mod hydraulics;
mod modes;
mod refused;
mod response;
mod rest;
mod sensors;
mod soil;

use std::{path::Path, time::Duration};

use mechanism::{AXES, Joint, Mechanism, Rotation, Vector};
use pipeline::{
    machine::{AngleKind, AngleSensor, Change, Machine, Parameter, Plant, PressureTransducers, SensorErrors, Soil},
    message::ValveCommand,
};
use plant_sim::PlantSim;

/// The step of the simulator.
const STEP: Duration = Duration::from_micros(100);

/// The machine file of the 20 t excavator.
fn of_20_tonnes() -> Machine {
    let text = include_str!("../../../examples/excavator.toml");
    Machine::parse(text, "excavator.toml", Path::new("."), &[]).unwrap()
}

/// Its pins and masses.
fn mechanism() -> Mechanism {
    of_20_tonnes().mechanism.unwrap()
}

/// The excavator under a built-in scenario.
fn under(scenario: &str) -> Machine {
    let mut machine = Machine::four_axes(&[("scenario".to_owned(), scenario.to_owned())]).unwrap();
    machine.mechanism = Some(mechanism());
    machine
}

/// The excavator with constant parameters.
fn excavator() -> Machine {
    under("nominal")
}

/// A loam whose surface lies where the teeth of [`excavator`] are at the start.
fn loam(level: f64) -> Soil {
    Soil {
        level,
        slope: 0.0,
        unit_weight: 18e3,
        cohesion: 9e3,
        friction_angle: 30.0,
        steel_friction_angle: 20.0,
        adhesion: 0.0,
        width: 1.05,
        rake_angle: 45.0,
        heap: 0.3,
        penetration_resistance: 5e5,
        teeth_area: 0.02,
    }
}

fn plants(machine: &mut Machine) -> impl Iterator<Item = &mut Plant> {
    machine.axes.iter_mut().map(|axis| axis.plant.as_mut().unwrap())
}

/// Takes every loss between pistons and tank away.
fn without_leakage(machine: &mut Machine) {
    for plant in plants(machine) {
        (plant.internal_leakage, plant.external_leakage, plant.ports.spool_leakage) = (0.0, 0.0, 0.0);
    }
}

fn step_to(parameter: Parameter, time: f64, to: f64) -> Change {
    Change { axis: None, parameter, start: time, end: time, to }
}

fn simulate(machine: &Machine) -> PlantSim {
    PlantSim::new(machine, 1).unwrap_or_else(|error| panic!("{error}"))
}

/// A message with these commands.
fn commands(commands: [f64; AXES]) -> ValveCommand {
    let mut message = ValveCommand::default();
    message.axes.iter_mut().zip(commands).for_each(|(axis, command)| axis.command = command);
    message
}

fn positions(sim: &PlantSim) -> [f64; AXES] {
    std::array::from_fn(|axis| sim.axes()[axis].position)
}

/// Commands that move all axes against each other, with reversals and pauses, at `time` s.
fn mixed(time: f64) -> [f64; AXES] {
    const TAU: f64 = std::f64::consts::TAU;
    let sine = |frequency: f64, phase: f64| (TAU * frequency * time + phase).sin();
    [
        0.35 * sine(0.11, 0.0) + 0.1 * sine(0.9, 0.3),
        0.45 * sine(0.17, 1.0) + 0.15 * sine(1.3, 0.0),
        0.4 * sine(0.13, 2.0),
        0.4 * sine(0.23, 0.5) + 0.2 * sine(0.7, 1.0),
    ]
}
