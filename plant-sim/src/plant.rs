//! The machine: all axes, the drive that feeds their valves, and their encoders.
//!
//! The drive holds the last command. Without one for `timing.drive_timeout` of model time it goes neutral by itself,
//! and the next command revives it: a controller that died must not leave a valve open.

use std::time::Duration;

use pipeline::{
    MAX_AXES,
    machine::Machine,
    message::{EncoderReading, ValveCommand},
};

use crate::{
    axis::{AxisDynamics, AxisState},
    encoder::NoisyEncoder,
    integrate::STEP_NS,
    stiffness::{STABILITY_LIMIT, fastest_rate},
};

/// Why a machine cannot be simulated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlantError {
    /// An axis says nothing of its plant.
    #[error("axis.{axis}: found no simulated axis; give it a table [axis.{axis}.plant]")]
    NoPlant {
        /// Name of the axis.
        axis: String,
    },
    /// An axis is too fast for the step.
    #[error(
        "axis.{axis}.plant: found a motion at {rate:.3e} 1/s, too fast for the simulator's step; \
         allowed: up to {limit:.3e} 1/s; more mass or dead volume, or less damping, stiffness, friction, leakage or rated_flow"
    )]
    TooStiff {
        /// Name of the axis.
        axis: String,
        /// Its fastest rate, 1/s.
        rate: f64,
        /// The fastest that can be integrated, 1/s.
        limit: f64,
    },
    /// More axes than a message holds.
    #[error("axis: found {found} axes; allowed: up to {MAX_AXES}")]
    TooManyAxes {
        /// Number of axes.
        found: usize,
    },
}

/// The simulated machine.
#[derive(Debug, Clone)]
pub struct PlantSim {
    dynamics: Vec<AxisDynamics>,
    states: Vec<AxisState>,
    encoders: Vec<NoisyEncoder>,
    /// What the drive holds, in [-1, 1].
    commands: Vec<f64>,
    step_ns: u64,
    time_ns: u64,
    /// Asked for but not yet a whole step.
    remainder_ns: u64,
    /// Model time at which the drive goes neutral.
    drive_ends_ns: u64,
    drive_timeout_ns: u64,
    readings: u64,
}

impl PlantSim {
    /// The machine at rest: every axis at its initial position, valve shut, load held; `seed` makes the noise.
    ///
    /// # Errors
    /// An axis without a plant, one that is too stiff for the step, or too many axes.
    pub fn new(machine: &Machine, seed: u64) -> Result<Self, PlantError> {
        Self::with_step(machine, seed, STEP_NS)
    }

    fn with_step(machine: &Machine, seed: u64, step_ns: u64) -> Result<Self, PlantError> {
        let count = machine.axes.len();
        if count > MAX_AXES {
            return Err(PlantError::TooManyAxes { found: count });
        }
        let mut dynamics = Vec::with_capacity(count);
        let mut states = Vec::with_capacity(count);
        let mut encoders = Vec::with_capacity(count);
        for (index, axis) in machine.axes.iter().enumerate() {
            let name = || axis.name.clone();
            let plant = axis.plant.as_ref().ok_or_else(|| PlantError::NoPlant { axis: name() })?;
            let (rate, limit) = (fastest_rate(axis, plant), STABILITY_LIMIT / (step_ns as f64 * 1e-9));
            if rate > limit {
                return Err(PlantError::TooStiff { axis: name(), rate, limit });
            }
            let (axis_dynamics, state) = AxisDynamics::new(axis, plant, step_ns);
            dynamics.push(axis_dynamics);
            states.push(state);
            encoders.push(NoisyEncoder::new(axis.encoder.resolution, plant.encoder_noise, seed, index));
        }
        Ok(Self {
            dynamics,
            states,
            encoders,
            commands: vec![0.0; count],
            step_ns,
            time_ns: 0,
            remainder_ns: 0,
            drive_ends_ns: 0,
            drive_timeout_ns: nanoseconds(machine.timing.drive_timeout),
            readings: 0,
        })
    }

    /// Gives the drive a command for every axis; one that is not finite is neutral, one beyond [-1, 1] is held there.
    pub fn command(&mut self, command: &ValveCommand) {
        for (held, axis) in self.commands.iter_mut().zip(&command.axes) {
            *held = if axis.command.is_finite() { axis.command.clamp(-1.0, 1.0) } else { 0.0 };
        }
        self.drive_ends_ns = self.time_ns.saturating_add(self.drive_timeout_ns);
    }

    /// Advances model time by whole steps; what is left of `duration` counts next time.
    pub fn advance(&mut self, duration: Duration) {
        self.remainder_ns = self.remainder_ns.saturating_add(nanoseconds(duration));
        let steps = self.remainder_ns / self.step_ns;
        self.remainder_ns %= self.step_ns;

        let driven = self.drive_ends_ns.saturating_sub(self.time_ns).div_ceil(self.step_ns).min(steps);
        self.step(driven);
        if driven < steps {
            self.commands.fill(0.0);
            self.step(steps - driven);
        }
    }

    fn step(&mut self, steps: u64) {
        for ((dynamics, state), &command) in self.dynamics.iter_mut().zip(&mut self.states).zip(&self.commands) {
            dynamics.advance(state, command, steps);
        }
        self.time_ns += steps * self.step_ns;
    }

    /// Reads all encoders, drawing their noise; `sequence` is the number of the reading, its times stay zero.
    pub fn read(&mut self) -> EncoderReading {
        let mut reading = EncoderReading::default();
        reading.header.sequence = self.readings;
        reading.header.axis_count = self.states.len() as u32;
        for ((value, encoder), state) in reading.encoders.iter_mut().zip(&mut self.encoders).zip(&self.states) {
            value.counts = encoder.read(state.position);
        }
        self.readings += 1;
        reading
    }

    /// The true states of all axes, in the machine's order.
    pub fn axes(&self) -> &[AxisState] {
        &self.states
    }

    /// Model time: the whole steps made so far.
    pub fn time(&self) -> Duration {
        Duration::from_nanos(self.time_ns)
    }
}

/// Whole nanoseconds; what 64 bits do not hold, 584 years, is held at their end.
fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests;
