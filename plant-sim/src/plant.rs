//! The machine: all axes, the drive that feeds their valves, and their encoders.
//!
//! The drive holds the last command. Without one for `timing.drive_timeout` of model time it goes neutral by itself,
//! and the next command revives it: a controller that died must not leave a valve open. While a command asks for it the
//! pilot pressure is cut off: no dead time, no hysteresis, the spools go to neutral as fast as their springs push.

use std::time::Duration;

use pipeline::{
    MAX_AXES,
    machine::{Hydraulics, Machine, Scenario},
    message::{EncoderReading, ValveCommand},
};

use crate::{
    conditions::{Conditions, UPDATE_PERIOD_NS},
    encoder::NoisyEncoder,
    group::{AxisState, Group},
    integrate::{STEP_NS, runge_kutta},
    lanes::LANES,
    stiffness::{STABILITY_LIMIT, fastest_rate},
    supply::Supply,
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
    /// Axes are simulated, but not what feeds them.
    #[error("supply, oil: found nothing; give the simulated machine its tables [supply] and [oil]")]
    NoHydraulics,
    /// A step that conditions cannot be taken at.
    #[error("step: found {found_ns} ns; allowed: a divisor of {UPDATE_PERIOD_NS} ns")]
    Step {
        /// The step, ns.
        found_ns: u64,
    },
    /// An axis is too fast for the step.
    #[error(
        "axis.{axis}.plant: found a motion at {rate:.3e} 1/s, too fast for the simulator's step; \
         allowed: up to {limit:.3e} 1/s; more mass or dead volume, or less damping, stiffness, leakage or rated_flow"
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
    groups: Vec<Group>,
    supply: Supply,
    hydraulics: Hydraulics,
    scenario: Scenario,
    /// Model time after which the scenario changes nothing more.
    changes_end_ns: u64,
    states: Vec<AxisState>,
    supply_pressure: f64,
    encoders: Vec<NoisyEncoder>,
    /// What the drive holds, in [-1, 1].
    commands: Vec<f64>,
    /// The pilot pressure is cut off.
    cut_off: bool,
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

    /// The same, integrated in steps of `step_ns`, which has to divide 1 ms: to see what the step does to the result.
    ///
    /// # Errors
    /// As above.
    pub fn with_step(machine: &Machine, seed: u64, step_ns: u64) -> Result<Self, PlantError> {
        let count = machine.axes.len();
        if count > MAX_AXES {
            return Err(PlantError::TooManyAxes { found: count });
        }
        if step_ns == 0 || !UPDATE_PERIOD_NS.is_multiple_of(step_ns) {
            return Err(PlantError::Step { found_ns: step_ns });
        }
        let (scenario, step) = (machine.scenario.clone(), seconds(step_ns));
        let mut axes = Vec::with_capacity(count);
        for axis in &machine.axes {
            let plant = axis.plant.as_ref().ok_or_else(|| PlantError::NoPlant { axis: axis.name.clone() })?;
            axes.push((axis, plant));
        }
        let hydraulics = machine.hydraulics.ok_or(PlantError::NoHydraulics)?;
        let mut encoders = Vec::with_capacity(count);
        for (index, (axis, plant)) in axes.iter().enumerate() {
            let rate = fastest_rate(axis, plant, &hydraulics, &scenario.changes, index);
            let limit = STABILITY_LIMIT / step;
            if rate > limit {
                return Err(PlantError::TooStiff { axis: axis.name.clone(), rate, limit });
            }
            encoders.push(NoisyEncoder::new(axis.encoder.resolution, plant.encoder_noise, seed, index));
        }
        let at_begin = |index| Conditions::at(&scenario.changes, &hydraulics.oil, index, 0.0);
        let groups = axes.chunks(LANES).enumerate();
        let groups: Vec<Group> =
            groups.map(|(i, axes)| Group::new(axes, i * LANES, &hydraulics, at_begin, step)).collect();
        let mut plant = Self {
            supply: supply(&hydraulics, &groups),
            groups,
            hydraulics,
            changes_end_ns: changes_end_ns(&scenario),
            scenario,
            states: Vec::with_capacity(count),
            supply_pressure: hydraulics.supply.pressure,
            encoders,
            commands: vec![0.0; count],
            cut_off: false,
            step_ns,
            time_ns: 0,
            remainder_ns: 0,
            drive_ends_ns: 0,
            drive_timeout_ns: nanoseconds(machine.timing.drive_timeout),
            readings: 0,
        };
        plant.observe();
        Ok(plant)
    }

    /// Gives the drive a command for every axis; one that is not finite is neutral, one beyond [-1, 1] is held there,
    /// and all are neutral with the pilot pressure cut off. A drive that goes neutral by itself leaves that as it is.
    pub fn command(&mut self, command: &ValveCommand) {
        self.cut_off = command.cut_off != 0;
        for (held, axis) in self.commands.iter_mut().zip(&command.axes) {
            let is_command = axis.command.is_finite() && !self.cut_off;
            *held = if is_command { axis.command.clamp(-1.0, 1.0) } else { 0.0 };
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
        self.observe();
    }

    fn step(&mut self, steps: u64) {
        let step = seconds(self.step_ns);
        for _ in 0..steps {
            if self.time_ns <= self.changes_end_ns && self.time_ns.is_multiple_of(UPDATE_PERIOD_NS) {
                self.change_conditions(step);
            }
            runge_kutta(&mut self.groups, &self.commands, self.cut_off, &self.supply, step);
            self.time_ns += self.step_ns;
        }
    }

    fn change_conditions(&mut self, step: f64) {
        let time = seconds(self.time_ns);
        let now = |index| Conditions::at(&self.scenario.changes, &self.hydraulics.oil, index, time);
        for group in &mut self.groups {
            group.apply(now, &self.hydraulics, step);
        }
        self.supply = supply(&self.hydraulics, &self.groups);
    }

    /// Notes what can be seen from outside.
    fn observe(&mut self) {
        let share = self.supply.share(self.groups.iter().map(Group::demand_now).sum());
        self.states.clear();
        let mut pressure = f64::NEG_INFINITY;
        for group in &self.groups {
            for (state, fed) in group.observe(share) {
                self.states.push(state);
                pressure = pressure.max(fed.map_or(pressure, |fed| self.supply.sagged(share, fed)));
            }
        }
        // Where nobody is fed nothing sags.
        self.supply_pressure = if pressure.is_finite() { pressure } else { self.supply.pressure };
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

    /// What is left of the supply pressure now, Pa.
    pub fn supply_pressure(&self) -> f64 {
        self.supply_pressure
    }

    /// Model time: the whole steps made so far.
    pub fn time(&self) -> Duration {
        Duration::from_nanos(self.time_ns)
    }
}

/// The pump; its conditions are the same for all axes.
fn supply(hydraulics: &Hydraulics, groups: &[Group]) -> Supply {
    let at = groups.first().map_or(Conditions::NOMINAL, Group::first_conditions);
    Supply { pressure: hydraulics.supply.pressure * at.supply_pressure, flow: hydraulics.supply.flow * at.pump_flow }
}

/// The first time at which conditions are taken and every change has ended.
fn changes_end_ns(scenario: &Scenario) -> u64 {
    let last = scenario.changes.iter().map(|change| change.end).fold(0.0, f64::max);
    ((last * 1e9).ceil() as u64).next_multiple_of(UPDATE_PERIOD_NS)
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

/// Whole nanoseconds; what 64 bits do not hold, 584 years, is held at their end.
fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests;
