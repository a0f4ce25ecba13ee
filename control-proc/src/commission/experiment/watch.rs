//! What ends the experiment at once.
//!
//! ```text
//! low - margin <= y <= high + margin       |y(k) - y(k-n)| <= 1.5 v_max n T        n T = 50 ms
//! not against:  all u of the last M ticks >= 0  =>  y(k) - y(k-4n) > -(5 mm + v_max 20 ms)      and mirrored
//! not stuck:    y the same within a few counts  =>  sum of v(u) T < 20 mm          u since then, R ticks old
//! ```
//!
//! y position m, u command, v_max speed bound m/s, T period s, R ticks from command to motion, M > R, v what commands were
//! seen to make ([`super::direction`]). Trap: what is under way still comes out after an abort, so the margin is where
//! the valve shuts, not where the axis stops.

use std::fmt;

use pipeline::message::{AxisSample, sample_fault};

/// Part of the speed bound at which the experiment ends.
pub const SPEED_FACTOR: f64 = 1.5;
/// Time over which speeds are taken, s.
pub const SPEED_TIME: f64 = 0.05;
/// Way against the command, within four times that, that ends the experiment, m; and per m/s of the speed bound: a
/// load on oil swings back when its valve shuts.
pub const AGAINST_DISTANCE: f64 = 5e-3;
/// See above, s.
pub const AGAINST_TIME: f64 = 0.02;
/// Way that the axis should have gone while its encoder stood still, m.
pub const OWED_DISTANCE: f64 = 0.02;
/// Samples in a row without a usable position.
pub const UNUSABLE_LIMIT: u64 = crate::axis::UNUSABLE_LIMIT;

/// Why the experiment was ended. The valve is neutral since.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Abort {
    /// Somebody else ended it.
    Stopped,
    /// Samples in a row without a usable position.
    Feedback {
        /// [`sample_fault`] bits of the last.
        faults: u32,
    },
    /// Outside the window by more than the margin.
    Window {
        /// m.
        position: f64,
        /// Low and high end of the window, m.
        window: (f64, f64),
        /// m.
        margin: f64,
    },
    /// Faster than the speed bound by more than half.
    Speed {
        /// m/s.
        found: f64,
        /// m/s.
        allowed: f64,
    },
    /// Moves against the command, or without one.
    Against {
        /// The largest command that can be at work.
        command: f64,
        /// m.
        moved: f64,
        /// m.
        allowed: f64,
    },
    /// The position does not change although it should.
    Stuck {
        /// The way that the commands should have made, m.
        owed: f64,
    },
    /// No motion in at least one direction.
    NoMotion {
        /// Whether extending is what does not work.
        extend: bool,
        /// The highest level that was tried.
        level: f64,
    },
    /// The window does not let the axis move fast enough to be seen.
    TooSmall {
        /// Travel of the window, m.
        travel: f64,
        /// The least that is needed, m.
        needed: f64,
    },
    /// Time is over before anything could be learned.
    TooShort {
        /// What the experiment has, s.
        duration: f64,
        /// What is left at least for the random steps, s.
        needed: f64,
    },
}

impl fmt::Display for Abort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Stopped => write!(f, "stopped"),
            Self::Feedback { faults } => {
                let names = sample_fault::NAMES.iter().enumerate().filter(|(bit, _)| faults & (1 << bit) != 0);
                let names: Vec<&str> = names.map(|(_, name)| *name).collect();
                write!(f, "feedback: found no usable position ({}); allowed: fewer than ", names.join(", "))?;
                write!(f, "{UNUSABLE_LIMIT} in a row, and none out of range")
            }
            Self::Window { position, window: (low, high), margin } => {
                write!(f, "position: found {position:.4} m; allowed: {low:.4} to {high:.4} m, and {margin:.4} m beyond")
            }
            Self::Speed { found, allowed } => write!(f, "speed: found {found:.4} m/s; allowed: up to {allowed:.4} m/s"),
            Self::Against { command, moved, allowed } => write!(
                f,
                "direction: found {:+.1} mm under a command of {command:+.3}; allowed: up to {:.1} mm against the \
                 command: are valve and encoder of the same sign?",
                1e3 * moved,
                1e3 * allowed
            ),
            Self::Stuck { owed } => write!(
                f,
                "position: found no change where the commands should have made {:.1} mm; allowed: up to {:.1} mm: is \
                 the encoder stuck?",
                1e3 * owed,
                1e3 * OWED_DISTANCE
            ),
            Self::NoMotion { extend, level } => write!(
                f,
                "does not {} up to a command of {level:.3}: is the pump on?",
                if extend { "extend" } else { "retract" }
            ),
            Self::TooSmall { travel, needed } => {
                write!(f, "window: found {travel:.4} m of travel; allowed: at least {needed:.4} m")
            }
            Self::TooShort { duration, needed } => write!(
                f,
                "duration: found {duration:.1} s, of which less than {needed:.1} s are left after the strokes; allowed: \
                 a longer one"
            ),
        }
    }
}

impl std::error::Error for Abort {}

/// Past positions and commands, and what follows from them.
#[derive(Debug, Clone)]
pub struct Watch {
    period: f64,
    /// Ticks of [`SPEED_TIME`].
    speed_ticks: usize,
    /// Newest last, as many as [`Watch::new`] was asked for.
    positions: Vec<f64>,
    commands: Vec<f64>,
    /// Where the axis has been within `band` since it last moved, for how many ticks, and the way it owes.
    still: (f64, usize, f64),
    band: f64,
    blind: u64,
}

impl Watch {
    /// Looks back `memory` ticks; positions within `band` m are the same.
    pub fn new(period: f64, memory: usize, band: f64) -> Self {
        let speed_ticks = ((SPEED_TIME / period).round() as usize).max(1);
        let memory = memory.max(4 * speed_ticks) + 1;
        let (positions, commands) = (vec![f64::NAN; memory], vec![0.0; memory]);
        Self { period, speed_ticks, positions, commands, still: (f64::NAN, 0, 0.0), band, blind: 0 }
    }

    /// The position as far as it is usable, m; held from before where it is not.
    pub fn take(&mut self, sample: Option<&AxisSample>) -> Result<Option<f64>, Abort> {
        let faults = sample.map_or(sample_fault::STALE, |sample| sample.faults);
        let position = sample.and_then(AxisSample::usable);
        self.blind = if position.is_some() { 0 } else { self.blind + 1 };
        if self.blind >= UNUSABLE_LIMIT || faults & sample_fault::RANGE != 0 {
            return Err(Abort::Feedback { faults });
        }
        if self.positions.last().is_some_and(|last| last.is_nan())
            && let Some(position) = position
        {
            self.positions.fill(position);
        }
        self.positions.rotate_left(1);
        let newest = self.positions.len() - 1;
        self.positions[newest] = position.unwrap_or(self.positions[newest - 1]);
        Ok(position)
    }

    /// The command of this tick.
    pub fn commanded(&mut self, command: f64) {
        self.commands.rotate_left(1);
        if let Some(last) = self.commands.last_mut() {
            *last = command;
        }
    }

    /// The last command.
    pub fn command(&self) -> f64 {
        self.commands[self.commands.len() - 1]
    }

    /// The last `ticks` commands, the newest last.
    pub fn commands(&self, ticks: usize) -> &[f64] {
        &self.commands[self.commands.len().saturating_sub(ticks)..]
    }

    /// The position, m.
    pub fn position(&self) -> f64 {
        self.positions[self.positions.len() - 1]
    }

    /// Way of the last `ticks`, m.
    pub fn moved(&self, ticks: usize) -> f64 {
        self.position() - self.positions[self.positions.len() - 1 - ticks.min(self.positions.len() - 1)]
    }

    /// Speed over [`SPEED_TIME`], m/s.
    pub fn speed(&self) -> f64 {
        self.moved(self.speed_ticks) / (self.speed_ticks as f64 * self.period)
    }

    /// Lowest and highest command of the last `ticks`, 0 among them.
    pub fn span(&self, ticks: usize) -> (f64, f64) {
        let commands = self.commands(ticks).iter();
        commands.fold((0.0, 0.0), |(low, high), command| (command.min(low), command.max(high)))
    }

    /// The bounds on position and speed.
    pub fn check_bounds(&self, window: (f64, f64), margin: f64, fastest: f64) -> Result<(), Abort> {
        let position = self.position();
        if !(window.0 - margin..=window.1 + margin).contains(&position) {
            return Err(Abort::Window { position, window, margin });
        }
        let (found, allowed) = (self.speed().abs(), SPEED_FACTOR * fastest);
        if found > allowed { Err(Abort::Speed { found, allowed }) } else { Ok(()) }
    }

    /// That nothing moves against all commands of the last `ticks`.
    pub fn check_direction(&self, ticks: usize, fastest: f64) -> Result<(), Abort> {
        let (low, high) = self.span(ticks);
        let moved = self.moved(4 * self.speed_ticks);
        let allowed = AGAINST_DISTANCE + fastest * AGAINST_TIME;
        let against = (low == 0.0 && moved < -allowed) || (high == 0.0 && moved > allowed);
        if against { Err(Abort::Against { command: low + high, moved, allowed }) } else { Ok(()) }
    }

    /// That the position changes when commands `reaction` ticks ago, given since it last did, ask for `speed` m/s.
    pub fn check_change(&mut self, reaction: usize, speed: impl Fn(f64) -> f64) -> Result<(), Abort> {
        let position = self.position();
        let (at, ticks, owed) = &mut self.still;
        if (position - *at).abs() <= self.band {
            *ticks += 1;
            if *ticks > reaction {
                *owed += speed(self.commands[self.commands.len().saturating_sub(reaction + 1)]) * self.period;
            }
        } else {
            self.still = (position, 0, 0.0);
        }
        let owed = self.still.2;
        if owed > OWED_DISTANCE { Err(Abort::Stuck { owed }) } else { Ok(()) }
    }

    /// Widens what counts as the same position, m.
    pub fn set_band(&mut self, band: f64) {
        self.band = self.band.max(band);
    }
}
