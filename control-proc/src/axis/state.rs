//! States of an axis, and what leads from one to the other.
//!
//! ```text
//! disarmed --arm--> settling --0.2 s of healthy samples--> following
//! settling, following --fault--> latched         any state --disarm--> disarmed
//! ```
//!
//! A fault that a sample shows latches an axis that settles as one that follows: nothing moves because a fault has
//! ended. Less than that prolongs the settling: it begins anew with every implausible sample, and when the computer is
//! late with samples or commands, as while stages start; a missing sample takes back a part of it. A computer that is
//! late by [`SETTLING`] is not told from a stage that was stopped or killed, and latches, but for an axis that was
//! armed before the first sample: stages start then. Settling has an end: an axis that has not settled after
//! [`SETTLING_PATIENCE`] is latched, because nobody expects any more that it moves. The emergency stop and motion that
//! nobody commanded latch in every state.

use std::time::Duration;

use pipeline::{
    machine::{Timing, samples_of},
    message::control_flag,
};

use super::feedback::Observation;
use crate::protection::motion::Standing;

/// Time of healthy samples before anything moves: long enough to see an encoder that comes and goes.
pub const SETTLING: Duration = Duration::from_millis(200);
/// Part of [`SETTLING`] that a missing sample takes back: four in a row take back all of it.
pub const MISSING_PART: u32 = 4;
/// Time after which an axis is latched that has not settled.
const SETTLING_PATIENCE: Duration = Duration::from_secs(2);
/// Ticks after which it is latched; they count where they are longer than [`SETTLING_PATIENCE`].
const PATIENCE_TICKS: usize = 20;

/// The state of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Neutral until it is armed.
    Disarmed,
    /// Armed; so many healthy samples so far, less what missing ones have taken back.
    Settling(u64),
    /// Commanded by a request or a controller.
    Following,
    /// Neutral until it is disarmed, for these [`control_flag`] bits.
    Latched(u32),
}

/// What an observation leads to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Transition {
    /// Nothing that the controller has to act on.
    Stay,
    /// The axis begins to follow at this position, m.
    Begin(f64),
    /// A fault latches the axis, a [`control_flag`] bit.
    Latch(u32),
}

/// The latches of an axis so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Latches {
    /// Number of times that a fault latched the axis.
    pub count: u64,
    /// Tick of the last latch.
    pub tick: u64,
    /// Why the axis was latched then, [`control_flag`] bits.
    pub cause: u32,
}

/// The state of an axis and what it depends on.
#[derive(Debug, Clone)]
pub struct StateMachine {
    state: State,
    /// The present tick.
    tick: u64,
    latches: Latches,
    settling_ticks: u64,
    patience_ticks: u64,
    /// Ticks without a sample that latch an axis that settles.
    silence_ticks: u64,
    /// Whether there has been a sample.
    has_begun: bool,
    /// Tick at which the axis began to settle; none before its first observation.
    settles_since: Option<u64>,
    /// What has kept the axis from settling last, a [`control_flag`] bit.
    obstacle: u32,
    /// The emergency stop was pressed when it was last seen.
    is_pressed: bool,
    /// The axis was disarmed because its requests stopped.
    requests_stopped: bool,
}

impl StateMachine {
    /// Disarmed.
    pub fn new(timing: &Timing) -> Self {
        let settling_ticks = samples_of(SETTLING, timing.period).max(1) as u64;
        let patience_ticks = samples_of(SETTLING_PATIENCE, timing.period).max(PATIENCE_TICKS) as u64;
        Self {
            state: State::Disarmed,
            tick: 0,
            latches: Latches::default(),
            settling_ticks,
            patience_ticks,
            silence_ticks: settling_ticks,
            has_begun: false,
            settles_since: None,
            obstacle: control_flag::FEEDBACK,
            is_pressed: false,
            requests_stopped: false,
        }
    }

    /// The present state.
    pub fn current(&self) -> State {
        self.state
    }

    /// Whether the axis settles or follows, and so is operated in its mode.
    pub fn is_armed(&self) -> bool {
        matches!(self.state, State::Settling(_) | State::Following)
    }

    /// Whether the emergency stop is pressed.
    pub fn is_pressed(&self) -> bool {
        self.is_pressed
    }

    /// Begins the tick of this number.
    pub fn begin_tick(&mut self, tick: u64) {
        (self.tick, self.has_begun) = (tick, true);
    }

    /// The latches so far.
    pub fn latches(&self) -> Latches {
        self.latches
    }

    /// Takes in the emergency stop.
    pub fn press(&mut self, is_pressed: bool) {
        self.is_pressed = is_pressed;
    }

    /// Begins to settle. False without effect where the axis is not disarmed.
    pub fn arm(&mut self) -> bool {
        let is_disarmed = self.state == State::Disarmed;
        if is_disarmed {
            (self.state, self.requests_stopped) = (State::Settling(0), false);
            (self.settles_since, self.obstacle) = (None, control_flag::FEEDBACK);
            self.silence_ticks = if self.has_begun { self.settling_ticks } else { u64::MAX };
        }
        is_disarmed
    }

    /// Begins to settle anew for this cause, a [`control_flag`] bit. False without effect where the axis does not
    /// settle.
    pub fn settle_anew(&mut self, cause: u32) -> bool {
        let settles = matches!(self.state, State::Settling(_));
        if settles {
            (self.state, self.obstacle) = (State::Settling(0), cause);
        }
        settles
    }

    /// Disarms. False without effect while the emergency stop is pressed.
    pub fn disarm(&mut self) -> bool {
        if !self.is_pressed {
            (self.state, self.requests_stopped) = (State::Disarmed, false);
        }
        !self.is_pressed
    }

    /// Notes that the axis was disarmed because its requests stopped.
    pub fn note_stopped_requests(&mut self) {
        self.requests_stopped = true;
    }

    /// Latches. The first cause stays, and causes that cut the pilot off are added to it.
    pub fn latch(&mut self, cause: u32) {
        let cause = match self.state {
            State::Latched(first) => first | cause & control_flag::CUT_OFF,
            _ => {
                self.latches = Latches { count: self.latches.count + 1, tick: self.tick, cause };
                cause
            }
        };
        (self.state, self.latches.cause) = (State::Latched(cause), cause);
    }

    /// Why the axis is latched, [`control_flag`] bits; 0 while it is not.
    pub fn cause(&self) -> u32 {
        if let State::Latched(cause) = self.state { cause } else { 0 }
    }

    /// The state as [`control_flag`] bits.
    pub fn flags(&self) -> u32 {
        match self.state {
            State::Disarmed if self.requests_stopped => control_flag::DISARMED | control_flag::REQUEST_STOPPED,
            State::Disarmed => control_flag::DISARMED,
            State::Settling(_) => control_flag::SETTLING,
            State::Following => 0,
            State::Latched(cause) => cause,
        }
    }

    /// Moves on by what was observed at a tick; `is_direct`: the axis is in a direct mode.
    pub fn observe(&mut self, observation: &Observation, is_direct: bool) -> Transition {
        match (self.state, fault(observation, is_direct)) {
            // No sample came for a short while, and now one is here.
            (State::Settling(_), Some(_))
                if observation.position.is_some() && observation.missing < self.silence_ticks =>
            {
                self.settle(observation, 0)
            }
            (State::Settling(_) | State::Following, Some(cause)) => Transition::Latch(cause),
            (State::Settling(healthy), None) => self.settle(observation, healthy),
            (State::Following, None) | (State::Disarmed | State::Latched(_), _) => Transition::Stay,
        }
    }

    fn settle(&mut self, observation: &Observation, healthy: u64) -> Transition {
        self.state = match observation.position {
            Some(position) if observation.missing == 0 && healthy >= self.settling_ticks => {
                self.state = State::Following;
                return Transition::Begin(position);
            }
            Some(_) => {
                let taken_back =
                    observation.missing.saturating_mul(self.settling_ticks.div_ceil(u64::from(MISSING_PART)));
                State::Settling(healthy.saturating_sub(taken_back) + 1)
            }
            None => {
                self.obstacle = control_flag::FEEDBACK;
                State::Settling(if observation.is_stale { healthy } else { 0 })
            }
        };
        let since = *self.settles_since.get_or_insert(self.tick);
        if self.tick.saturating_sub(since) < self.patience_ticks {
            Transition::Stay
        } else {
            Transition::Latch(self.obstacle)
        }
    }
}

/// The fault that latches an armed axis, if there is one.
fn fault(observation: &Observation, is_direct: bool) -> Option<u32> {
    if observation.is_out_of_range || observation.is_lost || observation.standing == Some(Standing::Stuck) {
        Some(control_flag::FEEDBACK)
    } else if observation.standing.is_some() && !is_direct {
        // In manual a person sees that the axis stands, and a commissioning has to find the command that moves it.
        Some(control_flag::STALL)
    } else {
        None
    }
}
