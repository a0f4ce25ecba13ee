//! The whole machine: all axes, the drive that feeds their valves, the pump and the encoders.
//!
//! | module | what it holds |
//! |---|---|
//! | [`stiffness`] | which axes the integration step can integrate; used at construction only |
//! | `coupled` | the same for the axes that a linkage couples |
//! | [`energy`] | where the work of the pump goes |
//! | `drive` | the commands that the drive holds, and its time-out |
//! | `error` | [`PlantError`]: why a machine cannot be simulated |
//!
//! A command can ask to cut the pilot pressure off. While it does, neither dead time nor hysteresis acts: the springs
//! push the spools to neutral.
//!
//! Only the constructors allocate.

mod coupled;
mod drive;
pub mod energy;
mod error;
pub mod stiffness;

use std::time::Duration;

use mechanism::AXES;
use pipeline::{
    MAX_AXES,
    machine::{Axis, Change, Hydraulics, Machine, Parameter, Plant, Scenario},
    message::{EncoderReading, ValveCommand},
};

use crate::{
    conditions::{Conditions, UPDATE_PERIOD_NS, Work},
    coupling::Coupling,
    encoder::NoisyEncoder,
    hydraulics::supply::Pump,
    integration::{
        FourAxes, TrueState,
        runge_kutta::{STEP_NS, runge_kutta},
    },
    lanes::LANES,
};

use coupled::fastest_coupled_rate;
use drive::Drive;
pub use error::PlantError;
use stiffness::{STABILITY_LIMIT, fastest_rate};

/// The simulated machine.
#[derive(Debug, Clone)]
pub struct PlantSim {
    /// All axes, four by four, in the machine's order.
    axes: Vec<FourAxes>,
    pump: Pump,
    hydraulics: Hydraulics,
    scenario: Scenario,
    /// What the bucket of the mechanism carries before all changes, kg.
    payload: f64,
    /// Model time after which the scenario changes nothing more, ns.
    changes_end_ns: u64,
    states: Vec<TrueState>,
    /// Supply pressure that is left now, Pa.
    supply_pressure: f64,
    encoders: Vec<NoisyEncoder>,
    drive: Drive,
    step_ns: u64,
    time_ns: u64,
    /// Time that was asked for and is not yet a whole step, ns.
    remainder_ns: u64,
    /// Number of readings so far.
    readings: u64,
}

impl PlantSim {
    /// The machine at rest: every axis at its initial position, valves shut, loads held. `seed` determines the encoder
    /// noise.
    ///
    /// # Errors
    /// The machine has no hydraulics or too many axes, or an axis has no plant or is too stiff for the step.
    pub fn new(machine: &Machine, seed: u64) -> Result<Self, PlantError> {
        Self::with_step(machine, seed, STEP_NS)
    }

    /// Builds the machine of [`Self::new`] with an integration step of `step_ns`, which has to divide 1 ms. A
    /// comparison of two steps shows the error of integration.
    ///
    /// # Errors
    /// Those of [`Self::new`], and a step that does not divide 1 ms.
    pub fn with_step(machine: &Machine, seed: u64, step_ns: u64) -> Result<Self, PlantError> {
        let count = machine.axes.len();
        if count > MAX_AXES {
            return Err(PlantError::TooManyAxes { found: count });
        }
        if step_ns == 0 || !UPDATE_PERIOD_NS.is_multiple_of(step_ns) {
            return Err(PlantError::Step { found_ns: step_ns });
        }
        let (scenario, step) = (acting(machine), seconds(step_ns));
        let plants = plants(machine)?;
        let coupling = coupling(machine)?;
        let payload = machine.mechanism.map_or(0.0, |mechanism| mechanism.masses.payload.mass);
        let hydraulics = machine.hydraulics.ok_or(PlantError::NoHydraulics)?;
        let mut encoders = Vec::with_capacity(count);
        for (index, (axis, plant)) in plants.iter().enumerate() {
            let is_coupled = coupling.is_some() && index < AXES;
            let rate = fastest_rate(axis, plant, &hydraulics, &scenario.changes, index);
            let limit = STABILITY_LIMIT / step;
            if rate > limit && !is_coupled {
                return Err(PlantError::TooStiff { axis: axis.name.clone(), rate, limit });
            }
            encoders.push(NoisyEncoder::new(axis.encoder.resolution, plant.encoder_noise, seed, index));
        }
        if let Some(coupling) = &coupling {
            let rate = fastest_coupled_rate(&plants, &hydraulics, coupling, &scenario.changes, payload);
            let limit = STABILITY_LIMIT / step;
            if !(rate <= limit) {
                return Err(PlantError::TooStiffTogether { rate, limit });
            }
        }
        let at_begin = |index| Conditions::at(&scenario.changes, &hydraulics.oil, index, 0.0);
        let fours = plants.chunks(LANES).enumerate();
        let mut axes: Vec<FourAxes> =
            fours.map(|(i, plants)| FourAxes::new(plants, i * LANES, &hydraulics, at_begin, step)).collect();
        if let Some(mut coupling) = coupling {
            let work = Work::at(&scenario.changes, payload, 0.0);
            coupling.work(work.payload, work.soil);
            axes[0].couple(coupling, &hydraulics);
        }
        let mut plant = Self {
            pump: pump(&hydraulics, &axes),
            axes,
            hydraulics,
            changes_end_ns: changes_end_ns(&scenario),
            scenario,
            payload,
            states: Vec::with_capacity(count),
            supply_pressure: hydraulics.supply.pressure,
            encoders,
            drive: Drive::new(count, nanoseconds(machine.timing.drive_timeout)),
            step_ns,
            time_ns: 0,
            remainder_ns: 0,
            readings: 0,
        };
        plant.observe();
        Ok(plant)
    }

    /// Gives the drive a command for every axis. A command that is not finite counts as neutral, one outside [-1, 1] is
    /// clamped, and all are neutral while `cut_off` asks for no pilot pressure. The pilot pressure stays cut off until
    /// a command no longer asks for it, also when the drive goes neutral by itself.
    pub fn command(&mut self, command: &ValveCommand) {
        self.drive.command(command, self.time_ns);
    }

    /// Advances model time by whole steps. The rest of `duration` is added to the next call's.
    pub fn advance(&mut self, duration: Duration) {
        self.remainder_ns = self.remainder_ns.saturating_add(nanoseconds(duration));
        let steps = self.remainder_ns / self.step_ns;
        self.remainder_ns %= self.step_ns;

        let driven = self.drive.remaining_ns(self.time_ns).div_ceil(self.step_ns).min(steps);
        self.step(driven);
        if driven < steps {
            self.drive.go_neutral();
            self.step(steps - driven);
        }
        self.observe();
    }

    fn step(&mut self, steps: u64) {
        let step = seconds(self.step_ns);
        for _ in 0..steps {
            if self.time_ns <= self.changes_end_ns && self.time_ns.is_multiple_of(UPDATE_PERIOD_NS) {
                self.update_conditions(step);
            }
            runge_kutta(&mut self.axes, self.drive.commands(), self.drive.is_cut_off(), &self.pump, step);
            self.time_ns += self.step_ns;
        }
    }

    /// Takes axes and pump to the conditions of this time.
    fn update_conditions(&mut self, step: f64) {
        let time = seconds(self.time_ns);
        let now = |index| Conditions::at(&self.scenario.changes, &self.hydraulics.oil, index, time);
        for axes in &mut self.axes {
            axes.apply(now, &self.hydraulics, step);
        }
        if let Some(first) = self.axes.first_mut() {
            first.work(Work::at(&self.scenario.changes, self.payload, time));
        }
        self.pump = pump(&self.hydraulics, &self.axes);
    }

    /// Updates the true states and the supply pressure that is left.
    fn observe(&mut self) {
        let share = self.pump.share(self.axes.iter().map(FourAxes::demand_now).sum());
        self.states.clear();
        let mut pressure = f64::NEG_INFINITY;
        for axes in &self.axes {
            for (state, fed) in axes.observe(share) {
                self.states.push(state);
                pressure = pressure.max(fed.map_or(pressure, |fed| self.pump.sagged(share, fed)));
            }
        }
        // The pressure does not sag while no chamber is fed.
        self.supply_pressure = if pressure.is_finite() { pressure } else { self.pump.pressure };
    }

    /// Reads all encoders, each with newly drawn noise. The reading is numbered; its times stay zero.
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
    pub fn axes(&self) -> &[TrueState] {
        &self.states
    }

    /// Supply pressure that is left now, Pa.
    pub fn supply_pressure(&self) -> f64 {
        self.supply_pressure
    }

    /// Model time: the whole steps made so far.
    pub fn time(&self) -> Duration {
        Duration::from_nanos(self.time_ns)
    }
}

/// Every axis with the parameters of its plant.
fn plants(machine: &Machine) -> Result<Vec<(&Axis, &Plant)>, PlantError> {
    let plants = machine.axes.iter().map(|axis| {
        let plant = axis.plant.as_ref().ok_or_else(|| PlantError::NoPlant { axis: axis.name.clone() })?;
        Ok((axis, plant))
    });
    plants.collect()
}

/// The linkage of the machine's first four axes, if it has one.
fn coupling(machine: &Machine) -> Result<Option<Coupling>, PlantError> {
    let Some(mechanism) = &machine.mechanism else {
        return Ok(None);
    };
    let axes: &[Axis; AXES] = machine.axes.first_chunk().ok_or(PlantError::TooFewAxes { found: machine.axes.len() })?;
    let coupling = Coupling::new(mechanism, axes.each_ref().map(|axis| axis.stroke), machine.soil.as_ref());
    coupling.map(Some).map_err(|(axis, position)| PlantError::Linkage { axis: axes[axis].name.clone(), position })
}

/// The scenario without what the machine does not have: where soil acts on the teeth of a mechanism, no other external
/// force acts on its axes.
fn acting(machine: &Machine) -> Scenario {
    let mut scenario = machine.scenario.clone();
    if machine.soil.is_some() {
        scenario.changes = scenario
            .changes
            .into_iter()
            .flat_map(|change| {
                let is_replaced = change.parameter == Parameter::ExternalForce;
                let first = if is_replaced { AXES } else { 0 };
                let axes = match change.axis {
                    None if is_replaced => (first..machine.axes.len()).map(Some).collect(),
                    axis => axis.filter(|axis| *axis < first).map_or(vec![axis], |_| Vec::new()),
                };
                axes.into_iter().map(move |axis| Change { axis, ..change })
            })
            .collect();
    }
    scenario
}

/// The pump now. Its conditions are equal for all axes, so those of the first axis are taken.
fn pump(hydraulics: &Hydraulics, axes: &[FourAxes]) -> Pump {
    let at = axes.first().map_or(Conditions::NOMINAL, FourAxes::first_conditions);
    Pump { pressure: hydraulics.supply.pressure * at.supply_pressure, flow: hydraulics.supply.flow * at.pump_flow }
}

/// The first time at which conditions are updated and every change has ended, ns.
fn changes_end_ns(scenario: &Scenario) -> u64 {
    let last = scenario.changes.iter().map(|change| change.end).fold(0.0, f64::max);
    ((last * 1e9).ceil() as u64).next_multiple_of(UPDATE_PERIOD_NS)
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}

/// Whole nanoseconds of a duration, limited to what 64 bits hold, 584 years.
fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests;
