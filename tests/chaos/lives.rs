//! Rules that hold over restarts of a stage: for the message numbers of a channel, and for the controller.
//!
//! A *life* is the time from one start of a stage to its end. Message numbers begin with 0 in every life.

use pipeline::message::{AxisCommand, control_flag};

/// Message numbers of one channel.
#[derive(Default)]
pub struct Numbers {
    /// Session, first and last number that were seen of every life, the present life last.
    lives: Vec<(u64, u64, u64)>,
}

impl Numbers {
    pub fn take(&mut self, session: u64, number: u64) {
        match self.lives.last_mut().filter(|(same, _, last)| session == *same && number > *last) {
            Some((_, _, last)) => *last = number,
            None => self.lives.push((session, number, number)),
        }
    }

    /// Number of messages from the first to the last one that was seen, summed over all lives.
    pub fn published(&self) -> u64 {
        self.lives.iter().map(|(_, first, last)| last - first + 1).sum()
    }

    pub fn restarts(&self) -> u64 {
        self.lives.len().saturating_sub(1) as u64
    }
}

/// A controller over its lives, and whether its axes may move.
#[derive(Default)]
pub struct Controller {
    last_number: Option<u64>,
    /// Whether the controller was started again. In its first life `hydraxis run` arms it.
    started_again: bool,
    /// Whether a program has armed an axis in this life.
    enabled: bool,
    latched: [bool; 4],
    /// Whether a program that arms, disarms or resets runs now.
    pub at_levers: bool,
}

impl Controller {
    pub fn take(&mut self, number: u64, axes: &[AxisCommand]) {
        if self.last_number.replace(number).is_some_and(|last| number <= last) {
            (self.started_again, self.enabled, self.latched) = (true, false, [false; 4]);
        }
        self.enabled |= self.at_levers;
        for (i, axis) in axes.iter().enumerate() {
            let is_off = axis.flags & (control_flag::DISARMED | control_flag::LATCHED) != 0;
            assert!(is_off || self.enabled || !self.started_again, "axis {i} moves and was not armed: {axis:?}");
            let is_latched = axis.flags & control_flag::LATCHED != 0;
            assert!(
                is_latched || self.at_levers || !self.latched[i],
                "axis {i} is no longer latched and was not reset: {axis:?}"
            );
            self.latched[i] = is_latched;
        }
    }
}
