//! The phases rest and pulses: the noise, and the levels that move the axis.

use super::{Experiment, abort::Abort, step::Step, terms::Phase};

/// Highest level of the pulses.
pub const PULSE_LIMIT: f64 = 0.6;
/// First level of the pulses, and its rise from pulse to pulse.
pub(super) const PULSE_STEP: f64 = 0.03;
/// Length of a pulse, s.
const PULSE_TIME: f64 = 0.25;
/// Wait after the pulses, s: the longest dead time, 0.5 s, and the valve's lag.
const PULSE_WAIT: f64 = 0.7;
/// Time at rest in which the noise is seen, s.
const REST_TIME: f64 = 0.5;
/// Multiple of the noise from which on motion is clear.
const CLEAR_NOISE: f64 = 5.0;
/// Multiple of the noise that is no motion.
const QUIET_NOISE: f64 = 2.0;
/// Part of the rise that an axis may swing back without having moved on its own.
const SWING: f64 = 0.4;

impl Experiment {
    /// Neutral until the noise is known.
    pub(super) fn rest(&mut self, position: f64) -> Result<f64, Abort> {
        if self.step.ticks >= self.ticks(REST_TIME) {
            let noise = self.step.highest - self.step.lowest;
            self.found.clear = self.found.clear.max(CLEAR_NOISE * noise);
            self.found.quiet = self.found.quiet.max(QUIET_NOISE * noise);
            self.watch.widen_band(noise);
            self.choose_aim()?;
            (self.phase, self.step) = (Phase::Pulses, Step::begin(position, 0.0, 0));
        }
        Ok(0.0)
    }

    /// A pulse in each direction that has not moved yet, and a wait after them.
    pub(super) fn pulses(&mut self, position: f64) -> Result<f64, Abort> {
        let length = self.ticks(PULSE_TIME);
        let searched = [0, 1].map(|side| self.found.directions[side].moving.is_infinite());
        let up = if searched[0] { length } else { 0 };
        let end = up + if searched[1] { length } else { 0 };
        let at = self.step.ticks - 1;
        if at < end {
            return Ok(if at < up { self.level } else { -self.level });
        }
        self.step.neutral_at.get_or_insert(at);
        if !self.stands(self.ticks(PULSE_WAIT)) {
            return Ok(0.0);
        }
        self.note_moved(searched);
        let highest = PULSE_LIMIT.min(self.limits.magnitude);
        if let Some(side) = self.found.directions.iter().position(|direction| direction.moving.is_infinite()) {
            if self.level >= highest {
                return Err(Abort::NoMotion { extend: side == 0, level: highest });
            }
            self.level = (self.level + PULSE_STEP).min(highest);
            self.step = Step::begin(position, 0.0, 0);
        } else {
            self.choose_aim()?;
            self.phase = Phase::Strokes;
            self.begin_stroke(position);
        }
        Ok(0.0)
    }

    /// Notes which of the searched directions have moved.
    fn note_moved(&mut self, searched: [bool; 2]) {
        let rise = self.step.highest - self.step.from;
        let clear = self.found.clear;
        let moved = [rise > clear, self.step.fall > clear.max(SWING * rise)];
        for side in 0..2 {
            if searched[side] && moved[side] {
                self.found.directions[side].moving = self.level;
            }
        }
        if moved[usize::from(searched[1])] {
            self.learn_reaction();
        }
    }
}
