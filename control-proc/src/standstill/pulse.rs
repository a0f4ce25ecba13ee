//! A pulse: the command rises until the axis moves, and is shut ahead of the set point.
//!
//! ```text
//! u(k) = s l(k)        l(k+1) = min(l(k) + r T, d + 0.075) while s v < s e / (2 L)
//! r = max(s e, 2 e_rest) / (g L^2), with the e at which the axis begins to move from then on
//! over when s e <= s v L + g r L^2 / 2 after the axis has begun to move, given up when l is d + 0.075 for long
//! ```
//!
//! s sign at the begin of the following error, e that error without its noise m, l level of the command, T period in s,
//! v speed in m/s, L dead time, lag and the time by which e is smoothed in s, g slope of the static curve at the dead
//! band d in m/s, e_rest as in [`super`]. What is on its way through dead time and lag moves the axis by
//! v L + g r L^2 / 2 after the valve is shut. With this rate a pulse that is shut at once moves it by half of the
//! error. Source: inching by hand.
//!
//! Two things are learned for each direction. The level at which the axis begins to move: the next pulse begins a
//! little below it. And g: a pulse that overshoots doubles it, so that the next ones are gentler, and one that falls
//! short by more than half of its error reduces it. A pulse is judged once the axis has come to rest.
//!
//! Traps: a pulse that is judged at the next one, after the axis has drifted, seems to fall short each time; the pulses
//! become ever more violent. Noise that is taken for motion ends a pulse that has not moved anything. A valve whose
//! dead band has grown by more than the 0.075 is not followed any further. And beyond d + 0.05 a position that does not
//! change is a fault in time ([`crate::protection::motion`]), so the command rises there by at least 0.03 in a second.

use pipeline::machine::{Axis, DeadBand};

use crate::protection::motion::{STUCK_MARGIN, widest_dead_band};

/// Command beyond the dead band up to which a pulse rises.
const HIGHEST: f64 = 0.075;
/// Least rise of the command beyond [`STUCK_MARGIN`], 1/s: it takes 0.8 s to the highest command.
const HASTE: f64 = 0.03;
/// Multiple of L for which the highest command waits for the axis to move.
const PATIENCE: f64 = 1.5;
/// Longest pause of an axis that has moved under the highest command, s: less than the usual `stuck_after`.
const PAUSE: f64 = 0.2;
/// Opening at which the slope of the curve is taken.
const SMALL: f64 = 0.05;
/// Command below the dead band at which the first pulse begins.
const FIRST: f64 = 0.05;
/// Command below the level of the last begin of motion at which a pulse begins.
const BACK: f64 = 0.01;
/// Longest time that the pulse takes to rise from there to that level, s: a slow pulse is not to be all waiting.
const BACK_TIME: f64 = 0.2;
/// Fastest rise of the command, 1/s: a pulse is slow compared with every control period.
const FASTEST: f64 = 0.5;
/// Factor of g after a pulse that has overshot, and after one that has fallen short.
const LEARNED: (f64, f64) = (2.0, 0.7);
/// Part of the error that a pulse leaves which falls short.
const SHORT: f64 = 0.6;
/// Least and largest g as multiples of the one that the machine file gives.
const SLOPES: (f64, f64) = (0.25, 16.0);
/// Lag of an axis that is not commissioned, s: that of a slow valve.
const UNKNOWN_LAG: f64 = 0.1;

/// What pulses depend on, for one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Direction {
    /// d.
    dead_band: f64,
    /// g as the machine file gives it, m/s.
    slope: f64,
    /// g over that.
    learned: f64,
    /// Level at which the axis has begun to move; none before the first motion.
    breakaway: Option<f64>,
}

impl Direction {
    /// Learns from a pulse against `before` m that has left `after` m; less than 0 when it has overshot.
    fn learn(&mut self, before: f64, after: f64) {
        let factor = if after < 0.0 {
            self.breakaway = self.breakaway.map(|breakaway| breakaway - BACK);
            LEARNED.0
        } else if after > SHORT * before {
            LEARNED.1
        } else {
            1.0
        };
        self.learned = (self.learned * factor).clamp(SLOPES.0, SLOPES.1);
    }
}

/// A pulse under way.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Pulse {
    /// s.
    sign: f64,
    /// l.
    level: f64,
    /// r, 1/s.
    rate: f64,
    /// Largest s e before the axis has begun to move, m.
    error: f64,
    moves: bool,
    /// Least s e so far, m.
    least: f64,
    /// Ticks for which the level has been the highest without any progress.
    at_highest: u32,
}

/// What a pulse asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// This command.
    Command(f64),
    /// Neutral: the axis is about to arrive.
    Arrives,
    /// None: the axis hardly moves at the highest command of a pulse.
    GivesUp,
}

/// Dead time and lag of `axis`, s, at least a period.
pub fn reaction(axis: &Axis, period: f64) -> f64 {
    let reaction = match &axis.commissioned {
        Some(model) => model.reaction(),
        None => axis.identification.structure.nk as f64 * period + UNKNOWN_LAG,
    };
    reaction.max(period)
}

/// Makes the pulses of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Pulses {
    period: f64,
    /// L.
    delay: f64,
    /// e_rest, m.
    bound: f64,
    /// Motion that is no noise, m.
    motion: f64,
    retract: Direction,
    extend: Direction,
    pulse: Option<Pulse>,
    /// The last pulse, if it has moved the axis and nothing else has since.
    last: Option<Pulse>,
}

impl Pulses {
    /// For an axis whose e_rest is `bound` and whose noise is less than `motion`, m, and that is seen to move `delay` s
    /// after a command; `period` in s.
    pub fn new(axis: &Axis, bound: f64, motion: f64, delay: f64, period: f64) -> Self {
        let found = axis.commissioned.as_ref();
        let slopes = found.map(|model| {
            let DeadBand { extend, retract } = model.dead_band;
            [-model.speed(-retract - SMALL), model.speed(extend + SMALL)].map(|speed| speed / SMALL)
        });
        let direction = |side: usize, dead_band: f64| {
            let whole = axis.max_speed / (axis.control.command_limit - dead_band).max(SMALL);
            Direction { dead_band, slope: slopes.map_or(whole, |slopes| slopes[side]), learned: 1.0, breakaway: None }
        };
        let DeadBand { extend, retract } = widest_dead_band(axis);
        Self {
            period,
            delay,
            bound,
            motion,
            retract: direction(0, retract),
            extend: direction(1, extend),
            pulse: None,
            last: None,
        }
    }

    /// Another controller moves the axis: the last pulse is not judged.
    pub fn forget(&mut self) {
        self.last = None;
    }

    /// The last pulse has left an error of `error` m, once the axis had come to rest. Whether it has overshot. Pulses
    /// that have not moved the axis are not judged.
    pub fn judge(&mut self, error: f64) -> bool {
        let Some(last) = self.last.take().filter(|last| last.moves) else { return false };
        let after = last.sign * error;
        self.direction(last.sign).learn(last.error, after);
        after < 0.0
    }

    /// Begins a pulse against an error of `error` m, after the command `last`.
    pub fn begin(&mut self, error: f64, last: f64) {
        let sign = error.signum();
        let direction = *self.direction(sign);
        let back = BACK.min(BACK_TIME * self.rate(&direction, error.abs()));
        let first = direction.breakaway.map_or(direction.dead_band - FIRST, |breakaway| breakaway - back);
        self.pulse = Some(Pulse {
            sign,
            level: first.max(sign * last).clamp(0.0, direction.dead_band + HIGHEST),
            rate: 0.0,
            error: error.abs(),
            moves: false,
            least: f64::INFINITY,
            at_highest: 0,
        });
    }

    /// r of a pulse that is to move the axis by `way` m, 1/s.
    fn rate(&self, direction: &Direction, way: f64) -> f64 {
        (way.max(2.0 * self.bound) / (direction.slope * direction.learned * self.delay * self.delay)).min(FASTEST)
    }

    /// The next step of the pulse, at a following error of `error` m and a speed of `speed` m/s.
    pub fn step(&mut self, error: f64, speed: f64) -> Step {
        let Some(mut pulse) = self.pulse else { return Step::Arrives };
        let (delay, motion, period) = (self.delay, self.motion, self.period);
        let (left, toward) = (pulse.sign * error, pulse.sign * speed);
        if !pulse.moves {
            // The load may have moved the axis away since the begin.
            pulse.error = pulse.error.max(left);
            pulse.rate = {
                let direction = *self.direction(pulse.sign);
                self.rate(&direction, left)
            };
        }
        let direction = self.direction(pulse.sign);
        if !pulse.moves && pulse.error - left >= motion {
            pulse.moves = true;
            direction.breakaway = Some(pulse.level - pulse.rate * delay);
        }
        let slope = direction.slope * direction.learned;
        let underway = toward.max(0.0) * delay + 0.5 * slope * pulse.rate * delay * delay;
        let step = if left <= 0.0 || (pulse.moves && left <= underway) {
            Step::Arrives
        } else if f64::from(pulse.at_highest) * period > if pulse.moves { PAUSE } else { PATIENCE * delay } {
            Step::GivesUp
        } else {
            Step::Command(pulse.sign * pulse.level)
        };
        if left < pulse.least {
            (pulse.least, pulse.at_highest) = (left, 0);
        }
        if pulse.level >= direction.dead_band + HIGHEST {
            pulse.at_highest = pulse.at_highest.saturating_add(1);
        } else if toward < 0.5 * left / delay {
            let is_hasty = !pulse.moves && pulse.level > direction.dead_band + STUCK_MARGIN;
            let rate = if is_hasty { pulse.rate.max(HASTE) } else { pulse.rate };
            pulse.level = (pulse.level + rate * period).min(direction.dead_band + HIGHEST);
        }
        match step {
            Step::Command(_) => self.pulse = Some(pulse),
            Step::Arrives => (self.pulse, self.last) = (None, Some(pulse)),
            Step::GivesUp => (self.pulse, self.last) = (None, None),
        }
        step
    }

    fn direction(&mut self, sign: f64) -> &mut Direction {
        if sign < 0.0 { &mut self.retract } else { &mut self.extend }
    }
}
