//! The phase of strokes: the levels that make the allowed speed.

use super::{Experiment, LEAST_RANDOM, abort::Abort, side_of, signed, step::Step, terms::Phase};

/// Opening of the first stroke above the level that moved the axis.
const FIRST_OPENING: f64 = 0.015;
/// How long a stroke goes on once the axis moves, s.
pub(super) const STROKE_TIME: f64 = 0.4;
/// How long a stroke waits for motion beyond the reaction that is known, s.
const STROKE_PATIENCE: f64 = 1.0;
/// Wait after a stroke beyond the reaction that is known, s.
const STROKE_WAIT: f64 = 0.2;
/// Part of the speed to aim at that ends the strokes of a direction.
const FAST_ENOUGH: f64 = 0.75;
/// Part of the speed to aim at for which the next level is chosen.
const AIM: f64 = 0.9;
/// Largest factor of the opening from stroke to stroke.
const LARGEST_FACTOR: f64 = 2.0;
/// Least speed that the next level is chosen by, m/s.
const LEAST_SPEED: f64 = 1e-6;

impl Experiment {
    /// Whether the strokes of this direction have shown enough.
    fn is_fast_enough(&self, side: usize) -> bool {
        let direction = &self.found.directions[side];
        direction.is_full()
            || direction.last().is_some_and(|stroke| {
                stroke.speed >= FAST_ENOUGH * self.window.aim || stroke.level >= self.limits.magnitude
            })
    }

    /// Begins a stroke towards the middle of the window.
    pub(super) fn begin_stroke(&mut self, position: f64) {
        let side = usize::from(self.window.is_above_middle(position));
        let direction = &self.found.directions[side];
        let level = match direction.last() {
            None => direction.moving + FIRST_OPENING,
            Some(stroke) if self.is_fast_enough(side) => stroke.level,
            Some(stroke) => {
                let factor = (AIM * self.window.aim / stroke.speed.max(LEAST_SPEED)).sqrt().clamp(1.0, LARGEST_FACTOR);
                direction.moving + (stroke.level - direction.moving) * factor
            }
        };
        let level = level.min(self.limits.magnitude);
        self.step = Step::begin(position, signed(side, level), 0);
    }

    /// A stroke until the axis has moved for its time, and a wait until the axis stands.
    pub(super) fn stroke(&mut self, position: f64) -> Result<f64, Abort> {
        let Step { ticks, wanted, neutral_at, moved_at, .. } = self.step;
        if neutral_at.is_none() {
            let is_over = moved_at.is_some_and(|moved| ticks >= moved + self.ticks(STROKE_TIME))
                || ticks >= self.found.reaction + self.ticks(STROKE_PATIENCE)
                || self.would_leave(position, wanted);
            if !is_over {
                return Ok(wanted);
            }
            self.step.neutral_at = Some(ticks);
        }
        if !self.stands(self.found.reaction + self.ticks(STROKE_WAIT)) {
            return Ok(0.0);
        }
        let (side, level) = (side_of(wanted), wanted.abs());
        if moved_at.is_none() {
            return Err(Abort::NoMotion { extend: side == 0, level });
        }
        self.learn_reaction();
        self.choose_aim()?;
        self.found.directions[side].push(level, self.step.peak);
        if self.is_fast_enough(0) && self.is_fast_enough(1) {
            if self.tick + self.ticks(LEAST_RANDOM) > self.total {
                return Err(self.too_short());
            }
            self.phase = Phase::Random;
            self.step = Step::begin(position, 0.0, 0);
        } else {
            self.begin_stroke(position);
        }
        Ok(0.0)
    }
}
