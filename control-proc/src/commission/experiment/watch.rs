//! The bounds of an experiment: what ends it at once.
//!
//! ```text
//! low - margin <= y <= high + margin       |y(k) - y(k-n)| <= 1.5 v_max n T        n T = 50 ms
//! not against:  all u of the last M ticks >= 0  =>  y(k) - y(k-4n) > -(5 mm + v_max 20 ms + s)   and mirrored
//! not stuck:    y unchanged within a few counts  =>  sum of v(u_h) T < 20 mm       u_h since then, R ticks old
//! ```
//!
//! y position m, u command, v_max speed bound m/s, T period s, R ticks from command to motion, M > R, v speeds that the
//! commands were seen to make ([`super::direction`]), u_h the opening that has been commanded at least for h ticks, the
//! time from neutral to rest; s = min(0.4 r, v_max 80 ms), r the farthest that the axis rose in the last 1.5 s, m.
//! Traps: what is under way in valve and pilot lines still comes out after an abort. So the margin is where the valve
//! shuts, not where the axis stops. A load on oil swings back when its valve shuts: by r and less, which is no motion
//! against the command. And a step that is shorter than the spool needs may move nothing.

use pipeline::{
    machine::{Timing, samples_of},
    message::{AxisSample, sample_fault},
};

use super::abort::{Abort, OWED_DISTANCE, UNUSABLE_LIMIT};
pub use crate::protection::uncommanded::{AGAINST_DISTANCE, AGAINST_TIME, SWING, SWING_TIME};

/// Factor of the speed bound from which on the experiment ends.
pub const SPEED_FACTOR: f64 = 1.5;
/// Time over which speeds are taken, s.
pub const SPEED_TIME: f64 = 0.05;
/// A position that has not changed.
#[derive(Debug, Clone, Copy)]
struct Still {
    /// m.
    at: f64,
    /// Ticks since it last changed.
    ticks: usize,
    /// Way that the commands should have made meanwhile, m.
    owed: f64,
}

/// Past positions and commands, and what follows from them.
#[derive(Debug, Clone)]
pub struct Watch {
    period: f64,
    /// Ticks of [`SPEED_TIME`].
    speed_ticks: usize,
    /// Newest last, as many as [`Watch::new`] was asked for.
    positions: Vec<f64>,
    /// Newest last, as many as the positions.
    commands: Vec<f64>,
    still: Still,
    /// Change of a position that is none, m.
    band: f64,
    /// Ticks since the last usable position.
    blind: usize,
    /// Implausible samples since the last usable position.
    implausible: usize,
    /// Blind ticks without a reading that are too many.
    timeout: usize,
}

impl Watch {
    /// Looks back `memory` ticks; positions within `band` m count as equal.
    pub fn new(timing: &Timing, memory: usize, band: f64) -> Self {
        let period = timing.period.as_secs_f64();
        let speed_ticks = ((SPEED_TIME / period).round() as usize).max(1);
        let memory = memory.max(4 * speed_ticks) + 1;
        let (positions, commands) = (vec![f64::NAN; memory], vec![0.0; memory]);
        let still = Still { at: f64::NAN, ticks: 0, owed: 0.0 };
        let timeout = samples_of(timing.feedback_timeout, timing.period).max(1);
        Self { period, speed_ticks, positions, commands, still, band, blind: 0, implausible: 0, timeout }
    }

    /// Takes in the sample of a tick, and returns its position (m) if that is usable. Otherwise the last one is held
    /// until the next one, and then replaced by a straight line.
    pub fn take(&mut self, sample: Option<&AxisSample>) -> Result<Option<f64>, Abort> {
        let faults = sample.map_or(sample_fault::STALE, |sample| sample.faults);
        let position = sample.and_then(AxisSample::usable);
        let newest = self.positions.len() - 1;
        if self.positions[newest].is_nan()
            && let Some(position) = position
        {
            self.positions.fill(position);
        }
        self.positions.rotate_left(1);
        let last = self.positions[newest - 1];
        self.positions[newest] = position.unwrap_or(last);
        if let Some(position) = position {
            let ticks = self.blind + 1;
            for back in 1..ticks.min(newest) {
                self.positions[newest - back] = position + (last - position) * back as f64 / ticks as f64;
            }
            (self.blind, self.implausible) = (0, 0);
        } else {
            self.blind += 1;
            self.implausible += usize::from(sample.is_some_and(|sample| !sample.is_stale()));
        }
        let is_lost = self.implausible >= UNUSABLE_LIMIT || self.blind >= self.timeout;
        if is_lost || faults & sample_fault::RANGE != 0 {
            return Err(Abort::Feedback { faults });
        }
        Ok(position)
    }

    /// Whether positions have been missing for so long that the axis waits for them at neutral.
    pub fn is_waiting(&self) -> bool {
        self.blind >= UNUSABLE_LIMIT
    }

    /// Takes in the command of this tick.
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

    /// Distance of the lowest from the highest of the last `ticks` positions, m.
    pub fn range(&self, ticks: usize) -> f64 {
        let positions = self.positions[self.positions.len().saturating_sub(ticks)..].iter();
        let (low, high) = positions.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (p.min(l), p.max(h)));
        high - low
    }

    /// Speed over [`SPEED_TIME`], m/s.
    pub fn speed(&self) -> f64 {
        self.speed_over(self.speed_ticks)
    }

    /// Speed over the last `ticks`, m/s.
    pub fn speed_over(&self, ticks: usize) -> f64 {
        self.moved(ticks) / (ticks as f64 * self.period)
    }

    /// Lowest and highest of the last `ticks` commands and 0.
    pub fn span(&self, ticks: usize) -> (f64, f64) {
        let commands = self.commands(ticks).iter();
        commands.fold((0.0, 0.0), |(low, high), command| (command.min(low), command.max(high)))
    }

    /// The longest way in the direction `sign` among the positions that are kept, m.
    fn way(&self, sign: f64) -> f64 {
        let (mut lowest, mut way) = (f64::INFINITY, 0.0f64);
        for position in &self.positions {
            lowest = lowest.min(position * sign);
            way = way.max(position * sign - lowest);
        }
        way
    }

    /// Checks the bounds on position and speed; `fastest` is the speed bound, m/s.
    pub fn check_bounds(&self, window: (f64, f64), margin: f64, fastest: f64) -> Result<(), Abort> {
        let position = self.position();
        if !(window.0 - margin..=window.1 + margin).contains(&position) {
            return Err(Abort::Window { position, window, margin });
        }
        let (found, allowed) = (self.speed().abs(), SPEED_FACTOR * fastest);
        if found > allowed { Err(Abort::Speed { found, allowed }) } else { Ok(()) }
    }

    /// Checks that the axis does not move against all commands of the last `ticks`; `has_followed` says whether it has
    /// followed commands of both directions.
    pub fn check_direction(&self, ticks: usize, fastest: f64, has_followed: bool) -> Result<(), Abort> {
        let (low, high) = self.span(ticks);
        let moved = self.moved(4 * self.speed_ticks);
        let way = self.way(-moved.signum());
        let allowed = AGAINST_DISTANCE + fastest * AGAINST_TIME + (SWING * way).min(fastest * SWING_TIME);
        let against = (low == 0.0 && moved < -allowed) || (high == 0.0 && moved > allowed);
        if against { Err(Abort::Against { command: low + high, moved, allowed, has_followed }) } else { Ok(()) }
    }

    /// Checks that the position changes when the commands ask for motion. `speed` is the speed (m/s) that a command
    /// asks for; commands that were given for `opening` ticks act `reaction` ticks later.
    pub fn check_change(&mut self, reaction: usize, opening: usize, speed: impl Fn(f64) -> f64) -> Result<(), Abort> {
        let position = self.position();
        let end = self.commands.len().saturating_sub(reaction);
        let given = &self.commands[end.saturating_sub(opening + 1)..end];
        let least = |sign: f64| given.iter().fold(f64::INFINITY, |least, command| least.min(command * sign)).max(0.0);
        let lasting = least(1.0) - least(-1.0);
        let still = &mut self.still;
        if (position - still.at).abs() <= self.band {
            still.ticks += 1;
            if still.ticks > reaction {
                still.owed += speed(lasting) * self.period;
            }
        } else {
            *still = Still { at: position, ticks: 0, owed: 0.0 };
        }
        let owed = still.owed;
        if owed > OWED_DISTANCE { Err(Abort::Stuck { owed }) } else { Ok(()) }
    }

    /// Widens the band within which positions count as equal to at least `band` m.
    pub fn widen_band(&mut self, band: f64) {
        self.band = self.band.max(band);
    }
}
