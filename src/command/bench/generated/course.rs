//! What moves the axis of a generated record.
//!
//! | class | is driven by |
//! |---|---|
//! | `feedback` | a proportional controller with feed-forward that follows three slow sines |
//! | `one-sided` | steps of both signs during the training, then of one sign |
//! | all others | steps of random level and length, with sines on them, turned back near the ends of the stroke |
//!
//! Every course may begin with a rest; that of `rest` rests again and again.

use super::{class::Class, plant::Plant};
use crate::command::bench::drawn::Draw;

/// Distance from the middle of the stroke, in parts of it, from which on steps lead back.
const TURN: f64 = 0.33;
/// Part of the record after which `one-sided` has one sign only: within the training.
const ONE_SIDED_FROM: f64 = 0.3;

/// Amplitude of the reference, in parts of the stroke.
const REFERENCE: f64 = 0.35;

/// A course.
pub struct Course {
    draw: Draw,
    class: Class,
    stroke: f64,
    slowness: f64,
    /// Length of the record, s.
    length: f64,
    amplitude: f64,
    /// Frequency in rad/s and phase of the sines.
    sines: [(f64, f64); 3],
    /// Level of the step and when it ends, s.
    step: (f64, f64),
    /// Whether the axis rests, and until when, s.
    rest: (bool, f64),
    /// Gain in 1/m, and speed in m/s of a full command.
    controller: (f64, f64),
}

impl Course {
    /// A course for `plant` over `length` s with samples of `period` s.
    pub fn new(mut draw: Draw, plant: &Plant, period: f64, length: f64) -> Self {
        let slowness = plant.slowness;
        let amplitude = draw.even(0.5..=1.0);
        let sines = std::array::from_fn(|_| {
            let frequency = if plant.class == Class::Feedback { 0.03..=0.4 } else { 0.1..=2.0 };
            (draw.log(frequency) * std::f64::consts::TAU / slowness, draw.even(0.0..=std::f64::consts::TAU))
        });
        let rests_first = draw.unit() < 0.5 || plant.class == Class::Rest;
        let first = slowness * draw.even(1.0..=4.0);
        let delay = plant.dead_time + plant.lag + 2.0 / plant.oscillation.0 + period;
        Self {
            class: plant.class,
            stroke: plant.stroke,
            slowness,
            length,
            amplitude,
            sines,
            step: (0.0, 0.0),
            rest: (rests_first, first),
            controller: (draw.even(0.15..=0.4) / (delay * plant.speed), plant.speed),
            draw,
        }
    }

    /// u(k) at the time in s and the position in m. The times of the calls must rise.
    pub fn command(&mut self, time: f64, position: f64) -> f64 {
        if time >= self.rest.1 {
            let rests = self.class == Class::Rest && !self.rest.0;
            let length = if rests { self.draw.log(2.0..=20.0) } else { self.draw.log(2.0..=15.0) };
            self.rest = (rests, time + self.slowness * length);
        }
        if self.rest.0 {
            return 0.0;
        }
        if time >= self.step.1 {
            self.next_step(time, position);
        }
        let sines = self.sines.iter().map(|(frequency, phase)| (frequency * time + phase).sin() / 3.0).sum::<f64>();
        if self.class == Class::Feedback {
            return self.follow(time, position, sines);
        }
        let command = self.step.0 + 0.25 * self.amplitude * sines;
        if self.is_one_sided(time) { command.clamp(0.05, 1.0) } else { command.clamp(-1.0, 1.0) }
    }

    fn is_one_sided(&self, time: f64) -> bool {
        self.class == Class::OneSided && time > ONE_SIDED_FROM * self.length
    }

    fn next_step(&mut self, time: f64, position: f64) {
        let length = self.slowness * self.draw.log(0.1..=2.5);
        let level = self.draw.even(-1.0..=1.0) * self.amplitude;
        let away = position / self.stroke - 0.5;
        let turn = if self.class == Class::Saturation { 2.0 * TURN } else { TURN };
        let level = match self.class {
            Class::OneSided if self.is_one_sided(time) => level.abs(),
            Class::OneSided => level,
            _ if away.abs() > turn => -level.abs() * away.signum(),
            _ => level,
        };
        self.step = (level, time + length);
    }

    /// The controller. Its feed-forward is for a linear valve.
    fn follow(&mut self, time: f64, position: f64, sines: f64) -> f64 {
        let slope = |(frequency, phase): &(f64, f64)| (frequency * time + phase).cos() * frequency / 3.0;
        let slope = REFERENCE * self.stroke * self.sines.iter().map(slope).sum::<f64>();
        let error = self.stroke * (0.5 + REFERENCE * sines) - position;
        let (gain, speed) = self.controller;
        (gain * error + slope / speed).clamp(-1.0, 1.0)
    }
}
