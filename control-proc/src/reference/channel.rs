//! References from another program, accepted or refused.
//!
//! ```text
//! i = k - k_ref                                    place of this tick in the preview, 0 while k < k_ref
//! |y_r(k) - y_r(k-1)| <= 1.5 v_max T + 1 mm        also from each preview entry to the next
//! ```
//!
//! k tick of the sample, k_ref tick of the message's first reference, v_max `max_speed` in m/s, T period in s. A
//! message is refused if it is missing, used up, not finite, outside the soft limits, or older than one before, or if
//! its references jump. Then the axis holds its present reference, or comes to a stand from it ([`super::References`]).
//!
//! Trap: after a refusal, and at the start, the program may be anywhere. Its references are taken up again only where
//! they go on from the reference that is held or from where the axis stands, so that nothing moves when they are taken
//! up.

use pipeline::{
    machine::Axis,
    message::{MAX_PREVIEW, Reference},
};

/// Largest distance of a channel's first reference from the position, m. A person first brings the reference to where
/// the axis stands; 10 mm can be seen on a machine.
pub const ENGAGE_DISTANCE: f64 = 0.010;
/// Allowance over the fastest speed: a program need not send at exactly the rate of the samples.
const SPEED_ALLOWANCE: f64 = 1.5;
/// Change of a reference that is never a jump, m: rounding to whole millimetres.
const LEAST_JUMP: f64 = 1e-3;

/// Follows the reference channel for one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelFollower {
    axis: usize,
    soft_limits: (f64, f64),
    /// Largest change of the reference per tick, m.
    max_step: f64,
    /// The reference that is held while messages are refused, m.
    held: f64,
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
        Self {
            axis: index,
            soft_limits: axis.soft_limits,
            max_step: axis.max_speed * period * SPEED_ALLOWANCE + LEAST_JUMP,
            held: 0.0,
            is_engaged: false,
            was_engaged: false,
            newest: None,
        }
    }

    /// Starts again from where the axis stands (m).
    pub fn begin(&mut self, position: f64) {
        (self.held, self.is_engaged, self.was_engaged, self.newest) = (position, false, false, None);
    }

    /// Holds another reference, m.
    pub fn hold(&mut self, reference: f64) {
        self.held = reference;
    }

    /// Whether the axis has followed the channel since [`Self::begin`].
    pub fn has_engaged(&self) -> bool {
        self.was_engaged
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
        if let (Some(coming), Some(reference)) = (coming, reference) {
            let last = coming[coming.len() - 1];
            for (i, reference) in positions.iter_mut().enumerate() {
                *reference = coming.get(i).copied().unwrap_or(last);
            }
            self.held = coming[0];
            self.newest = Some(reference.header.sequence);
            self.was_engaged = true;
        } else {
            positions.fill(self.held);
        }
        self.is_engaged = accepted;
        accepted
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
        let (low, high) = self.soft_limits;
        let inside = coming.iter().all(|reference| (low..=high).contains(reference));
        let smooth = coming.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= self.max_step);
        (inside && smooth).then_some(coming)
    }

    /// Whether a reference goes on from what the axis does now.
    fn continues(&self, reference: f64, elapsed: u64, position: f64) -> bool {
        let from_held = self.was_engaged && (reference - self.held).abs() <= self.max_step * elapsed as f64;
        from_held || (!self.is_engaged && (reference - position).abs() <= ENGAGE_DISTANCE)
    }
}
