//! What the numbers of a channel say of its writer's lives, and what one life of the controller may do.

use pipeline::message::{AxisCommand, control_flag};

/// Message numbers of one channel.
#[derive(Default)]
pub struct Numbers {
    /// First and last number of every life that was seen, the present one last.
    lives: Vec<(u64, u64)>,
}

impl Numbers {
    pub fn take(&mut self, number: u64) {
        match self.lives.last_mut().filter(|(_, last)| number > *last) {
            Some((_, last)) => *last = number,
            None => self.lives.push((number, number)),
        }
    }

    /// Messages from the first to the last seen of every life.
    pub fn published(&self) -> u64 {
        self.lives.iter().map(|(first, last)| last - first + 1).sum()
    }

    pub fn restarts(&self) -> u64 {
        self.lives.len().saturating_sub(1) as u64
    }
}

/// A controller over its lives: who has let it move.
#[derive(Default)]
pub struct Controller {
    last_number: Option<u64>,
    /// Whether it was started again: the first life is armed by `hydraxis run`.
    started_again: bool,
    /// Whether somebody has enabled an axis in this life.
    enabled: bool,
    latched: [bool; 4],
    /// Whether a program is at the levers now.
    pub at_levers: bool,
}

impl Controller {
    pub fn take(&mut self, number: u64, axes: &[AxisCommand]) {
        if self.last_number.replace(number).is_some_and(|last| number <= last) {
            (self.started_again, self.enabled, self.latched) = (true, false, [false; 4]);
        }
        self.enabled |= self.at_levers;
        for (i, axis) in axes.iter().enumerate() {
            let is_off = axis.flags & (control_flag::DISARMED | control_flag::FEEDBACK) != 0;
            assert!(is_off || self.enabled || !self.started_again, "nobody has enabled axis {i}: {axis:?}");
            let is_latched = axis.flags & control_flag::LATCHED != 0;
            assert!(is_latched || self.at_levers || !self.latched[i], "nobody has released axis {i}: {axis:?}");
            self.latched[i] = is_latched;
        }
    }
}
