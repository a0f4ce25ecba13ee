//! What can be said of the adaptive model without another measurement.
//!
//! ```text
//! pole radius   max |root of A|
//! gain ratio    s(h) N(u_mean) of the adaptive over that of the classical model, for u > 0 and for u < 0
//! excitation    part of the samples of the last 20 horizons whose regressor has a command of that sign
//! ```
//!
//! s(h) the step response of the linear half after h samples, u_mean the mean command of each sign so far. Trap: b and N share a free factor, so neither has a gain of its own.

use pipeline::{
    hammerstein::{Coefficients, MAX_A},
    message::{AxisSnapshot, model_fault},
    statistics::ErrorStatistics,
};

/// Time constant of the excitation, in horizons.
const EXCITATION: f64 = 20.0;
/// Excitation of one sign below which it is as good as forgotten, when the other is above it.
const ONE_SIDED: f64 = 0.01;
/// A gain beyond this factor of the classical one, or below its inverse, is no wear or warm-up.
const GAIN: f64 = 4.0;
/// Steps of a step response that are worth computing.
const LONGEST_STEP: usize = 100;

/// The health of one axis's model.
#[derive(Debug, Clone)]
pub struct Health {
    horizon: usize,
    keep: f64,
    /// Samples until poles and gains are looked at again: they cost more than an update.
    until: usize,
    /// Positive, and negative commands.
    commands: [ErrorStatistics; 2],
    excitation: [f64; 2],
    pole_radius: f64,
    gain_ratio: [f64; 2],
}

impl Health {
    /// For a horizon in samples; both signs count as excited until the samples say otherwise.
    pub fn new(horizon: usize) -> Self {
        Self {
            horizon,
            keep: (-1.0 / (EXCITATION * horizon as f64)).exp(),
            until: 0,
            commands: [ErrorStatistics::default(); 2],
            excitation: [1.0; 2],
            pole_radius: 1.0,
            gain_ratio: [1.0; 2],
        }
    }

    /// Takes in the newest command, and whether positive and negative ones contribute to the row of the sample.
    pub fn excite(&mut self, command: f64, signs: [bool; 2]) {
        self.commands[usize::from(command < 0.0)].push(command);
        for (excitation, excited) in self.excitation.iter_mut().zip(signs) {
            *excitation = self.keep * *excitation + (1.0 - self.keep) * f64::from(u8::from(excited));
        }
    }

    /// Whether it is time to look at the models: a horizon after it last was.
    pub fn is_due(&mut self) -> bool {
        let due = self.until == 0;
        self.until = if due { self.horizon } else { self.until } - 1;
        due
    }

    /// Looks at the models.
    pub fn examine(&mut self, adaptive: &Coefficients, classical: &Coefficients) {
        self.pole_radius = adaptive.pole_radius();
        let steps = self.horizon.min(LONGEST_STEP);
        let response = step_response(adaptive, steps) / step_response(classical, steps);
        let (adaptive, classical) = (adaptive.nonlinearity(), classical.nonlinearity());
        for (ratio, command) in self.gain_ratio.iter_mut().zip(&self.commands) {
            let travel = response * adaptive.evaluate(command.mean) / classical.evaluate(command.mean);
            // A sign that was never commanded, or that moves nothing, has no ratio.
            *ratio = if travel.is_finite() { travel } else { 1.0 };
        }
    }

    /// Writes everything into the snapshot, and its fault bits.
    pub fn report(&self, state: &mut AxisSnapshot) {
        state.excitation = self.excitation;
        state.pole_radius = self.pole_radius;
        state.gain_ratio = self.gain_ratio;
        let [positive, negative] = self.excitation;
        if positive.min(negative) < ONE_SIDED && positive.max(negative) >= ONE_SIDED {
            state.faults |= model_fault::ONE_SIDED;
        }
        if self.pole_radius > 1.0 + 1.0 / self.horizon as f64 || self.pole_radius.is_nan() {
            state.faults |= model_fault::UNSTABLE;
        }
        if !self.gain_ratio.iter().all(|ratio| (1.0 / GAIN..=GAIN).contains(ratio)) {
            state.faults |= model_fault::GAIN;
        }
    }
}

/// The output `steps` samples after x rises to 1 and nk have passed.
fn step_response(model: &Coefficients, steps: usize) -> f64 {
    let mut past = [0.0; MAX_A];
    for step in 0..steps {
        let driven: f64 = model.b().iter().take(step + 1).sum();
        let autoregressive: f64 = model.a().iter().zip(&past).map(|(a, y)| a * y).sum();
        past.rotate_right(1);
        past[0] = driven - autoregressive;
    }
    past[0]
}
