//! What can be said of the adaptive model without another measurement.
//!
//! ```text
//! pole radius   max |root of A|
//! gain ratio    s(h) N(u_mean) of the adaptive over that of the classical model, for u > 0 and for u < 0
//! excitation    part of the samples of the last 20 horizons whose regressor has a command of that sign
//! ```
//!
//! A, N denominator and nonlinearity of the model; s(h) step response of the linear part after h samples, h horizon;
//! u_mean mean command of each sign so far. Trap: b and N share a free factor, so neither has a gain of its own.

use pipeline::{
    hammerstein::{Coefficients, MAX_A},
    message::model_fault,
    statistics::ErrorStatistics,
};

/// Time constant of the excitation, in horizons.
const EXCITATION: f64 = 20.0;
/// Excitation below which a sign counts as forgotten while the other is above it.
const ONE_SIDED: f64 = 0.01;
/// Largest gain ratio that wear or warm-up may cause; its inverse is the least.
const GAIN: f64 = 4.0;
/// Largest number of steps that is computed of a step response.
const LONGEST_STEP: usize = 100;

/// The health of the models of one axis.
#[derive(Debug, Clone)]
pub struct Health {
    horizon: usize,
    keep: f64,
    /// Samples until the models are examined again. An examination costs more than an update.
    until: usize,
    /// Statistics of the positive commands and of the negative ones.
    commands: [ErrorStatistics; 2],
    excitation: [f64; 2],
    pole_radius: f64,
    gain_ratio: [f64; 2],
}

impl Health {
    /// For a horizon in samples. Both signs of the command count as excited at first.
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

    /// Takes in the newest command, and whether the row of the sample has positive and negative commands.
    pub fn excite(&mut self, command: f64, signs: [bool; 2]) {
        self.commands[usize::from(command < 0.0)].push(command);
        for (excitation, excited) in self.excitation.iter_mut().zip(signs) {
            *excitation = self.keep * *excitation + (1.0 - self.keep) * f64::from(u8::from(excited));
        }
    }

    /// Whether the models are to be examined at this sample: once per horizon. To be called once per sample.
    pub fn is_due(&mut self) -> bool {
        let due = self.until == 0;
        self.until = if due { self.horizon } else { self.until } - 1;
        due
    }

    /// Computes pole radius and gain ratios.
    pub fn examine(&mut self, adaptive: &Coefficients, classical: &Coefficients) {
        self.pole_radius = adaptive.pole_radius();
        let steps = self.horizon.min(LONGEST_STEP);
        let response = output_after_step(adaptive, steps) / output_after_step(classical, steps);
        let (adaptive, classical) = (adaptive.nonlinearity(), classical.nonlinearity());
        for (ratio, command) in self.gain_ratio.iter_mut().zip(&self.commands) {
            let travel = response * adaptive.evaluate(command.mean) / classical.evaluate(command.mean);
            // Without a command of this sign, or where it moves nothing, the quotient is no number.
            *ratio = if travel.is_finite() { travel } else { 1.0 };
        }
    }

    /// The largest magnitude of a pole of the adaptive model.
    pub fn pole_radius(&self) -> f64 {
        self.pole_radius
    }

    /// The gain ratios for positive and for negative commands.
    pub fn gain_ratio(&self) -> [f64; 2] {
        self.gain_ratio
    }

    /// The excitation by positive and by negative commands.
    pub fn excitation(&self) -> [f64; 2] {
        self.excitation
    }

    /// The [`model_fault`] bits of what was found.
    pub fn faults(&self) -> u32 {
        let mut faults = 0;
        let [positive, negative] = self.excitation;
        if positive.min(negative) < ONE_SIDED && positive.max(negative) >= ONE_SIDED {
            faults |= model_fault::ONE_SIDED;
        }
        if self.pole_radius > 1.0 + 1.0 / self.horizon as f64 || self.pole_radius.is_nan() {
            faults |= model_fault::UNSTABLE;
        }
        if !self.gain_ratio.iter().all(|ratio| (1.0 / GAIN..=GAIN).contains(ratio)) {
            faults |= model_fault::GAIN;
        }
        faults
    }
}

/// The output `steps` samples after x rose to 1, without the delay nk. It sums positions; the step response of the
/// controller sums differences and therefore differs in the last bits.
fn output_after_step(model: &Coefficients, steps: usize) -> f64 {
    let mut past = [0.0; MAX_A];
    for step in 0..steps {
        let driven: f64 = model.b().iter().take(step + 1).sum();
        let autoregressive: f64 = model.a().iter().zip(&past).map(|(a, y)| a * y).sum();
        past.rotate_right(1);
        past[0] = driven - autoregressive;
    }
    past[0]
}
