//! The sensors of the machine: what a reading says about the true states.
//!
//! | module | what it holds |
//! |---|---|
//! | [`noise`] | noise of one sensor |
//! | [`encoder`] | position of the piston to counts |
//! | [`pressure`] | chamber pressures |
//!
//! [`Sensors::read`] allocates nothing.

pub mod encoder;
pub mod noise;
pub mod pressure;

use pipeline::{
    MAX_AXES,
    machine::{Axis, Plant},
    message::EncoderReading,
};

use crate::integration::TrueState;
use encoder::NoisyEncoder;
use noise::Noise;
use pressure::NoisyTransducers;

/// The sensors of one axis.
#[derive(Debug, Clone)]
struct AxisSensors {
    encoder: NoisyEncoder,
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
    /// The sensors of `axes`, in the machine's order; `seed` is the seed of the run.
    pub fn new(axes: &[(&Axis, &Plant)], seed: u64) -> Self {
        let of_axis = |(index, (axis, plant)): (usize, &(&Axis, &Plant))| {
            let errors = &plant.sensor_errors;
            // The encoders have the numbers up to MAX_AXES, the transducers those behind them.
            let pressure_noise = Noise::new(errors.pressure_noise, seed, MAX_AXES + index);
            AxisSensors {
                encoder: NoisyEncoder::new(axis.encoder.resolution, Noise::new(errors.encoder_noise, seed, index)),
                pressures: axis.pressure.map(|transducers| NoisyTransducers::new(&transducers, pressure_noise)),
            }
        };
        Self { axes: axes.iter().enumerate().map(of_axis).collect(), readings: 0 }
    }

    /// Reads all sensors, each with newly drawn noise, while the axes are in `states`. The reading is numbered; its
    /// times stay zero.
    pub fn read(&mut self, states: &[TrueState]) -> EncoderReading {
        let mut reading = EncoderReading::default();
        reading.header.sequence = self.readings;
        reading.header.axis_count = self.axes.len() as u32;
        for ((value, sensors), state) in reading.encoders.iter_mut().zip(&mut self.axes).zip(states) {
            value.counts = sensors.encoder.read(state.position);
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
