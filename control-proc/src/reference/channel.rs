//! References from another program, accepted or refused, and the way to them.
//!
//! ```text
//! i = k - k_ref                                    place of this tick in the preview, 0 while k < k_ref
//! |c(k) - c(k-1)| <= 1.5 v_max T + 1 mm            also from each preview entry to the next
//!
//! y_r(k) = c(k) - o(k)
//! o(k)   = o(k-1) + (1 - p(k)) (c(k) - c(k-1)) - p(k) T min(|o(k-1)| / 0.3 s, v_max / 10) sgn o(k-1)
//! p(k)   = p(k-1) + T / 1 s after an accepted message, p(k-1) - T / 0.2 s after a refused one, from 0 to 1
//! ```
//!
//! k tick of the sample, k_ref tick of the message's first reference, c the program's reference and y_r the one that
//! the axis follows, m; o what is still between them, m; p pace; v_max `max_speed` in m/s, T period in s. A message is
//! refused if it is missing, used up, not finite, outside the soft limits, or older than one before, or if its
//! references jump. Then the axis holds its present reference, or comes to a stand from it ([`super::References`]).
//!
//! After a refusal, and at the start, the program may be anywhere, and at any speed. Its references are taken up again
//! only where they go on from the reference that is held or pass within 10 mm of the axis, and from a stand: y_r has
//! their speed after a second, and makes good what it was behind with at most a tenth of v_max.
//!
//! Trap: a program that goes on through a silence passes an axis that stands. Whoever takes up its reference as it
//! comes lets the axis leap.

use pipeline::{
    machine::Axis,
    message::{MAX_PREVIEW, Reference},
};

use super::{
    blend::RETURN_SPEED,
    path::{FALL_TIME, RISE_TIME},
};

/// Largest distance of a channel's first reference from the position, m. A person first brings the reference to where
/// the axis stands; 10 mm can be seen on a machine.
pub const ENGAGE_DISTANCE: f64 = 0.010;
/// Allowance over the fastest speed: a program need not send at exactly the rate of the samples.
const SPEED_ALLOWANCE: f64 = 1.5;
/// Change of a reference that is never a jump, m: rounding to whole millimetres.
const LEAST_JUMP: f64 = 1e-3;
/// Time in which the rest of o fades, s. It never changes faster than an axis returns ([`RETURN_SPEED`]).
const FADE_TIME: f64 = 0.3;
/// o that is none any more, m.
const LEAST_OFFSET: f64 = 1e-5;

/// The way of one axis to the references of a program.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Way {
    period: f64,
    /// Fastest change of o, m/s.
    speed: f64,
    soft_limits: (f64, f64),
    /// p.
    pace: f64,
    /// o, m.
    offset: f64,
    /// y_r, m.
    reference: f64,
}

impl Way {
    /// Goes on by `ticks` to the program's reference `wanted` m, which has changed by `change` m.
    fn advance(&mut self, wanted: f64, change: f64, ticks: u64) -> f64 {
        let time = ticks as f64 * self.period;
        self.pace = (self.pace + time / RISE_TIME).min(1.0);
        let fade = (self.offset * (time / FADE_TIME).min(1.0)).clamp(-self.speed * time, self.speed * time);
        self.offset += (1.0 - self.pace) * change - self.pace * fade;
        if self.offset.abs() < LEAST_OFFSET {
            self.offset = 0.0;
        }
        let ((low, high), free) = (self.soft_limits, wanted - self.offset);
        self.reference = free.clamp(low.min(self.reference), high.max(self.reference));
        self.offset += free - self.reference;
        self.reference
    }
}

/// Follows the reference channel for one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelFollower {
    axis: usize,
    /// Largest change of the reference per tick, m.
    max_step: f64,
    way: Way,
    /// c of the newest accepted message, m, and the ticks since then.
    last: Option<(f64, u64)>,
    /// The last message was accepted.
    is_engaged: bool,
    /// A message has been accepted since [`Self::begin`].
    was_engaged: bool,
    /// `sequence` of the newest accepted message.
    newest: Option<u64>,
}

impl ChannelFollower {
    /// For the axis with this number; `period` in s.
    pub fn new(index: usize, axis: &Axis, period: f64) -> Self {
        let (speed, soft_limits) = (RETURN_SPEED * axis.max_speed, axis.soft_limits);
        Self {
            axis: index,
            max_step: axis.max_speed * period * SPEED_ALLOWANCE + LEAST_JUMP,
            way: Way { period, speed, soft_limits, pace: 0.0, offset: 0.0, reference: 0.0 },
            last: None,
            is_engaged: false,
            was_engaged: false,
            newest: None,
        }
    }

    /// Starts again from where the axis stands (m).
    pub fn begin(&mut self, position: f64) {
        (self.way.reference, self.way.pace, self.way.offset) = (position, 0.0, 0.0);
        (self.last, self.is_engaged, self.was_engaged, self.newest) = (None, false, false, None);
    }

    /// Holds another reference, m.
    pub fn hold(&mut self, reference: f64) {
        self.way.reference = reference;
    }

    /// Whether the axis has followed the channel since [`Self::begin`].
    pub fn has_engaged(&self) -> bool {
        self.was_engaged
    }

    /// Whether the axis follows the program's references behind their time, on the way to them.
    pub fn is_on_the_way(&self) -> bool {
        self.is_engaged && (self.way.pace < 1.0 || self.way.offset != 0.0)
    }

    /// Fills `positions` with the references (m) from tick `sequence` on. False when the message is refused and the
    /// last reference is held.
    ///
    /// `elapsed` is the number of ticks since the last call, `position` (m) where the axis stands.
    pub fn update(
        &mut self,
        reference: Option<&Reference>,
        sequence: u64,
        elapsed: u64,
        position: f64,
        positions: &mut [f64],
    ) -> bool {
        let coming = self.coming(reference, sequence).filter(|coming| self.continues(coming[0], elapsed, position));
        let accepted = coming.is_some();
        if let Some((_, ticks)) = &mut self.last {
            *ticks += elapsed;
        }
        if let (Some(coming), Some(reference)) = (coming, reference) {
            self.take_up(coming, elapsed, positions);
            self.newest = Some(reference.header.sequence);
            self.was_engaged = true;
        } else {
            self.rest(elapsed);
            positions.fill(self.way.reference);
        }
        self.is_engaged = accepted;
        accepted
    }

    /// Follows an accepted message.
    fn take_up(&mut self, coming: &[f64], elapsed: u64, positions: &mut [f64]) {
        let first = coming[0];
        let speed = self.last.map_or(0.0, |(last, ticks)| (first - last) / ticks.max(1) as f64);
        let change = speed * elapsed as f64;
        if !self.is_engaged {
            self.way.offset = first - change - self.way.reference;
        }
        self.way.advance(first, change, elapsed);
        self.last = Some((first, 0));
        let mut way = self.way;
        for (i, reference) in positions.iter_mut().enumerate() {
            *reference = match (i, coming.get(i)) {
                (0, _) => way.reference,
                (_, Some(wanted)) => way.advance(*wanted, wanted - coming[i - 1], 1),
                (_, None) => way.advance(coming[coming.len() - 1], 0.0, 1),
            };
        }
    }

    /// A tick without an accepted message.
    fn rest(&mut self, elapsed: u64) {
        self.way.pace = (self.way.pace - elapsed as f64 * self.way.period / FALL_TIME).max(0.0);
        if self.way.pace == 0.0 {
            self.way.offset = 0.0;
        }
    }

    /// The references of the message from this tick on, at least one, if the message and all of them are sound.
    fn coming<'a>(&self, reference: Option<&'a Reference>, sequence: u64) -> Option<&'a [f64]> {
        let reference = reference?;
        let preview = reference.preview as usize;
        let first = reference.header.sequence;
        let back_in_time = self.newest.is_some_and(|newest| first < newest);
        if preview == 0 || preview > MAX_PREVIEW || back_in_time || self.axis >= reference.header.axis_count as usize {
            return None;
        }
        if sequence.abs_diff(first) >= preview as u64 {
            return None;
        }
        let index = sequence.saturating_sub(first) as usize;
        let coming = &reference.positions.get(self.axis)?[index..preview];
        let (low, high) = self.way.soft_limits;
        let inside = coming.iter().all(|reference| (low..=high).contains(reference));
        let smooth = coming.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= self.max_step);
        (inside && smooth).then_some(coming)
    }

    /// Whether a reference goes on from what the axis does now.
    fn continues(&self, wanted: f64, elapsed: u64, position: f64) -> bool {
        let from_held = (wanted - self.way.offset - self.way.reference).abs() <= self.max_step * elapsed as f64;
        (self.was_engaged && from_held) || (!self.is_engaged && (wanted - position).abs() <= ENGAGE_DISTANCE)
    }
}
