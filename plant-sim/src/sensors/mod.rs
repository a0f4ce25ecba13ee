//! The sensors of the machine: what a reading says about the true states.
//!
//! | module | what it holds |
//! |---|---|
//! | [`noise`] | noise of one sensor |
//! | [`encoder`] | a position or an angle to counts |
//! | [`joint`] | sensors at the joints of a mechanism: the angle that they see |
//! | [`pressure`] | chamber pressures |
//!
//! [`Sensors::follow`], [`Sensors::seen`] and [`Sensors::read`] allocate nothing.

pub mod encoder;
pub mod joint;
pub mod noise;
pub mod pressure;

use mechanism::{AXES, Pose, Vector};
use pipeline::{
    MAX_AXES,
    machine::{Axis, Plant},
    message::EncoderReading,
};

use crate::integration::TrueState;
use encoder::NoisyEncoder;
use joint::NoisyAngleSensor;
use noise::Noise;
use pressure::NoisyTransducers;

/// The sensor of a position.
#[derive(Debug, Clone)]
enum PositionSensor {
    Cylinder(NoisyEncoder),
    Joint(NoisyAngleSensor),
}

/// The sensors of one axis.
#[derive(Debug, Clone)]
struct AxisSensors {
    position: PositionSensor,
    /// Transducers of the pressures, where the axis has them.
    pressures: Option<NoisyTransducers>,
}

/// The sensors of all axes.
#[derive(Debug, Clone)]
pub struct Sensors {
    axes: Vec<AxisSensors>,
    /// Number of readings so far.
    readings: u64,
}

impl Sensors {
    /// The sensors of `axes`, in the machine's order; `seed` is the seed of the run. `pose` is that of the mechanism at
    /// rest, if there is one; without it no axis has a sensor at a joint.
    pub fn new(axes: &[(&Axis, &Plant)], seed: u64, pose: Option<&Pose>) -> Self {
        let of_axis = |(index, (axis, plant)): (usize, &(&Axis, &Plant))| {
            let errors = &plant.sensor_errors;
            let noise = Noise::new(errors.encoder_noise, seed, index);
            let position = match (axis.encoder.angle, pose) {
                (Some(sensor), Some(pose)) => {
                    let encoder = NoisyEncoder::new(sensor.resolution, noise);
                    PositionSensor::Joint(NoisyAngleSensor::new(sensor, errors, encoder, pose))
                }
                _ => PositionSensor::Cylinder(NoisyEncoder::new(axis.encoder.resolution, noise)),
            };
            // The encoders have the numbers up to MAX_AXES, the transducers those behind them.
            let noise = Noise::new(errors.pressure_noise, seed, MAX_AXES + index);
            let pressures = axis.pressure.map(|transducers| NoisyTransducers::new(&transducers, noise));
            AxisSensors { position, pressures }
        };
        Self { axes: axes.iter().enumerate().map(of_axis).collect(), readings: 0 }
    }

    fn at_joints(&self) -> impl Iterator<Item = (usize, &NoisyAngleSensor)> {
        self.axes.iter().take(AXES).enumerate().filter_map(|(axis, sensors)| match &sensors.position {
            PositionSensor::Joint(sensor) => Some((axis, sensor)),
            PositionSensor::Cylinder(_) => None,
        })
    }

    /// Whether what the sensors read depends on the past.
    pub fn has_lag(&self) -> bool {
        self.at_joints().any(|(_, sensor)| sensor.has_lag())
    }

    /// Takes the lags of the sensors through a step of `step` s that has ended in `pose`.
    pub fn follow(&mut self, pose: &Pose, step: f64) {
        for sensors in &mut self.axes {
            if let PositionSensor::Joint(sensor) = &mut sensors.position {
                sensor.follow(pose, step);
            }
        }
    }

    /// Whether a sensor is at a joint.
    pub fn see_joints(&self) -> bool {
        self.at_joints().next().is_some()
    }

    /// Directions that the sensors at the joints see in `pose`, for each axis; zero for an axis without such a sensor.
    pub fn seen(&self, pose: &Pose) -> [Vector; AXES] {
        let mut seen = [Vector::default(); AXES];
        self.at_joints().for_each(|(axis, sensor)| seen[axis] = sensor.seen(pose));
        seen
    }

    /// Reads all sensors, each with newly drawn noise, while the axes are in `states` and the sensors at the joints see
    /// the directions `seen`. The reading is numbered; its times stay zero.
    pub fn read(&mut self, states: &[TrueState], seen: &[Vector; AXES]) -> EncoderReading {
        let mut reading = EncoderReading::default();
        reading.header.sequence = self.readings;
        reading.header.axis_count = self.axes.len() as u32;
        let of_axes = reading.encoders.iter_mut().zip(&mut self.axes).zip(states);
        for (axis, ((value, sensors), state)) in of_axes.enumerate() {
            value.counts = match &mut sensors.position {
                PositionSensor::Cylinder(encoder) => encoder.read(state.position),
                PositionSensor::Joint(sensor) => sensor.read(seen[axis]),
            };
            if let Some(pressures) = &mut sensors.pressures {
                value.piston_pressure = pressures.read(state.piston_pressure);
                value.rod_pressure = pressures.read(state.rod_pressure);
                value.has_pressures = 1;
            }
        }
        self.readings += 1;
        reading
    }
}
