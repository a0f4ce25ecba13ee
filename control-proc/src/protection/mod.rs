//! Protection of the machine: what a command may be, and which faults stop an axis.
//!
//! | module | what it holds |
//! |---|---|
//! | [`limits`] | largest magnitude and rate of a command, and half of the speed |
//! | [`end_stops`] | commands near the soft limits |
//! | [`following_error`] | the bound on the difference between reference and position |
//! | [`hunting`] | whether an axis swings though its reference does not ask for it |
//! | [`motion`] | whether an axis that is driven moves |
//! | [`uncommanded`] | whether an axis moves that nobody has commanded to move |
//! | [`walls`] | commands of all axes near places that no part of the machine passes |
//!
//! Runs in the loop: nothing here allocates after construction.

pub mod end_stops;
pub mod following_error;
pub mod hunting;
pub mod limits;
pub mod motion;
pub mod uncommanded;
pub mod walls;

use pipeline::machine::Axis;

use end_stops::EndStops;
use following_error::{Deviation, FollowingError};
use hunting::Hunting;
use limits::{Limits, half_speed};
use uncommanded::Uncommanded;

/// The protection of one axis.
#[derive(Debug, Clone)]
pub struct Protection {
    limits: Limits,
    /// Largest magnitude of a command for half of the speed.
    half_speed: f64,
    end_stops: EndStops,
    following_error: FollowingError,
    uncommanded: Uncommanded,
    hunting: Hunting,
}

impl Protection {
    /// As the machine file sets it for `axis`; `period` in s, and `speed_time`, over which its speed is taken.
    pub fn new(axis: &Axis, period: f64, speed_time: f64) -> Self {
        Self {
            limits: Limits::new(&axis.control, period),
            half_speed: half_speed(axis),
            end_stops: EndStops::new(axis, period),
            following_error: FollowingError::new(axis.control.following_error, period),
            uncommanded: Uncommanded::new(axis, period),
            hunting: Hunting::new(axis, period, speed_time),
        }
    }

    /// Begins anew: the axis begins to follow, or a controller takes over.
    pub fn reset(&mut self) {
        self.following_error.reset();
        self.hunting.reset();
    }

    /// The watch for swings in closed loop.
    pub fn hunting(&mut self) -> &mut Hunting {
        &mut self.hunting
    }

    /// The watch for motion that nobody commanded, in every state.
    pub fn uncommanded(&mut self) -> &mut Uncommanded {
        &mut self.uncommanded
    }

    /// The limits of the machine file.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The soft end stops.
    pub fn end_stops(&self) -> &EndStops {
        &self.end_stops
    }

    /// The limits after the command `last`; `is_slow`: for half of the speed, which the command reaches step by step.
    pub fn limits_after(&self, last: f64, is_slow: bool) -> Limits {
        if !is_slow {
            return self.limits;
        }
        let magnitude = self.half_speed.max(last.abs() - self.limits.step);
        Limits { magnitude: magnitude.min(self.limits.magnitude), ..self.limits }
    }

    /// Whether a following error stops the axis. An error that `is_excused` counts as none.
    pub fn stops(&mut self, deviation: &Deviation, is_excused: bool) -> bool {
        let error = if is_excused { 0.0 } else { deviation.error };
        self.following_error.update(&Deviation { error, ..*deviation }, 0.0)
    }
}
