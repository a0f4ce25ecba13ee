//! The whole machine: all axes, the drive that feeds their valves, the pump and the sensors.
//!
//! | module | what it holds |
//! |---|---|
//! | [`stiffness`] | which axes the integration step can integrate; used at construction only |
//! | `coupled` | the same for the axes that a linkage couples |
//! | [`energy`] | where the work of the pump goes |
//! | `drive` | the commands that the drive holds, and its time-out |
//! | `error` | [`PlantError`]: why a machine cannot be simulated |
//! | `observation` | the true states at a time, also between two steps |
//!
//! A command can ask to cut the pilot pressure off. While it does, neither dead time nor hysteresis acts: the springs
//! push the spools to neutral.
//!
//! Time passes in whole steps. A command that comes within a step acts from the next step on; states within a step are
//! interpolated.
//!
//! Only the constructors allocate.

mod coupled;
mod drive;
pub mod energy;
mod error;
mod observation;
pub mod stiffness;

use std::{cell::Cell, time::Duration};

use mechanism::{AXES, END_STOP_WAY, Pose};
use pipeline::{
    MAX_AXES,
    machine::{Axis, Hydraulics, Machine, Plant, Scenario},
    message::{EncoderReading, ValveCommand},
};

use crate::{
    conditions::{Conditions, Work, acting, relative_viscosity},
    coupling::Coupling,
    hydraulics::supply::{Demand, Pump},
    integration::{
        FourAxes, TrueState,
        runge_kutta::{LONGEST_STEP_NS, STEP_NS, runge_kutta},
    },
    lanes::LANES,
    sensors::Sensors,
};

use coupled::{Worst, worst_of_coupled};
use drive::Drive;
pub use error::PlantError;
use observation::Observation;
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
    /// What is seen at the time that was asked for.
    observed: Observation,
    /// What is seen at begin and end of the step in which that time lies; used only for a time between two steps.
    around: [Observation; 2],
    sensors: Sensors,
    /// Whether a sensor has a lag.
    has_lag: bool,
    drive: Drive,
    step_ns: u64,
    /// End of the last step, ns.
    time_ns: u64,
    /// Time that was asked for, ns: at the end of the last step or within it.
    asked_ns: u64,
}

impl PlantSim {
    /// The machine at rest: every axis at its initial position, valves shut, loads held. `seed` determines the noise
    /// of the sensors.
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
        if step_ns == 0 || !LONGEST_STEP_NS.is_multiple_of(step_ns) {
            return Err(PlantError::Step { found_ns: step_ns });
        }
        let (scenario, step) = (acting(&machine.scenario, count, machine.soil.is_some()), seconds(step_ns));
        let plants = plants(machine)?;
        let mut coupling = coupling(machine)?;
        let payload = machine.mechanism.map_or(0.0, |mechanism| mechanism.masses.payload.mass);
        let hydraulics = machine.hydraulics.ok_or(PlantError::NoHydraulics)?;
        for (index, (axis, plant)) in plants.iter().enumerate() {
            let is_coupled = coupling.is_some() && index < AXES;
            let rate = fastest_rate(axis, plant, &hydraulics, &scenario.changes, index);
            let limit = STABILITY_LIMIT / step;
            if rate > limit && !is_coupled {
                return Err(PlantError::TooStiff { axis: axis.name.clone(), rate, limit });
            }
        }
        if let Some(coupling) = &mut coupling {
            let worst = worst_of_coupled(&plants, &hydraulics, coupling, &scenario.changes, payload);
            expect_possible(&worst, &plants, coupling, STABILITY_LIMIT / step)?;
        }
        let at_begin = |index| Conditions::at(&scenario.changes, &hydraulics.oil, index, 0.0);
        let pump = pump(&hydraulics, &at_begin(0));
        let fours = plants.chunks(LANES).enumerate();
        let mut axes: Vec<FourAxes> = fours
            .map(|(i, plants)| FourAxes::new(plants, i * LANES, &hydraulics, pump.pressure, at_begin, step))
            .collect();
        if let Some(mut coupling) = coupling {
            let work = Work::at(&scenario.changes, payload, 0.0);
            coupling.work(work.payload, work.soil);
            axes[0].couple(coupling, &hydraulics, pump.pressure);
        }
        let pose = pose(&axes);
        let sensors = Sensors::new(&plants, seed, pose.as_ref());
        let mut plant = Self {
            pump,
            axes,
            hydraulics,
            scenario,
            payload,
            observed: Observation::with_room(count),
            around: [Observation::with_room(count), Observation::with_room(count)],
            has_lag: sensors.has_lag(),
            sensors,
            drive: Drive::new(count, nanoseconds(machine.timing.drive_timeout)),
            step_ns,
            time_ns: 0,
            asked_ns: 0,
        };
        let room = std::mem::take(&mut plant.observed);
        plant.observed = plant.observe(room);
        Ok(plant)
    }

    /// Gives the drive a command for every axis. A command that is not finite counts as neutral, one outside [-1, 1] is
    /// clamped, and all are neutral while `cut_off` asks for no pilot pressure. The pilot pressure stays cut off until
    /// a command no longer asks for it, also when the drive goes neutral by itself.
    pub fn command(&mut self, command: &ValveCommand) {
        self.drive.command(command, self.asked_ns);
    }

    /// Advances model time by `duration`. The steps that begin before the new time are made.
    pub fn advance(&mut self, duration: Duration) {
        self.asked_ns = self.asked_ns.saturating_add(nanoseconds(duration));
        let steps = self.asked_ns.saturating_sub(self.time_ns).div_ceil(self.step_ns);
        let within = self.asked_ns % self.step_ns;
        if within == 0 {
            self.drive_for(steps);
            let old = std::mem::take(&mut self.observed);
            self.observed = self.observe(old);
            return;
        }
        let [mut begin, mut end] = std::mem::take(&mut self.around);
        if let Some(before) = steps.checked_sub(1) {
            self.drive_for(before);
            begin = self.observe(begin);
            self.drive_for(1);
            end = self.observe(end);
        }
        self.observed.interpolate(&begin, &end, within as f64 / self.step_ns as f64);
        self.around = [begin, end];
    }

    /// Makes `steps` steps, during which the drive may go neutral.
    fn drive_for(&mut self, steps: u64) {
        let driven = self.drive.remaining_ns(self.time_ns).div_ceil(self.step_ns).min(steps);
        self.step(driven);
        if driven < steps {
            self.drive.go_neutral();
            self.step(steps - driven);
        }
    }

    fn step(&mut self, steps: u64) {
        let step = seconds(self.step_ns);
        for _ in 0..steps {
            // Conditions are constant during the step; those in its middle are right to second order.
            let middle = seconds(self.time_ns) + 0.5 * step;
            if self.scenario.changes.iter().any(|change| change.start <= middle && middle <= change.end + step) {
                self.update_conditions(middle, step);
            }
            runge_kutta(&mut self.axes, self.drive.commands(), self.drive.is_cut_off(), &mut self.pump, step);
            self.time_ns += self.step_ns;
            if self.has_lag
                && let Some(pose) = pose(&self.axes)
            {
                self.sensors.follow(&pose, step);
            }
        }
    }

    /// Takes axes and pump to the conditions at `time` s.
    fn update_conditions(&mut self, time: f64, step: f64) {
        let oil = &self.hydraulics.oil;
        // All axes share the oil, so its viscosity is computed once: it takes longer than a step.
        let known = Cell::new((oil.temperature, 1.0));
        let viscosity = |temperature| {
            if known.get().0 != temperature {
                known.set((temperature, relative_viscosity(oil, temperature)));
            }
            known.get().1
        };
        let now = |index| Conditions::with(&self.scenario.changes, oil.temperature, index, time, viscosity);
        for axes in &mut self.axes {
            axes.apply(now, &self.hydraulics, step);
        }
        if let Some(first) = self.axes.first_mut() {
            first.work(Work::at(&self.scenario.changes, self.payload, time));
        }
        self.pump.limit(pump(&self.hydraulics, &now(0)));
    }

    /// The true states and the supply pressure that is left at the end of the last step, in the memory of `old`.
    fn observe(&self, mut old: Observation) -> Observation {
        let supply = self.pump.pressure;
        let demand = self.axes.iter().map(|four| four.demand_now(supply)).fold(Demand::NONE, Demand::and);
        let share = self.pump.share(&demand, supply);
        old.states.clear();
        let mut pressure = f64::NEG_INFINITY;
        for axes in &self.axes {
            for (state, fed) in axes.observe(share, supply) {
                old.states.push(state);
                if fed.is_finite() {
                    pressure = pressure.max(self.pump.sagged(share, fed));
                }
            }
        }
        // The pressure does not sag while no chamber is fed.
        old.supply_pressure = if pressure.is_finite() { pressure } else { supply };
        if self.sensors.see_joints()
            && let Some(pose) = pose(&self.axes)
        {
            old.seen = self.sensors.seen(&pose);
        }
        old
    }

    /// Reads all sensors, each with newly drawn noise. The reading is numbered; its times stay zero.
    pub fn read(&mut self) -> EncoderReading {
        self.sensors.read(&self.observed.states, &self.observed.seen)
    }

    /// The true states of all axes, in the machine's order.
    pub fn axes(&self) -> &[TrueState] {
        &self.observed.states
    }

    /// Supply pressure that is left now, Pa.
    pub fn supply_pressure(&self) -> f64 {
        self.observed.supply_pressure
    }

    /// Model time, at which the states are.
    pub fn time(&self) -> Duration {
        Duration::from_nanos(self.asked_ns)
    }
}

/// The pose of the mechanism at the end of the last step, if there is one.
fn pose(axes: &[FourAxes]) -> Option<Pose> {
    let first = axes.first()?;
    Some(first.coupling()?.pose(&first.state()[0].to_array()))
}

/// Every axis with the parameters of its plant.
fn plants(machine: &Machine) -> Result<Vec<(&Axis, &Plant)>, PlantError> {
    let plants = machine.axes.iter().map(|axis| {
        let plant = axis.plant.as_ref().ok_or_else(|| PlantError::NoPlant { axis: axis.name.clone() })?;
        if axis.encoder.angle.is_some() && machine.mechanism.is_none() {
            return Err(PlantError::NoJoint { axis: axis.name.clone() });
        }
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
    coupling.map(Some).map_err(|(axis, flaw)| PlantError::Linkage { axis: axes[axis].name.clone(), flaw })
}

/// Refuses axes that are too fast for the step, whose limit is `limit` 1/s, and end stops so soft that the linkage does
/// not close where they hold the pistons.
fn expect_possible(
    worst: &Worst,
    plants: &[(&Axis, &Plant)],
    coupling: &mut Coupling,
    limit: f64,
) -> Result<(), PlantError> {
    if let Err((axis, _)) = coupling.sink(&worst.depths) {
        let ((axis, plant), depth) = (plants[axis], worst.depths[axis]);
        let least = plant.end_stop_stiffness * depth / END_STOP_WAY;
        return Err(PlantError::SoftStops { axis: axis.name.clone(), depth, least });
    }
    if worst.rate.is_nan() || worst.rate > limit {
        let (axis, by) = worst.cause();
        let place = axis.map_or("soil".to_owned(), |axis| format!("axis.{}.plant", plants[axis].0.name));
        return Err(PlantError::TooStiffTogether { place, by, rate: worst.rate, limit });
    }
    Ok(())
}

/// The idling pump under the conditions of the first axis; those of the pump are equal for all axes.
fn pump(hydraulics: &Hydraulics, conditions: &Conditions) -> Pump {
    Pump::new(&hydraulics.supply, conditions.supply_pressure, conditions.pump_flow)
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
