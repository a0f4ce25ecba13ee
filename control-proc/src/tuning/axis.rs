//! The axis of a simulation: the commissioned model, or one that differs from it, in small steps.
//!
//! The equations are those of [`super`]. Without a load that swings the speed is that of the curve.

use std::{collections::VecDeque, f64::consts::TAU};

use pipeline::machine::Commissioned;

use super::Plant;

/// Swing of a load on its spring of oil.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    /// w, rad/s; 0 for a stiff load.
    pub frequency: f64,
    /// zeta.
    pub damping: f64,
}

/// A simulated axis.
pub struct SimulatedAxis<'a> {
    model: &'a Commissioned,
    gain: f64,
    swing: Swing,
    /// s.
    step: f64,
    decay: f64,
    underway: VecDeque<f64>,
    /// Spool behind the play, and spool.
    w: f64,
    x: f64,
    speed: f64,
    acceleration: f64,
    /// y, m.
    pub position: f64,
}

impl<'a> SimulatedAxis<'a> {
    /// At rest at `position` m. `plant` is how it differs from `model`, `step` the step of the simulation in s.
    pub fn new(model: &'a Commissioned, plant: Plant, swing: Swing, step: f64, position: f64) -> Self {
        let lag = plant.lag * model.time_constant;
        let underway = (plant.dead_time * model.dead_time / step).round() as usize;
        Self {
            model,
            gain: plant.gain,
            swing,
            step,
            decay: if lag > 0.0 { (-step / lag).exp() } else { 0.0 },
            underway: std::iter::repeat_n(0.0, underway).collect(),
            w: 0.0,
            x: 0.0,
            speed: 0.0,
            acceleration: 0.0,
            position,
        }
    }

    /// At rest at 0, as `model` says, with the swing that it has.
    pub fn of(model: &'a Commissioned, step: f64) -> Self {
        let swing = Swing { frequency: TAU * model.natural_frequency, damping: model.damping };
        let lag =
            if model.time_constant > 0.0 { (1.0 - model.swing_delay() / model.time_constant).max(0.0) } else { 1.0 };
        Self::new(model, Plant { gain: 1.0, dead_time: 1.0, lag }, swing, step, 0.0)
    }

    /// With `gain` times its gain.
    pub fn with_gain(self, gain: f64) -> Self {
        Self { gain: gain * self.gain, ..self }
    }

    /// A step with `command` on the valve.
    pub fn advance(&mut self, command: f64) {
        let (Swing { frequency, damping }, step) = (self.swing, self.step);
        let half = 0.5 * self.model.hysteresis;
        self.underway.push_back(command);
        let acting = self.underway.pop_front().unwrap_or(command);
        self.w = self.w.clamp(acting - half, acting + half);
        self.x = self.w + (self.x - self.w) * self.decay;
        let wanted = self.gain * self.model.spool_speed(self.x);
        if frequency > 0.0 {
            let lacking = wanted - self.speed;
            self.acceleration += (frequency * lacking - 2.0 * damping * self.acceleration) * frequency * step;
            self.speed += self.acceleration * step;
        } else {
            self.speed = wanted;
        }
        self.position += self.speed * step;
    }
}
