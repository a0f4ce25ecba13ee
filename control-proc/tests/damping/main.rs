//! Loads damped by the chamber pressures, in closed loop on the simulated excavator with servo valves.
//!
//! `servo-model.toml` is what `hydraxis commission examples/excavator-servo.toml` has found in a minute for each axis.

use std::path::Path;

use control_proc::Controller;
use pipeline::{
    machine::{Machine, model_settings_in},
    message::{AxisSample, EncoderSample, control_flag},
};
use plant_sim::PlantSim;
use sensor_proc::Acquisition;

/// The excavator with servo valves, commissioned, with this payload in its bucket, kg. It follows sines.
fn excavator(payload: f64) -> Machine {
    let mut settings = model_settings_in(include_str!("servo-model.toml"), "model").unwrap();
    settings.push(("mechanism.payload.mass".to_owned(), payload.to_string()));
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/excavator-servo.toml");
    Machine::load(Some(&file), &settings).unwrap()
}

/// What boom and arm did from 5 s to 20 s.
#[derive(Debug)]
struct Driven {
    /// Root mean square of the following error, mm.
    errors: [f64; 2],
    is_latched: bool,
    /// A swing was found, and the loop has lost authority.
    is_cautious: bool,
}

/// Drives for 20 s; `change` changes the samples before the controller sees them.
fn drive(machine: &Machine, mut change: impl FnMut(u64, &mut EncoderSample)) -> Driven {
    let mut plant = PlantSim::new(machine, 1).unwrap();
    let (mut acquisition, mut controller) = (Acquisition::new(machine), Controller::new(machine).unwrap());
    controller.arm();
    let (mut squares, mut is_latched, mut is_cautious) = ([0.0; 2], false, false);
    for tick in 0..2000 {
        let mut sample = acquisition.update(tick, Some(&plant.read()));
        change(tick, &mut sample);
        let command = controller.update(&sample, None, None);
        plant.command(&command);
        plant.advance(machine.timing.period);
        is_cautious |= command.axes.iter().take(4).any(|axis| axis.flags & control_flag::CAUTION != 0);
        is_latched |= command.axes.iter().take(4).any(|axis| axis.flags & control_flag::LATCHED != 0);
        if tick >= 500 {
            for (square, axis) in squares.iter_mut().zip(&command.axes) {
                *square += axis.error * axis.error / 1500.0;
            }
        }
    }
    Driven { errors: squares.map(|square| 1e3 * square.sqrt()), is_latched, is_cautious }
}

fn untouched(_: u64, _: &mut EncoderSample) {}

/// The pressures of boom and arm stay what they were at 3 s.
fn stuck() -> impl FnMut(u64, &mut EncoderSample) {
    let mut kept = None;
    move |tick, sample| {
        if tick >= 300 {
            let kept = kept.get_or_insert(sample.axes);
            for (axis, kept) in sample.axes.iter_mut().zip(kept).take(2) {
                (axis.piston_pressure, axis.rod_pressure) = (kept.piston_pressure, kept.rod_pressure);
            }
        }
    }
}

/// Readings of all axes that `change` changes from 3 s on.
fn from_3_s(change: impl Fn(u64, &mut AxisSample)) -> impl FnMut(u64, &mut EncoderSample) {
    move |tick, sample| {
        if tick >= 300 {
            sample.axes.iter_mut().for_each(|axis| change(tick, axis));
        }
    }
}

#[test]
fn damped_loads_follow_better_and_without_readings_no_worse_than_undamped_ones() {
    for payload in [0.0, 1500.0] {
        let machine = excavator(payload);
        let mut undamped = machine.clone();
        undamped.axes.iter_mut().for_each(|axis| axis.control.without.damping = true);
        let (with, without) = (drive(&machine, untouched), drive(&undamped, untouched));
        println!("{payload} kg: {with:?}, undamped {without:?}");
        assert!(with.errors[0] < 0.6 * without.errors[0] && !with.is_latched, "{with:?} {without:?}");
        let wrong = [
            ("stuck", drive(&machine, stuck())),
            ("missing", drive(&machine, from_3_s(|_, axis| axis.has_pressures = 0))),
            ("no numbers", drive(&machine, from_3_s(|_, axis| axis.rod_pressure = f64::NAN))),
            ("on and off", drive(&machine, from_3_s(|tick, axis| axis.has_pressures &= u32::from(tick / 7 % 2 == 0)))),
        ];
        for (what, driven) in wrong {
            println!("{payload} kg, {what}: {driven:?}");
            for (error, allowed) in driven.errors.iter().zip(&without.errors) {
                assert!(*error < 1.4 * allowed && !driven.is_latched, "{what}: {driven:?} {without:?}");
            }
        }
    }
}

/// Feedback by the wrong chambers excites the swing.
#[test]
fn the_swing_by_transducers_whose_lines_are_swapped_is_found_and_latches() {
    for payload in [0.0, 1500.0] {
        let swap = |axis: &mut AxisSample| std::mem::swap(&mut axis.piston_pressure, &mut axis.rod_pressure);
        let driven = drive(&excavator(payload), from_3_s(|_, axis| swap(axis)));
        println!("{payload} kg: {driven:?}");
        assert!(driven.is_cautious && driven.is_latched && driven.errors[0] < 30.0, "{driven:?}");
    }
}
