//! A pulse: the command rises until the axis moves, and is shut ahead of the set point.
//!
//! ```text
//! u(k) = s l(k)        l(k+1) = min(l(k) + r T, d + 0.05) while s v < s e / (2 L)
//! r = max(|e(0)|, 2 e_rest) / (g L^2)
//! over when s e <= s v L + g r L^2 / 2 after the axis has begun to move, or 2 L after l = d + 0.05 when it has not
//! ```
//!
//! s sign of the following error e (m) at the begin, l level of the command, T period in s, v speed in m/s, L dead time
//! and lag in s, g slope of the static curve at the dead band d in m/s, e_rest as in [`super`]. What is on its way
//! through dead time and lag moves the axis by v L + g r L^2 / 2 after the valve is shut; with this rate a pulse that
//! is shut at once moves it by half of the error. Source: inching by hand.
//!
//! The level at which the axis begins to move is kept for each direction. The next pulse begins a little below it.
//!
//! Trap: a valve whose dead band has grown by more than the 0.05 is not followed any further. Beyond that a command
//! without motion is a fault ([`crate::protection::motion`]).

use pipeline::machine::Axis;

/// Command beyond the dead band up to which a pulse rises: where a position that stands still becomes a fault.
const HIGHEST: f64 = 0.05;
/// Command below the dead band at which the first pulse begins.
const FIRST: f64 = 0.05;
/// Command below the level of the last begin of motion at which a pulse begins.
const BACK: f64 = 0.01;
/// Fastest rise of the command, 1/s: a pulse is slow compared with every control period.
const FASTEST: f64 = 0.5;
/// Lag of an axis that is not commissioned, s: that of a slow valve.
const UNKNOWN_LAG: f64 = 0.1;

/// What pulses depend on, for one direction.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Direction {
    /// d.
    dead_band: f64,
    /// g, m/s.
    slope: f64,
    /// Level at which the axis has begun to move; none before the first motion.
    breakaway: Option<f64>,
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
    /// e at the begin, m.
    error: f64,
    moves: bool,
    /// Ticks for which the level has been the highest.
    at_highest: u32,
}

/// What a pulse asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// This command.
    Command(f64),
    /// Neutral: the axis is about to arrive.
    Arrives,
    /// Neutral: the axis does not move at the highest command of a pulse.
    GivesUp,
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
}

impl Pulses {
    /// For an axis whose e_rest is `bound` and whose noise is less than `motion`, m; `period` in s.
    pub fn new(axis: &Axis, bound: f64, motion: f64, period: f64) -> Self {
        let (control, found) = (&axis.control, axis.commissioned.as_ref());
        let delay = match found {
            Some(found) => found.dead_time + found.time_constant,
            None => axis.identification.structure.nk as f64 * period + UNKNOWN_LAG,
        };
        let direction = |sign: f64| {
            let of = |dead_band: pipeline::machine::DeadBand| {
                if sign < 0.0 { dead_band.retract } else { dead_band.extend }
            };
            let calibrated = of(control.dead_band);
            let whole = axis.max_speed / (control.command_limit - calibrated).max(HIGHEST);
            let (dead_band, slope) = found.map_or((calibrated, whole), |found| {
                let d = of(found.dead_band);
                (d.max(calibrated), found.speed(sign * (d + HIGHEST)).abs() / HIGHEST)
            });
            Direction { dead_band, slope, breakaway: None }
        };
        Self {
            period,
            delay: delay.max(period),
            bound,
            motion,
            retract: direction(-1.0),
            extend: direction(1.0),
            pulse: None,
        }
    }

    /// L.
    pub fn delay(&self) -> f64 {
        self.delay
    }

    /// Begins a pulse against an error of `error` m, after the command `last`.
    pub fn begin(&mut self, error: f64, last: f64) {
        let sign = error.signum();
        let direction = *self.direction(sign);
        let first = direction.breakaway.map_or(direction.dead_band - FIRST, |breakaway| breakaway - BACK);
        let rate = error.abs().max(2.0 * self.bound) / (direction.slope * self.delay * self.delay);
        self.pulse = Some(Pulse {
            sign,
            level: first.max(sign * last).clamp(0.0, direction.dead_band + HIGHEST),
            rate: rate.min(FASTEST),
            error,
            moves: false,
            at_highest: 0,
        });
    }

    /// The next step of the pulse, at a following error of `error` m and a speed of `speed` m/s.
    pub fn step(&mut self, error: f64, speed: f64) -> Step {
        let Some(mut pulse) = self.pulse else { return Step::Arrives };
        let (delay, motion, period) = (self.delay, self.motion, self.period);
        let direction = self.direction(pulse.sign);
        let (left, toward) = (pulse.sign * error, pulse.sign * speed);
        if !pulse.moves && pulse.sign * (pulse.error - error) >= motion {
            pulse.moves = true;
            direction.breakaway = Some(pulse.level - pulse.rate * delay);
        }
        let underway = toward.max(0.0) * delay + 0.5 * direction.slope * pulse.rate * delay * delay;
        let step = if left <= 0.0 || (pulse.moves && left <= underway) {
            Step::Arrives
        } else if !pulse.moves && f64::from(pulse.at_highest) * period > 2.0 * delay {
            Step::GivesUp
        } else {
            Step::Command(pulse.sign * pulse.level)
        };
        if pulse.level >= direction.dead_band + HIGHEST {
            pulse.at_highest = pulse.at_highest.saturating_add(1);
        } else if toward < 0.5 * left / delay {
            pulse.level = (pulse.level + pulse.rate * period).min(direction.dead_band + HIGHEST);
        }
        self.pulse = matches!(step, Step::Command(_)).then_some(pulse);
        step
    }

    fn direction(&mut self, sign: f64) -> &mut Direction {
        if sign < 0.0 { &mut self.retract } else { &mut self.extend }
    }
}
