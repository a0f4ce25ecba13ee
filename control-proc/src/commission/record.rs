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

    /// Standard deviation of the noise of the positions before the first command, m; 0 of a record without them.
    ///
    /// ```text
    /// sigma^2 = mean of (y(k-1) - 2 y(k) + y(k+1))^2 / 6
    /// ```
    ///
    /// An axis that drifts, or swings slowly, adds next to nothing to these differences.
    pub fn noise(&self) -> f64 {
        let rest = self.commands.iter().take_while(|command| **command == 0.0).count();
        let positions = &self.positions[..rest.min(self.positions.len())];
        let bends = positions.windows(3).map(|part| part[0] - 2.0 * part[1] + part[2]).filter(|bend| bend.is_finite());
        let (sum, count) = bends.fold((0.0, 0.0), |(sum, count), bend| (sum + bend * bend, count + 1.0));
        if count > 0.0 { (sum / (6.0 * count)).sqrt() } else { 0.0 }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A record of 0.5 s at rest and 0.5 s of commands; `position` of a time in s and a random number from -1 to 1.
    fn record(position: impl Fn(f64, f64) -> f64) -> ExperimentRecord {
        let mut record = ExperimentRecord::new(0.01, 100);
        let mut state: u64 = 7;
        for k in 0..100 {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let random = 2.0 * (state >> 11) as f64 / (1u64 << 53) as f64 - 1.0;
            record.commands.push(if k < 50 { 0.0 } else { 0.3 });
            record.positions.push(position(0.01 * f64::from(k), random));
        }
        record
    }

    #[test]
    fn the_noise_is_that_at_rest_less_drift_and_swing() {
        // Even noise of +- 0.3 mm has a standard deviation of 0.17 mm.
        let even = 0.3e-3 / 3f64.sqrt();
        let noise = |record: ExperimentRecord| record.noise();
        let rest = noise(record(|_, random| 0.6 + 3e-4 * random));
        assert!((0.8 * even..1.2 * even).contains(&rest), "{rest} {even}");
        let swings = |time: f64| 5e-3 * time + 0.1e-3 * (std::f64::consts::TAU * 2.0 * time).sin();
        let moves = noise(record(|time, random| 0.6 + swings(time) + 3e-4 * random));
        assert!((moves - rest).abs() < 0.01 * rest, "{moves} {rest}");
        assert!(noise(record(|time, _| 0.6 + swings(time))) < 1e-6);
        // What is commanded shows in nothing of it, nor does a missing sample.
        assert_eq!(noise(record(|time, random| if time < 0.5 { 0.6 } else { random })), 0.0);
        let gaps = noise(record(|time, random| if time == 0.1 { f64::NAN } else { 0.6 + 3e-4 * random }));
        assert!((gaps - rest).abs() < 0.1 * rest, "{gaps} {rest}");
        assert_eq!(ExperimentRecord::new(0.01, 10).noise(), 0.0);
    }
}
