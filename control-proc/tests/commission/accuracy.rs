//! The commissioned model against the true parameters, on the simulated excavator and variations of it.

use super::*;
use control_proc::commission::analyse;
use pipeline::machine::{Change, Commissioned, DeadBand, Parameter, ValveCurve};
use std::time::Duration;

/// Time constant of the valves when the oil is at 5 degrees Celsius, s: 50 ms times the root of 382.3 over 29.97 mm2/s.
const COLD: f64 = 0.1786;

#[test]
fn the_nominal_machine_is_found() {
    expect_found(&under("nominal"), 0.05, 0.015, 0.2);
}

#[test]
fn other_random_steps_find_the_same_dead_bands() {
    let machine = under("nominal");
    let cases: Vec<(u64, usize)> =
        (2..8).flat_map(|seed| (0..machine.axes.len()).map(move |axis| (seed, axis))).collect();
    in_parallel(&cases, |(seed, axis)| {
        let options = ExperimentOptions { seed: *seed, ..ExperimentOptions::default() };
        let run = Run::of(&machine, *axis, &options, *seed).expect_finished();
        let found = analyse(run.experiment.record()).unwrap().dead_band;
        let true_band = machine.axes[*axis].plant.as_ref().unwrap().dead_band;
        let (extend, retract) = (found.extend - true_band.extend, found.retract - true_band.retract);
        println!("seed {seed}, axis {axis}: {extend:+.4} {retract:+.4}");
        assert!(extend.abs() <= 0.015 && retract.abs() <= 0.015, "seed {seed}, axis {axis}: {found:?}");
    });
}

#[test]
fn long_dead_times_are_found() {
    for dead_time in [0.15, 0.3] {
        let mut machine = under("nominal");
        machine.axes.iter_mut().for_each(|axis| axis.plant.as_mut().unwrap().dead_time = dead_time);
        expect_found(&machine, 0.05, 0.015, 0.2);
    }
}

#[test]
fn an_s_behind_a_wide_dead_band_is_found() {
    let mut machine = under("nominal");
    for plant in machine.axes.iter_mut().map(|axis| axis.plant.as_mut().unwrap()) {
        plant.valve_curve = ValveCurve::S;
        plant.dead_band = DeadBand { extend: 0.38, retract: 0.35 };
        plant.saturation = DeadBand { extend: 0.72, retract: 0.70 };
    }
    // The flow at the flat beginning of the S is smaller than the effect of the hysteresis: the dead band is found
    // wider.
    expect_found(&machine, 0.05, 0.045, 0.4);
}

#[test]
fn cold_oil_is_found() {
    let mut machine = under("nominal");
    let cold = Change { parameter: Parameter::Temperature, axis: None, start: 0.0, end: 0.0, to: 5.0 };
    machine.scenario.changes = vec![cold];
    expect_found(&machine, COLD, 0.015, 0.2);
}

/// Expects of all axes: dead bands within `dead_band`; the dead time within 13 ms, and its sum with the lag within 5
/// ms; the curve within 5 % of the plant's steady speeds, from the part `from` of the tested openings on. The steady
/// speeds are a range between the two branches of the hysteresis.
fn expect_found(machine: &Machine, time_constant: f64, dead_band: f64, from: f64) {
    for (axis, settings) in machine.axes.iter().enumerate() {
        let run = Run::of(machine, axis, &ExperimentOptions::default(), 1).expect_finished();
        assert!(run.beyond <= 0.0, "{}: {} m beyond the window", settings.name, run.beyond);
        let found = analyse(run.experiment.record()).unwrap();
        let plant = settings.plant.as_ref().unwrap();
        let extend = found.dead_band.extend - plant.dead_band.extend;
        let retract = found.dead_band.retract - plant.dead_band.retract;
        let delay = found.dead_time - plant.dead_time;
        let sum = delay + found.time_constant - time_constant;
        println!(
            "{}: dead bands {extend:+.4} {retract:+.4}, dead time {:+.1} ms, with the lag {:+.1} ms, fit {:.1} %, \
             {:.1} mm inside the window",
            settings.name,
            1e3 * delay,
            1e3 * sum,
            found.fit_percent,
            -1e3 * run.beyond
        );
        assert!(extend.abs() <= dead_band && retract.abs() <= dead_band, "{}: {found:?}", settings.name);
        assert!(delay.abs() <= 0.013 && sum.abs() <= 0.005, "{}: {found:?}", settings.name);
        assert!(found.fit_percent > 85.0, "{}: {found:?}", settings.name);
        for part in (0..5).map(|i| from + (1.0 - from) * 0.25 * f64::from(i)) {
            for sign in [1.0, -1.0] {
                let u = command(&found, sign * part);
                let branch = |half: f64| sign * steady_speed(machine, axis, u + sign * half * plant.hysteresis);
                let (speed, slow, fast) = (sign * found.speed(u), branch(-0.5), branch(0.5));
                assert!(
                    (0.95 * slow..=1.05 * fast).contains(&speed),
                    "{} at {u:+.3}: {speed:.4}, {slow:.4} to {fast:.4}",
                    settings.name
                );
            }
        }
    }
}

/// The command at a part of the tested openings, signed.
fn command(found: &Commissioned, part: f64) -> f64 {
    let opening = part * found.openings.last().unwrap();
    if part > 0.0 { found.dead_band.extend + opening } else { opening - found.dead_band.retract }
}

/// Steady speed of the plant at a command, m/s, without hysteresis, near where the axis stood.
fn steady_speed(machine: &Machine, axis: usize, u: f64) -> f64 {
    const SETTLING: f64 = 0.8;
    const MEASURED: f64 = 0.32;
    let hold = |from: f64| {
        let mut machine = machine.clone();
        let plant = machine.axes[axis].plant.as_mut().unwrap();
        plant.hysteresis = 0.0;
        plant.initial_position = from;
        let settling = plant.dead_time + SETTLING;
        let mut plant = PlantSim::new(&machine, 1).unwrap();
        let mut message = ValveCommand::default();
        message.axes[axis].command = u;
        let mut position = [0.0; 2];
        for (position, seconds) in position.iter_mut().zip([settling, MEASURED]) {
            for _ in 0..(seconds * 100.0).round() as usize {
                plant.command(&message);
                plant.advance(Duration::from_millis(10));
            }
            *position = plant.axes()[axis].position;
        }
        (position[1] - position[0]) / MEASURED
    };
    let stood = machine.axes[axis].plant.as_ref().unwrap().initial_position;
    hold(stood - (SETTLING + 0.5 * MEASURED) * hold(stood))
}
