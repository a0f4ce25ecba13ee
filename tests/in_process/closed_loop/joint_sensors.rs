//! The built-in excavator with sensors at its joints.

use pipeline::{machine::Machine, message::control_flag};

use super::ClosedLoop;
use crate::harness::mechanism::joint_sensors;

/// Noise of the sensors, rad.
const NOISE: f64 = 5e-5;

fn built_in(kind: &str, others: &[(&str, &str)]) -> Machine {
    let mut settings = joint_sensors(kind, 1e-4);
    let set = |(key, value): (String, &str)| (key, value.to_owned());
    let noise = ["boom", "arm", "bucket"].map(|axis| format!("axis.{axis}.plant.angle_noise"));
    settings.extend(noise.map(|key| set((key, &NOISE.to_string()))));
    settings.extend(others.iter().map(|(key, value)| set(((*key).to_owned(), *value))));
    Machine::load(None, &settings).unwrap()
}

/// Runs 40 s and returns the largest distance of the samples from the true positions, m, in parts of the length of a
/// count. No axis latches, no sample is unusable.
fn largest_error(machine: Machine) -> f64 {
    let counts: Vec<f64> = machine.axes.iter().map(|axis| axis.encoder.resolution).collect();
    let mut closed = ClosedLoop::new(machine, 1);
    let mut largest = 0.0f64;
    let mut model = 0;
    while closed.tick < 4000 {
        let command = closed.tick(None);
        for axis in 0..4 {
            let sample = &closed.sample.axes[axis];
            assert_eq!(command.axes[axis].flags & control_flag::LATCHED, 0, "axis {axis}, tick {}", closed.tick);
            assert!(sample.usable().is_some(), "axis {axis}, tick {}", closed.tick);
            let error = sample.position - closed.plant.axes()[axis].position;
            largest = largest.max(error.abs() / counts[axis]);
            model += u32::from(command.axes[axis].mode == pipeline::message::ControlMode::Model as u32);
        }
    }
    assert!(model > 4000, "models control: {model}");
    largest
}

#[test]
fn rotary_encoders_control_the_excavator_and_show_its_positions() {
    let error = largest_error(built_in("rotary-encoder", &[]));
    // Half a count, and the noise of half a count: five deviations in 16 000 samples.
    assert!(error < 0.5 + 5.0 * NOISE / 1e-4, "{error}");
}

#[test]
fn inclinometers_control_the_excavator_with_a_lag() {
    let lag = ["boom", "arm", "bucket"].map(|axis| format!("axis.{axis}.plant.angle_bandwidth"));
    let lag: Vec<(&str, &str)> = lag.iter().map(|key| (key.as_str(), "10")).collect();
    let error = largest_error(built_in("inclinometer", &lag));
    println!("{error} counts");
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
