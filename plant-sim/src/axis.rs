//! One axis: its valve and its cylinder through time.

use pipeline::machine::{Axis, DeadBand, Plant};

use crate::{
    cylinder::{Cylinder, LOWEST_PRESSURE},
    integrate::runge_kutta,
    schedule::{Factors, UPDATE_PERIOD_NS},
    valve::{DelayLine, Valve},
};

/// What changes from step to step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisState {
    /// y, m, 0 with the rod in.
    pub position: f64,
    /// v, m/s, positive extends.
    pub velocity: f64,
    /// p1, Pa.
    pub piston_pressure: f64,
    /// p2, Pa.
    pub rod_pressure: f64,
    /// x_v in [-1, 1], positive extends.
    pub spool_position: f64,
}

/// The dynamics of one axis.
#[derive(Debug, Clone)]
pub struct AxisDynamics {
    plant: Plant,
    stroke: f64,
    step_ns: u64,
    time_ns: u64,
    delay: DelayLine,
    valve: Valve,
    cylinder: Cylinder,
}

impl AxisDynamics {
    /// The axis and its state at rest: at its initial position, valve shut, its load held.
    ///
    /// `step_ns` divides the period of schedules; the dead time is rounded to whole steps.
    pub fn new(axis: &Axis, plant: &Plant, step_ns: u64) -> (Self, AxisState) {
        debug_assert!(UPDATE_PERIOD_NS.is_multiple_of(step_ns));
        let factors = Factors::at(&plant.schedule, 0.0);
        let cylinder = Cylinder::new(plant, axis.stroke, &factors);
        let (piston_pressure, rod_pressure) = cylinder.pressures_at_rest(plant.initial_position);
        let dynamics = Self {
            plant: plant.clone(),
            stroke: axis.stroke,
            step_ns,
            time_ns: 0,
            delay: DelayLine::new((plant.dead_time / seconds(step_ns)).round() as usize),
            valve: valve(plant, &factors, step_ns),
            cylinder,
        };
        let state = AxisState {
            position: plant.initial_position,
            velocity: 0.0,
            piston_pressure,
            rod_pressure,
            spool_position: 0.0,
        };
        (dynamics, state)
    }

    /// Advances `state` by `steps` steps under a constant command in [-1, 1].
    pub fn advance(&mut self, state: &mut AxisState, command: f64, steps: u64) {
        let step = seconds(self.step_ns);
        let mut z = [state.position, state.velocity, state.piston_pressure, state.rod_pressure];
        let mut spool = state.spool_position;
        let mut opening = self.valve.opening(spool);
        for _ in 0..steps {
            if !self.plant.schedule.is_empty() && self.time_ns.is_multiple_of(UPDATE_PERIOD_NS) {
                self.apply_schedule();
                opening = self.valve.opening(spool);
            }
            let (middle, end) = self.valve.spool_after(spool, self.delay.pass(command));
            let openings = [opening, self.valve.opening(middle), self.valve.opening(end)];
            z = runge_kutta(z, openings, step, |z, opening| self.cylinder.rates(z, opening));
            z[2] = z[2].max(LOWEST_PRESSURE);
            z[3] = z[3].max(LOWEST_PRESSURE);
            (spool, opening) = (end, openings[2]);
            self.time_ns += self.step_ns;
        }
        let [position, velocity, piston_pressure, rod_pressure] = z;
        *state = AxisState { position, velocity, piston_pressure, rod_pressure, spool_position: spool };
    }

    fn apply_schedule(&mut self) {
        let factors = Factors::at(&self.plant.schedule, seconds(self.time_ns));
        self.cylinder = Cylinder::new(&self.plant, self.stroke, &factors);
        self.valve = valve(&self.plant, &factors, self.step_ns);
    }
}

fn valve(plant: &Plant, factors: &Factors, step_ns: u64) -> Valve {
    let dead_band = DeadBand {
        extend: plant.dead_band.extend * factors.dead_band,
        retract: plant.dead_band.retract * factors.dead_band,
    };
    Valve::new(plant.valve_time_constant * factors.valve_time_constant, dead_band, seconds(step_ns))
}

fn seconds(ns: u64) -> f64 {
    ns as f64 * 1e-9
}
