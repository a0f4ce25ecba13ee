//! The phases rest and pulses: the noise, and the levels that move the axis.

use super::{CLEAR, Experiment, abort::Abort, step::Step, terms::Phase, watch::SWING};

/// Highest level of the pulses.
pub const PULSE_LIMIT: f64 = 0.6;
/// First level of the pulses, and its least rise from pulse to pulse.
pub(super) const PULSE_STEP: f64 = 0.03;
/// Rise from pulse to pulse as part of the level, where that is more.
const PULSE_RISE: f64 = 0.1;
/// Length of a pulse, s, and the longest one: in a pulse a part of the speed bound makes a clear motion.
const PULSE_TIME: (f64, f64) = (0.5, 2.0);
/// Length of a pulse by the response of the pump, which has to come up to the load's pressure first.
const PUMP_RESPONSES: f64 = 5.0;
const PULSE_SPEED: f64 = 0.2;
/// Wait after the pulses, s: the longest dead time, 0.5 s, and the valve's lag.
const PULSE_WAIT: f64 = 0.7;
/// Time at rest in which the noise is seen, s.
const REST_TIME: f64 = 0.5;
/// Longest time at rest, s, for an axis whose creep changes.
const LONGEST_REST: f64 = 3.0;
/// Part of a clear motion by which the creep during pulses may be unknown.
const CREEP: f64 = 0.25;
/// Multiple of the noise from which on motion is clear.
const CLEAR_NOISE: f64 = 5.0;
/// Multiple of the noise that is no motion.
const QUIET_NOISE: f64 = 2.0;

impl Experiment {
    /// Neutral until the noise is known.
    pub(super) fn rest(&mut self, position: f64) -> Result<f64, Abort> {
        if self.step.ticks >= self.ticks(REST_TIME) {
            let drift = self.drift(position);
            let before = std::mem::replace(&mut self.found.drift, drift);
            let change = (drift - before).abs() * self.ticks(2.0 * self.pulse_time() + PULSE_WAIT) as f64;
            if change > CREEP * self.found.clear && self.tick < self.ticks(LONGEST_REST) {
                self.step = Step::begin(position, 0.0, 0);
                return Ok(0.0);
            }
            let noise = self.step.reached.highest.position - self.step.reached.lowest.position;
            self.found.clear = self.found.clear.max(CLEAR_NOISE * noise);
            self.found.quiet = self.found.quiet.max(QUIET_NOISE * noise);
            self.watch.widen_band(noise);
            self.choose_aim()?;
            (self.phase, self.step) = (Phase::Pulses, Step::begin(position, 0.0, 0));
        }
        Ok(0.0)
    }

    /// A pulse in each direction that has not moved yet, until one has moved. Pulses in both directions follow one
    /// another; after those in a single direction there is a wait in which every dead time ends.
    pub(super) fn pulses(&mut self, position: f64) -> Result<f64, Abort> {
        let length = self.ticks(self.pulse_time());
        let searched = [0, 1].map(|side| self.found.directions[side].moving.is_infinite());
        let up = if searched[0] { length } else { 0 };
        let end = up + if searched[1] { length } else { 0 };
        let at = self.step.ticks - 1;
        let is_both = searched == [true; 2];
        let is_last = self.pulse.level >= PULSE_LIMIT.min(self.limits.magnitude);
        if self.step.neutral_at.is_none() {
            if at < end && self.moved(searched) == [false; 2] {
                return Ok(if at < up { self.pulse.level } else { -self.pulse.level });
            }
            if is_both && at >= end && !is_last {
                self.learn_drift(position);
                self.raise_level(position);
                return Ok(self.pulse.level);
            }
            self.step.neutral_at = Some(at);
        }
        if !self.stands(self.ticks(PULSE_WAIT)) {
            return Ok(0.0);
        }
        let moved = self.note_moved(searched, position);
        if let Some(side) = self.found.directions.iter().position(|direction| direction.moving.is_infinite()) {
            if moved {
                self.step = Step::begin(position, 0.0, 0);
            } else if is_last {
                return Err(self.no_motion(side, self.pulse.level));
            } else {
                self.raise_level(position);
            }
        } else {
            self.choose_aim()?;
            self.phase = Phase::Strokes;
            self.begin_stroke(position);
        }
        Ok(0.0)
    }

    /// Length of a pulse, s.
    fn pulse_time(&self) -> f64 {
        let clear = self.found.clear / (PULSE_SPEED * self.window.fastest);
        clear.max(PUMP_RESPONSES * self.pulse.pump_response).clamp(PULSE_TIME.0, PULSE_TIME.1)
    }

    /// No motion in the direction in place `side` at `level`.
    pub(super) fn no_motion(&self, side: usize, level: f64) -> Abort {
        Abort::NoMotion { extend: side == 0, level, seen: self.found.clear / self.pulse_time() }
    }

    /// Begins the pulses of the next level.
    fn raise_level(&mut self, position: f64) {
        let highest = PULSE_LIMIT.min(self.limits.magnitude);
        self.pulse.level = (self.pulse.level + PULSE_STEP.max(PULSE_RISE * self.pulse.level)).min(highest);
        self.step = Step::begin(position, 0.0, 0);
    }

    /// Way of this step per tick, m: an axis whose oil leaks creeps.
    fn drift(&self, position: f64) -> f64 {
        (position - self.step.from) / self.step.ticks.max(1) as f64
    }

    /// Takes in how the axis creeps. Where a coarse encoder makes a clear motion long, not after pulses that have moved
    /// the axis: that motion is not its own, and the next step would see the opposite one where there is none.
    fn learn_drift(&mut self, position: f64) {
        let is_stirred = self.step.reached.highest.position - self.step.reached.lowest.position > self.found.quiet;
        if self.found.clear <= CLEAR || !is_stirred {
            self.found.drift = self.drift(position);
        }
    }

    /// Which of the searched directions have moved in this step.
    fn moved(&self, searched: [bool; 2]) -> [bool; 2] {
        let rise = self.step.reached.highest.position - self.step.from;
        let clear = self.found.clear;
        [searched[0] && rise > clear, searched[1] && self.step.reached.fall > clear.max(SWING * rise)]
    }

    /// Notes which of the searched directions have moved. Returns whether one has.
    fn note_moved(&mut self, searched: [bool; 2], position: f64) -> bool {
        let moved = self.moved(searched);
        for side in (0..2).filter(|side| moved[*side]) {
            self.found.directions[side].moving = self.pulse.level;
        }
        if moved == [false; 2] {
            self.learn_drift(position);
            return false;
        }
        self.learn_reaction(usize::from(moved[1]));
        true
    }
}
