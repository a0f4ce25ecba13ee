//! What was commanded in an experiment, and what the axis did.

use mechanism::AXES;
use pipeline::machine::Machine;

use crate::load::dynamics_at_rest;

/// The record of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct ExperimentRecord {
    /// Sampling period, s.
    pub period: f64,
    /// Period of a load that the valve was seen to shake, s; 0 of one that it was not.
    pub swing: f64,
    /// u(k), held from sample k to the next, in [-1, 1].
    pub commands: Vec<f64>,
    /// y(k), m; NaN where there was no usable sample.
    pub positions: Vec<f64>,
    /// Force with which the cylinder holds the load at every sample, N; empty where it is not known.
    pub loads: Vec<f64>,
    /// Least pulls of a load that may overrun the axis while it extends and retracts, N.
    pub least_overruns: [f64; 2],
    /// Mean mass that moves with the axis, kg; infinite where it is not known.
    pub mass: f64,
}

/// Least pressure in the drained chamber at which an outlet passes more than the inlet, Pa: that of an outlet as wide
/// as the inlet of a cylinder of which one side is half as large as the other, behind a compensator of 2 MPa.
const LEAST_OVERRUNNING: f64 = 0.5e6;

impl ExperimentRecord {
    /// Nothing, of an axis whose load is not known; with room for so many samples every `period` s.
    pub fn new(period: f64, capacity: usize) -> Self {
        Self {
            period,
            swing: 0.0,
            commands: Vec::with_capacity(capacity),
            positions: Vec::with_capacity(capacity),
            loads: Vec::new(),
            least_overruns: [f64::INFINITY; 2],
            mass: f64::INFINITY,
        }
    }

    /// Takes in the load of the axis with this index, where `machine` has a mechanism: its axes were at `positions` m
    /// at the end of the experiment, in which the others stood.
    pub fn bear(&mut self, machine: &Machine, axis: usize, positions: &[f64]) {
        let (Some(mechanism), Some(places)) = (machine.mechanism.as_ref(), positions.first_chunk::<AXES>()) else {
            return;
        };
        if axis >= AXES || places.iter().any(|place| !place.is_finite()) {
            return;
        }
        let (prepared, mut places) = (mechanism.prepared(), *places);
        let mut masses = 0.0;
        let at = |position: &f64| {
            places[axis] = if position.is_finite() { *position } else { places[axis] };
            let dynamics = dynamics_at_rest(&prepared, &places);
            masses += dynamics.mass[axis][axis];
            dynamics.load[axis]
        };
        let loads: Vec<f64> = self.positions.iter().map(at).collect();
        self.mass = masses / loads.len() as f64;
        // Friction moves with the load as well, so small pulls say nothing.
        if let Some(plant) = machine.axes[axis].plant.as_ref() {
            self.least_overruns = [plant.rod_area, plant.piston_area].map(|area| LEAST_OVERRUNNING * area);
            self.loads = loads;
        }
    }
}
