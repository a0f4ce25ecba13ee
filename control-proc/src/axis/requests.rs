//! Requests to one axis: accepted, or refused with a count.
//!
//! A request lasts for [`STREAM_TIMEOUT`]. Its age is the difference between the sample that its program had seen and
//! the newest sample. An axis in a direct mode is off after that time. The command of a commissioning is neutral
//! earlier, after `feedback_timeout`: its program knows what was sent, and goes on.
//!
//! Arming by request is an edge: the number `enable` differs from that of the message before, which is of the same
//! session and at most [`STREAM_TIMEOUT`] older. The first message of a program only gives the number from which the
//! edge is counted. So a message that was left in a channel never moves an axis. A controller that has been restarted
//! is off. After a fault an axis has to be switched off and enabled again.
//!
//! A stop ([`Requests::stop`]) makes edges void that were made before it: the message that arms names a later sample.
//!
//! Releasing a latch is an edge as well: off, after a message of the same session that asked for something else, and
//! for a later sample than the stop. So neither a program that asks for off all the time nor one that has not seen the
//! stop yet releases what a person has to acknowledge.
//!
//! These messages are refused as a whole:
//! - a mode that does not exist,
//! - a command or a set point that is not finite,
//! - a command outside [-1, 1], or a set point outside the soft limits,
//! - other gains of the fallback for an axis that is armed, or gains outside of their range; off is never refused for
//!   that,
//! - a message without this axis,
//! - a message for another time, or one that goes back in time.
//!
//! After a refusal the axis does what it did before; a mode that needs requests has not had one. Off is refused while
//! the emergency stop is pressed, since it would reset the latch, and where it has no edge that releases the latch.
//!
//! Trap: if the last message simply counted, a machine would go on after its operator's program has died.

use std::time::Duration;

use pipeline::{
    MAX_AXES,
    machine::{Axis, Timing, samples_of},
    message::{AxisMode, AxisRequest, Request},
};

/// How long a command of a direct mode lasts: ten messages at 100 Hz, and less than the reaction time of a person.
pub const STREAM_TIMEOUT: Duration = Duration::from_millis(100);

/// What an accepted request means for one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accepted {
    /// The mode that is asked for, which may be the present one; none where the mode is to stay.
    pub mode: Option<AxisMode>,
    /// The request has the edge that arms the axis.
    pub is_enabled: bool,
    /// Where to hold, m.
    pub set_point: Option<f64>,
    /// The axis is to be disarmed when requests stop.
    pub hold_to_run: bool,
    /// Off releases a latched axis.
    pub can_release: bool,
    /// Gains of the fallback from now on, as a part of those of the machine file.
    pub gain: Option<f64>,
}

/// A message that was looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Seen {
    session: u64,
    number: u64,
    /// Newest sample that the program had seen.
    sequence: u64,
}

/// What a message asked of this axis, as far as edges are counted from it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Entry {
    /// Its number for arming; none where it has no entry for this axis.
    enable: Option<u32>,
    /// It asked for off.
    is_off: bool,
}

impl Entry {
    fn new(request: &Request, axis: usize) -> Self {
        let entry = request.axes.get(axis);
        Self {
            enable: entry.map(|axis| axis.enable),
            is_off: entry.is_some_and(|axis| axis.mode == AxisMode::Off as u32),
        }
    }
}

/// The requests to one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct Requests {
    axis: usize,
    soft_limits: (f64, f64),
    /// [`STREAM_TIMEOUT`] in ticks.
    manual_ticks: u64,
    /// `feedback_timeout` in ticks.
    commission_ticks: u64,
    /// The last message that was looked at, accepted or not.
    seen: Option<Seen>,
    /// What it asked for.
    entry: Entry,
    /// Tick of the last stop: only a program that has seen a later sample may arm the axis.
    stopped_at: Option<u64>,
    /// Tick of the last accepted message.
    accepted_at: Option<u64>,
    /// Command of the last accepted message.
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
            seen: None,
            entry: Entry::default(),
            stopped_at: None,
            accepted_at: None,
            command: 0.0,
            accepted: 0,
            refused: 0,
            is_refused: false,
        }
    }

    /// Takes in the newest message at tick `sequence`. `gains` are the least and the largest gain that may be asked for
    /// now. None for a message that was seen before, and for one that is refused.
    pub fn update(&mut self, request: &Request, sequence: u64, gains: [f64; 2]) -> Option<Accepted> {
        let Request { header, session, .. } = request;
        let this = Seen { session: *session, number: header.number, sequence: header.sequence };
        if self.seen == Some(this) {
            return None;
        }
        let before = self.seen.replace(this).filter(|before| before.session == this.session);
        let entry = Entry::new(request, self.axis);
        let last = std::mem::replace(&mut self.entry, entry);
        let is_after_stop = self.is_after_stop(this.sequence);
        let in_a_row = before.is_some_and(|before| this.sequence.abs_diff(before.sequence) <= self.manual_ticks);
        // The edge of a message that is refused is lost.
        let is_enabled = in_a_row && last.enable != entry.enable && is_after_stop;
        let can_release = before.is_some() && !last.is_off && is_after_stop;
        let goes_back = before.is_some_and(|before| this.number <= before.number || this.sequence < before.sequence);
        let is_in_time = sequence.abs_diff(this.sequence) <= self.manual_ticks;
        let sound = self.sound(request, gains).filter(|_| is_in_time && !goes_back);
        self.is_refused = sound.is_none();
        let Some((mode, axis)) = sound else {
            self.refused = self.refused.saturating_add(1);
            return None;
        };
        self.accepted_at = Some(this.sequence);
        self.accepted += 1;
        self.command = axis.command;
        let mode = Some(mode).filter(|mode| *mode != AxisMode::Unchanged);
        let set_point = (axis.has_target == 1).then_some(axis.target);
        let gain = Some(axis.gain).filter(|gain| *gain != 0.0 && before.is_some() && !entry.is_off);
        Some(Accepted { mode, is_enabled, set_point, hold_to_run: axis.hold_to_run == 1, can_release, gain })
    }

    /// A stop at tick `sequence`. Messages that were sent before it arm no axis.
    pub fn stop(&mut self, sequence: u64) {
        self.stopped_at = Some(sequence);
    }

    /// The command of a direct mode at tick `sequence`; none when requests have stopped.
    pub fn command(&self, sequence: u64, mode: AxisMode) -> Option<f64> {
        let age = sequence.saturating_sub(self.accepted_at?);
        let is_late = mode == AxisMode::Commission && age > self.commission_ticks;
        (age <= self.manual_ticks).then_some(if is_late { 0.0 } else { self.command })
    }

    /// Refuses the last accepted message afterwards.
    pub fn refuse(&mut self) {
        (self.accepted, self.refused) = (self.accepted.saturating_sub(1), self.refused.saturating_add(1));
        self.is_refused = true;
    }

    /// Counts a message that was not looked at.
    pub fn count_refused(&mut self) {
        self.refused = self.refused.saturating_add(1);
    }

    /// Numbers of accepted and of refused messages so far.
    pub fn counts(&self) -> (u64, u32) {
        (self.accepted, self.refused)
    }

    /// Whether the newest message was refused.
    pub fn is_refused(&self) -> bool {
        self.is_refused
    }

    /// Whether a message that names this sample was made after the last stop. Messages that are far from the stop are
    /// refused as too old, or their source has started again.
    fn is_after_stop(&self, sequence: u64) -> bool {
        self.stopped_at.is_none_or(|stop| sequence > stop || sequence.abs_diff(stop) > self.manual_ticks)
    }

    /// Mode and entry of this axis, if the message makes sense by itself.
    fn sound(&self, request: &Request, [least, largest]: [f64; 2]) -> Option<(AxisMode, AxisRequest)> {
        let count = request.header.axis_count as usize;
        let axis = *request.axes.get(self.axis).filter(|_| self.axis < count && count <= MAX_AXES)?;
        let mode = AxisMode::from_number(axis.mode)?;
        let (low, high) = self.soft_limits;
        let is_sound = (-1.0..=1.0).contains(&axis.command)
            && axis.has_target <= 1
            && axis.hold_to_run <= 1
            && axis.target.is_finite()
            && (axis.has_target == 0 || (low..=high).contains(&axis.target))
            && (mode == AxisMode::Off || axis.gain == 0.0 || (least..=largest).contains(&axis.gain));
        is_sound.then_some((mode, axis))
    }
}
