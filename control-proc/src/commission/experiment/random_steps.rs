//! The phase of random steps: the data that the model is found from.

use super::{Experiment, signed, step::Step};

/// Part of the steps that are neutral.
const NEUTRAL_PART: f64 = 0.1;
/// Shortest step, s.
const SHORTEST: f64 = 0.1;
/// Range of the steps' lengths, s.
const LENGTH_RANGE: f64 = 0.7;
/// Part of the other steps of a fast valve that are long, and their length, s: what a pump that has to raise its
/// pressure keeps of a motion shows in them alone. Trap: the lag of a slow valve needs many steps.
const LONG_PART: f64 = 0.2;
const LONG: f64 = 2.5;
/// Longest reaction of a fast valve that does not shake its load, s.
const FAST: f64 = 0.1;
/// Wait at neutral where both directions would leave the window, s.
const WAIT: f64 = 0.1;

impl Experiment {
    /// The command of a random step that stays in the window.
    pub(super) fn random_steps(&mut self, position: f64) -> f64 {
        if self.step.ticks > self.step.length {
            let extends = self.random.uniform() < self.window.part_above(position);
            self.choose(position, if extends { 0 } else { 1 });
        }
        if self.would_leave(position, self.step.wanted) {
            let other = usize::from(self.step.wanted > 0.0);
            self.choose(position, other);
            if self.would_leave(position, self.step.wanted) {
                self.step = Step::begin(position, 0.0, self.ticks(WAIT));
            }
            return 0.0;
        }
        self.step.wanted
    }

    /// Begins a random step in one direction, or a neutral one.
    fn choose(&mut self, position: f64, side: usize) {
        self.learn_start();
        let direction = &self.found.directions[side];
        let low = self.closed(side);
        let high = direction.last().map_or(direction.moving, |stroke| stroke.level);
        let is_neutral = self.random.uniform() < NEUTRAL_PART;
        let is_fast = self.record.swing > 0.0 || self.found.reaction <= self.ticks(FAST);
        let is_long = is_fast && !is_neutral && self.random.uniform() < LONG_PART;
        let level = if is_neutral { 0.0 } else { low + (high - low) * self.random.uniform() };
        let seconds = if is_long { LONG } else { SHORTEST + LENGTH_RANGE * self.random.uniform() };
        let length = self.ticks(seconds) + self.rise();
        self.step = Step { ramp: self.ramp(side, level), ..Step::begin(position, signed(side, level), length) };
    }
}
