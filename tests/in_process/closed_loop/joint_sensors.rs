//! The built-in excavator with sensors at its joints, as it is before it is commissioned: the predictive controller
//! controls it then.

use std::path::Path;

use pipeline::{
    machine::{BUILT_IN, Machine},
    message::{ControlMode, control_flag},
};

use super::ClosedLoop;
use crate::harness::mechanism::joint_sensors;

/// Noise of the sensors, rad.
const NOISE: f64 = 5e-5;
/// Angle of a count, rad.
const COUNT: f64 = 1e-4;

fn built_in(kind: &str, others: &[(&str, &str)]) -> Machine {
    let mut settings = joint_sensors(kind, COUNT);
    let set = |(key, value): (String, &str)| (key, value.to_owned());
    let noise = ["boom", "arm", "bucket"].map(|axis| format!("axis.{axis}.plant.angle_noise"));
    settings.extend(noise.map(|key| set((key, &NOISE.to_string()))));
    settings.extend(others.iter().map(|(key, value)| set(((*key).to_owned(), *value))));
    Machine::parse(BUILT_IN, "built-in machine", Path::new("."), &settings).unwrap()
}

/// Runs 40 s with sensors that are late by `lag` s. The samples are the true positions behind a first-order lag, as far
/// as counts and noise allow; no axis latches, no sample is unusable, and models control.
fn expect_calm(machine: Machine, lag: f64) {
    // Half a count of each sensor, five deviations of its noise, and the change of the moment arm within the lag.
    let scatter = 0.5 + 5.0 * NOISE / COUNT;
    let allowed: Vec<f64> = machine.axes.iter().map(|axis| scatter * axis.encoder.resolution + 0.02 * lag).collect();
    let period = machine.timing.period.as_secs_f64();
    let (mut closed, mut by_model) = (ClosedLoop::new(machine, 1), 0);
    let mut last: Vec<f64> = closed.plant.axes().iter().map(|state| state.position).collect();
    let mut seen = last.clone();
    while closed.tick < 4000 {
        let command = closed.tick(None);
        for (axis, state) in closed.plant.axes().iter().enumerate() {
            let (sample, told) = (&closed.sample.axes[axis], format!("axis {axis}, tick {}", closed.tick));
            assert_eq!(command.axes[axis].flags & control_flag::LATCHED, 0, "{told}");
            assert!(sample.usable().is_some(), "{told}");
            by_model += u32::from(command.axes[axis].mode == ControlMode::Model as u32);
            if closed.tick > 1 {
                // The telescope is measured at its cylinder, without a lag.
                let lag = if axis == 2 { 0.0 } else { lag };
                let mean = 0.5 * (last[axis] + state.position);
                seen[axis] += (mean - seen[axis]) * period / (lag + 0.5 * period);
            }
            last[axis] = state.position;
            let error = sample.position - seen[axis];
            assert!(error.abs() < allowed[axis], "{told}: {error} m, allowed {} m", allowed[axis]);
        }
    }
    assert!(by_model > 4000, "{by_model}");
}

#[test]
fn rotary_encoders_control_the_excavator_and_show_its_positions() {
    expect_calm(built_in("rotary-encoder", &[]), 0.0);
}

#[test]
fn inclinometers_control_the_excavator_and_show_its_positions_late() {
    const BANDWIDTH: f64 = 10.0;
    let lag = ["boom", "arm", "bucket"].map(|axis| format!("axis.{axis}.plant.angle_bandwidth"));
    let lag: Vec<(&str, String)> = lag.iter().map(|key| (key.as_str(), BANDWIDTH.to_string())).collect();
    let lag: Vec<(&str, &str)> = lag.iter().map(|(key, value)| (*key, value.as_str())).collect();
    expect_calm(built_in("inclinometer", &lag), 1.0 / (std::f64::consts::TAU * BANDWIDTH));
}

#[test]
fn chamber_pressures_reach_the_samples() {
    let pressure = ["boom", "telescope"].map(|axis| format!("axis.{axis}.pressure.resolution"));
    let pressure: Vec<(&str, &str)> = pressure.iter().map(|key| (key.as_str(), "1e4")).collect();
    let mut closed = ClosedLoop::new(built_in("inclinometer", &pressure), 1);
    while closed.tick < 300 {
        closed.tick(None);
        for (axis, state) in closed.plant.axes().iter().enumerate() {
            let sample = &closed.sample.axes[axis];
            match sample.pressures() {
                Some((piston, rod)) => {
                    assert!([0, 2].contains(&axis));
                    assert!((piston - state.piston_pressure).abs() <= 0.5001e4);
                    assert!((rod - state.rod_pressure).abs() <= 0.5001e4);
                }
                None => assert!([1, 3].contains(&axis) && sample.piston_pressure.is_nan()),
            }
            assert_eq!(sample.faults, 0);
        }
    }
}
