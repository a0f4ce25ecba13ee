//! What an axis is operated in, and what requests may change of it.
//!
//! ```text
//! off --enable, with a mode--> manual, hold, track, commission --off, fault, requests stopped--> off
//!
//! manual, commission     the request's command, as long as requests come
//! hold                   goes to the request's target, without one to a stand, and stays ([`crate::target::profile`])
//! track                  follows its reference, as of its beginning
//! ```
//!
//! A request lasts for [`STREAM_TIMEOUT`], told by the samples that its program had seen and this axis has; then an axis
//! that needs them is off. A commissioning's command is neutral before that, after `feedback_timeout`: its program knows
//! what was sent, and goes on. Among modes other than off an axis changes without an enable.
//!
//! Enabling is an edge: the number `enable` differs from the message before, of the same session and at most
//! [`STREAM_TIMEOUT`] older. A program's first message is where the edge is counted from, so a message that was left in a
//! channel, by whomever, never moves an axis; nor does a restarted controller, which begins off. After a fault an axis
//! wants off, then an enable.
//!
//! Refused is, as a whole and with a count: a mode that is none, a command or a target that is not finite, a command
//! outside [-1, 1], a target outside the soft limits, a message without this axis, one for another time, and one that
//! goes back in time. The axis then does what it did, and a mode that needs requests has not had one. Off is refused while the emergency stop is pressed: it would reset.
//!
//! Trap: "the last message counts" is a machine that goes on when its operator's program has died.

use std::time::Duration;

use pipeline::{
    MAX_AXES,
    machine::{Axis, Timing, samples_of},
    message::{AxisMode, AxisRequest, Request},
};

/// How long a manual command lasts: ten messages at 100 Hz, and less than a person takes to see it.
pub const STREAM_TIMEOUT: Duration = Duration::from_millis(100);

/// What the newest request means for one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Asked {
    /// Another mode than it was in, or the same again.
    pub mode: Option<AxisMode>,
    /// There was an edge.
    pub enabled: bool,
    /// Where to hold, m.
    pub target: Option<f64>,
}

/// The requests to one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Requests {
    axis: usize,
    soft_limits: (f64, f64),
    manual_ticks: u64,
    commission_ticks: u64,
    /// Session, number and tick of the last message that was looked at, and its `enable`.
    last: Option<(u64, u64, u64)>,
    enable: Option<u32>,
    /// Tick of the last one that was taken, and what it asked for.
    taken: Option<u64>,
    command: f64,
    accepted: u64,
    refused: u32,
    is_refused: bool,
}

impl Requests {
    /// To the axis with this number.
    pub fn new(index: usize, axis: &Axis, timing: &Timing) -> Self {
        let ticks = |duration| samples_of(duration, timing.period).max(1) as u64;
        Self {
            axis: index,
            soft_limits: axis.soft_limits,
            manual_ticks: ticks(STREAM_TIMEOUT),
            commission_ticks: ticks(timing.feedback_timeout),
            last: None,
            enable: None,
            taken: None,
            command: 0.0,
            accepted: 0,
            refused: 0,
            is_refused: false,
        }
    }

    /// Takes in the newest message at tick `sequence`; the same again, and one that is refused, ask for nothing.
    pub fn update(&mut self, request: &Request, sequence: u64) -> Option<Asked> {
        let this = (request.session, request.header.number, request.header.sequence);
        if self.last == Some(this) {
            return None;
        }
        let before = self.last.replace(this).filter(|before| before.0 == request.session);
        let enabled = self.take_enable(request, before.map(|before| before.2));
        let goes_back = before.is_some_and(|(_, number, tick)| this.1 <= number || this.2 < tick);
        let in_time = sequence.abs_diff(request.header.sequence) <= self.manual_ticks;
        let sound = self.sound(request).filter(|_| in_time && !goes_back);
        self.is_refused = sound.is_none();
        let Some((mode, axis)) = sound else {
            self.refused = self.refused.saturating_add(1);
            return None;
        };
        self.taken = Some(request.header.sequence);
        self.accepted += 1;
        self.command = axis.command;
        let mode = Some(mode).filter(|mode| *mode != AxisMode::Unchanged);
        Some(Asked { mode, enabled, target: (axis.has_target == 1).then_some(axis.target) })
    }

    /// The command by hand at tick `sequence` in this mode; none when requests have stopped.
    pub fn command(&self, sequence: u64, mode: AxisMode) -> Option<f64> {
        let age = sequence.saturating_sub(self.taken?);
        let is_late = mode == AxisMode::Commission && age > self.commission_ticks;
        (age <= self.manual_ticks).then_some(if is_late { 0.0 } else { self.command })
    }

    /// Refuses after all what was asked for last.
    pub fn refuse(&mut self) {
        (self.accepted, self.refused) = (self.accepted.saturating_sub(1), self.refused.saturating_add(1));
        self.is_refused = true;
    }

    /// Requests taken and refused so far.
    pub fn counts(&self) -> (u64, u32) {
        (self.accepted, self.refused)
    }

    /// Whether the newest was refused.
    pub fn is_refused(&self) -> bool {
        self.is_refused
    }

    /// Whether there is an edge, counted from a message of tick `before`. An edge in a message that is refused is none.
    fn take_enable(&mut self, request: &Request, before: Option<u64>) -> bool {
        let now = request.axes.get(self.axis).map(|axis| axis.enable);
        let last = std::mem::replace(&mut self.enable, now);
        let in_a_row = before.is_some_and(|tick| request.header.sequence.abs_diff(tick) <= self.manual_ticks);
        in_a_row && last != now
    }

    /// The axis' part of a message that makes sense.
    fn sound(&self, request: &Request) -> Option<(AxisMode, AxisRequest)> {
        let count = request.header.axis_count as usize;
        let axis = *request.axes.get(self.axis).filter(|_| self.axis < count && count <= MAX_AXES)?;
        let mode = AxisMode::from_number(axis.mode)?;
        let (low, high) = self.soft_limits;
        let is_sound = (-1.0..=1.0).contains(&axis.command)
            && axis.has_target <= 1
            && axis.target.is_finite()
            && (axis.has_target == 0 || (low..=high).contains(&axis.target));
        is_sound.then_some((mode, axis))
    }
}
