//! The valve by the equations in `plant_sim::valve`: dead time, hysteresis, first-order spool, curve.

use std::collections::VecDeque;

use pipeline::machine::{Parameter, Plant, ValveCurve};

use super::conditions::Conditions;

/// One valve over time. Between two updates its target and its time constant are constant.
pub struct Valve {
    plant: Plant,
    dead_time_ns: u64,
    /// Time at which each command begins to act, ns, and the command.
    given: VecDeque<(u64, f64)>,
    acting: f64,
    /// w.
    target: f64,
    /// x_v at the last update.
    spool: f64,
    time_constant: f64,
    dead_band: [f64; 2],
    span: [f64; 2],
}

impl Valve {
    pub fn new(plant: &Plant) -> Self {
        Self {
            plant: plant.clone(),
            dead_time_ns: (plant.dead_time * 1e9).round() as u64,
            given: VecDeque::new(),
            acting: 0.0,
            target: 0.0,
            spool: 0.0,
            time_constant: 1.0,
            dead_band: [0.0; 2],
            span: [1.0; 2],
        }
    }

    pub fn command(&mut self, now_ns: u64, command: f64) {
        self.given.push_back((now_ns + self.dead_time_ns, command));
    }

    /// Time at which the next command begins to act, ns.
    pub fn next_change(&self) -> Option<u64> {
        self.given.front().map(|(time, _)| *time)
    }

    /// Updates command and conditions to `now_ns`.
    pub fn update(&mut self, now_ns: u64, conditions: &Conditions, viscosity: f64) {
        while let Some(&(_, command)) = self.given.front().filter(|(time, _)| *time <= now_ns) {
            self.acting = command;
            self.given.pop_front();
        }
        let plant = &self.plant;
        let play = 0.5 * plant.hysteresis * conditions.factor(Parameter::Hysteresis);
        self.target = self.target.clamp(self.acting - play, self.acting + play);
        self.time_constant =
            plant.valve_time_constant * conditions.factor(Parameter::ValveTimeConstant) * viscosity.sqrt();
        let factor = conditions.factor(Parameter::DeadBand);
        let sides =
            [(plant.dead_band.extend, plant.saturation.extend), (plant.dead_band.retract, plant.saturation.retract)];
        self.dead_band = sides.map(|(dead_band, _)| (dead_band * factor).min(0.95));
        self.span = [0, 1].map(|side| (sides[side].1 - self.dead_band[side]).max(0.05));
    }

    /// x_v `after` s after the update.
    fn spool(&self, after: f64) -> f64 {
        self.target + (self.spool - self.target) * (-after / self.time_constant).exp()
    }

    /// Advances to `after` s after the update, which is the time of the next update.
    pub fn advance(&mut self, after: f64) {
        self.spool = self.spool(after);
    }

    /// X, `after` s after the update.
    pub fn opening(&self, after: f64) -> f64 {
        let spool = self.spool(after);
        let side = usize::from(spool < 0.0);
        let c = ((spool.abs() - self.dead_band[side]) / self.span[side]).clamp(0.0, 1.0);
        let opening = match self.plant.valve_curve {
            ValveCurve::Linear => c,
            ValveCurve::S => 3.0 * c.powi(2) - 2.0 * c.powi(3),
        };
        if spool < 0.0 { -opening } else { opening }
    }
}
