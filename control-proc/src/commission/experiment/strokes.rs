//! The phase of strokes: the levels that make the allowed speed.

use super::{
    Experiment, LEAST_RANDOM, PULSE_LIMIT, abort::Abort, side_of, signed, step::Step, terms::Phase, watch::SWING,
};

/// Opening of the first stroke above the level that moved the axis.
const FIRST_OPENING: f64 = 0.015;
/// How long a stroke goes on once the axis moves, s.
pub(super) const STROKE_TIME: f64 = 0.4;
/// How long it has to move to say anything of its level, s. One that the window ends earlier is cut.
const SHORTEST: f64 = 0.2;
/// How long a stroke waits for motion beyond the reaction that is known, s, and by the response of the pump, where that
/// is longer.
const STROKE_PATIENCE: f64 = 1.0;
const PUMP_PATIENCE: f64 = 8.0;
/// Wait after a stroke beyond the reaction that is known, s.
const STROKE_WAIT: f64 = 0.2;
/// Time over which a load that swings is watched, s: the period of a swing of 2 Hz.
const SWING_TIME: f64 = 0.5;
/// Part of the speed to aim at that ends the strokes of a direction.
const FAST_ENOUGH: f64 = 0.75;
/// Part of the speed to aim at for which the next level is chosen.
const AIM: f64 = 0.9;
/// Largest factor of the opening from stroke to stroke.
const LARGEST_FACTOR: f64 = 3.0;
/// Least rise of the level from stroke to stroke.
const LEAST_OPENING: f64 = 0.005;

impl Experiment {
    /// Whether the strokes of this direction have shown enough.
    fn is_fast_enough(&self, side: usize) -> bool {
        let direction = &self.found.directions[side];
        direction.is_full()
            || direction.last().is_some_and(|stroke| {
                let room = self.found.cut[side].map_or(f64::INFINITY, |cut| cut - stroke.level);
                stroke.speed >= FAST_ENOUGH * self.window.aim
                    || stroke.level >= self.limits.magnitude
                    || room < LEAST_OPENING
            })
    }

    /// Begins a stroke towards the middle of the window.
    pub(super) fn begin_stroke(&mut self, position: f64) {
        let side = usize::from(self.window.is_above_middle(position));
        let direction = &self.found.directions[side];
        let level = match (direction.last(), self.found.cut[side]) {
            (None, _) => direction.moving + FIRST_OPENING,
            // Between what was seen and what the window had no room for.
            (Some(stroke), Some(cut)) => 0.5 * (stroke.level + cut),
            (Some(stroke), None) if self.is_fast_enough(side) => stroke.level,
            (Some(stroke), None) => {
                let wanted = direction.level(AIM * self.window.aim).max(stroke.level + LEAST_OPENING);
                wanted.min(direction.moving + (stroke.level - direction.moving) * LARGEST_FACTOR)
            }
        };
        let level = level.min(self.limits.magnitude);
        let swing = self.watch.range(self.ticks(SWING_TIME));
        self.step = Step { swing, ramp: self.ramp(side, level), ..Step::begin(position, signed(side, level), 0) };
    }

    /// A stroke until the axis has moved for its time, and a wait until the axis stands.
    pub(super) fn stroke(&mut self, position: f64) -> Result<f64, Abort> {
        let Step { ticks, wanted, neutral_at, moved_at, .. } = self.step;
        if neutral_at.is_none() {
            let is_over = moved_at.is_some_and(|moved| ticks >= moved + self.ticks(STROKE_TIME) + self.rise())
                || ticks
                    >= self.found.reaction + self.ticks(STROKE_PATIENCE.max(PUMP_PATIENCE * self.pulse.pump_response));
            let would_leave = !is_over && self.would_leave(position, wanted);
            if !is_over && !would_leave {
                return Ok(wanted);
            }
            self.step.neutral_at = Some(ticks);
            self.step.is_cut = would_leave && moved_at.is_none_or(|moved| ticks < moved + self.ticks(SHORTEST));
        }
        let (side, level) = (side_of(wanted), wanted.abs());
        let wait = self.found.reaction + self.ticks(STROKE_WAIT);
        let turned = self.step.farthest(side).at;
        let only_swings = moved_at.is_some() && ticks >= turned + wait + self.ticks(SWING_TIME);
        if !only_swings && !self.stands(wait) {
            return Ok(0.0);
        }
        let has_moved = moved_at.is_some() || self.has_moved(side);
        // What was under way may have shown more than the strokes before.
        let shown = self.found.directions[side].last().map_or(0.0, |stroke| stroke.speed);
        let is_cut = self.step.is_cut && (!has_moved || self.step.peak <= shown);
        if !has_moved && !is_cut {
            return self.search_again(side, level, position);
        }
        if has_moved {
            self.learn_reaction(side);
            self.learn_swing(side);
        }
        self.choose_aim()?;
        self.found.cut[side] = is_cut.then_some(level);
        if !is_cut {
            self.found.directions[side].push(level, self.step.peak);
        }
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

    /// Whether the way of a stroke that ended without clear motion is more than a swing: after a stroke that followed
    /// soon, most of the range before it is the way of the stroke before. A load swings back by a part of that way.
    fn has_moved(&self, side: usize) -> bool {
        let way = (self.step.farthest(side).position - self.step.from).abs();
        way > self.found.clear + SWING * self.step.swing
    }

    /// Goes back to pulses in a direction that a first stroke did not move: the motion that the pulses saw was another,
    /// such as a load that swung back. A second time there is no motion.
    fn search_again(&mut self, side: usize, level: f64, position: f64) -> Result<f64, Abort> {
        let direction = &mut self.found.directions[side];
        let is_last = level >= PULSE_LIMIT.min(self.limits.magnitude);
        if direction.last().is_some() || is_last || self.found.is_searched_again[side] {
            return Err(self.no_motion(side, level));
        }
        direction.moving = f64::INFINITY;
        self.found.is_searched_again[side] = true;
        self.pulse.level = level;
        (self.phase, self.step) = (Phase::Pulses, Step::begin(position, 0.0, 0));
        Ok(0.0)
    }
}
