//! Targets from another program, accepted or refused.
//!
//! ```text
//! i = k - k_ref                                    place of this tick in the preview, 0 while k < k_ref
//! |y_r(k) - y_r(k-1)| <= 1.5 v_max T + 1 mm        also from each preview entry to the next
//! ```
//!
//! k tick of the sample, k_ref tick of the message's first target, v_max `max_speed` in m/s, T period in s. A message
//! that is absent, used up, not finite, outside the soft limits, jumping, or older than one before is refused, and
//! the axis holds the target that it has, or comes to a stand from it ([`super::Target`]).
//!
//! Trap: after a refusal, and at the start, the program may be anywhere. Its targets are taken up again only where
//! they go on from the target held or where the axis stands, so that taking them up moves nothing.

use pipeline::{
    machine::Axis,
    message::{MAX_PREVIEW, Reference},
};

/// How near to the position the first target of a channel must be, m: a person moves the axis' target there before
/// the axis moves, and 10 mm is what can be seen on a machine.
pub const ENGAGE_DISTANCE: f64 = 0.010;
/// Allowance over the fastest speed: a program need not write at exactly our rate.
const SPEED_ALLOWANCE: f64 = 1.5;
/// Change of a target that is never a jump, m: rounding to whole millimetres.
const LEAST_JUMP: f64 = 1e-3;

/// Follows the reference channel for one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelFollower {
    axis: usize,
    soft_limits: (f64, f64),
    /// Largest change of the target per tick, m.
    max_step: f64,
    held: f64,
    engaged: bool,
    was_engaged: bool,
    /// `sequence` of the newest message that was accepted.
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
            engaged: false,
            was_engaged: false,
            newest: None,
        }
    }

    /// Starts again from where the axis stands (m).
    pub fn begin(&mut self, position: f64) {
        (self.held, self.engaged, self.was_engaged, self.newest) = (position, false, false, None);
    }

    /// Another target is held, m.
    pub fn hold(&mut self, target: f64) {
        self.held = target;
    }

    /// Whether it has followed the channel since [`Self::begin`].
    pub fn has_engaged(&self) -> bool {
        self.was_engaged
    }

    /// Fills `targets` (m) from tick `sequence` on; false when the reference is refused and the target is held.
    ///
    /// `elapsed` is the number of ticks since the last call, `position` (m) where the axis stands.
    pub fn update(
        &mut self,
        reference: Option<&Reference>,
        sequence: u64,
        elapsed: u64,
        position: f64,
        targets: &mut [f64],
    ) -> bool {
        let coming = self.coming(reference, sequence).filter(|coming| self.continues(coming[0], elapsed, position));
        let accepted = coming.is_some();
        if let (Some(coming), Some(reference)) = (coming, reference) {
            let last = coming[coming.len() - 1];
            for (i, target) in targets.iter_mut().enumerate() {
                *target = coming.get(i).copied().unwrap_or(last);
            }
            self.held = coming[0];
            self.newest = Some(reference.header.sequence);
            self.was_engaged = true;
        } else {
            targets.fill(self.held);
        }
        self.engaged = accepted;
        accepted
    }

    /// The targets from this tick on, at least one, if the message and all of them are sound.
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
        let inside = coming.iter().all(|target| (low..=high).contains(target));
        let smooth = coming.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= self.max_step);
        (inside && smooth).then_some(coming)
    }

    /// Whether a target goes on from what the axis does now.
    fn continues(&self, target: f64, elapsed: u64, position: f64) -> bool {
        let from_held = self.was_engaged && (target - self.held).abs() <= self.max_step * elapsed as f64;
        from_held || (!self.engaged && (target - position).abs() <= ENGAGE_DISTANCE)
    }
}
