//! From where the axis stands to what its generator asks for, without a jump.
//!
//! ```text
//! y_r(t) = y_0 + s(t / T_b) (g(t) - y_0)           s(r) = 10 r^3 - 15 r^4 + 6 r^5 for 0 <= r <= 1, then 1
//! T_b    = max(2 s, 15/8 |g(0) - y_0| / (v_max / 4))
//! ```
//!
//! y_0 position when the axis began to follow, g generator, v_max `max_speed`. s has no speed and no acceleration at
//! both ends; its steepest slope is 15/8, hence T_b keeps the way there below a quarter of the axis' speed. y_r lies
//! between y_0 and g, so it leaves the soft limits nowhere that the axis did not already stand. Trap: the preview
//! must be blended too, or prediction sees a step at the end of its window.

use pipeline::{
    machine::{Axis, ReferenceSource},
    message::Reference,
};

use crate::{channel::ChannelFollower, course::smooth, reference::ReferenceGenerator, response::MAX_AHEAD};

/// Shortest time from standing still to following, s: a person near the machine sees it begin.
pub const BLEND_TIME: f64 = 2.0;
/// Fastest way to a generator that starts elsewhere, as share of `max_speed`.
pub const BLEND_SPEED: f64 = 0.25;
/// Steepest slope of s.
const STEEPEST: f64 = 15.0 / 8.0;

/// The targets of one axis: this tick's and the coming ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    axis: usize,
    period: f64,
    blend_speed: f64,
    channel: Option<ChannelFollower>,
    start: u64,
    start_position: f64,
    blend_time: f64,
    ahead: usize,
    positions: [f64; MAX_AHEAD],
}

/// How the targets of a tick came about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Following {
    /// The channel's reference is refused and the axis holds its target.
    pub refused: bool,
    /// The way to the generator is over, or the channel has been taken up: the tracking error counts.
    pub counts: bool,
}

impl Target {
    /// Targets of the axis with this number for this and `ahead` more ticks; `period` in s.
    pub fn new(index: usize, axis: &Axis, period: f64, ahead: usize) -> Self {
        let from_channel = axis.reference == ReferenceSource::Channel;
        Self {
            axis: index,
            period,
            blend_speed: BLEND_SPEED * axis.max_speed,
            channel: from_channel.then(|| ChannelFollower::new(index, axis, period)),
            start: 0,
            start_position: 0.0,
            blend_time: BLEND_TIME,
            ahead: ahead.min(MAX_AHEAD - 1),
            positions: [0.0; MAX_AHEAD],
        }
    }

    /// Begins to follow at tick `sequence`, from where the axis stands (m).
    pub fn begin(&mut self, sequence: u64, position: f64, generator: &ReferenceGenerator) {
        (self.start, self.start_position) = (sequence, position);
        let distance = generator.position(self.axis, 0.0).map_or(0.0, |first| (first - position).abs());
        self.blend_time = BLEND_TIME.max(STEEPEST * distance / self.blend_speed);
        if let Some(channel) = &mut self.channel {
            channel.begin(position);
        }
    }

    /// Works out the targets from tick `sequence` on, `elapsed` ticks after the last call.
    pub fn update(
        &mut self,
        sequence: u64,
        elapsed: u64,
        position: f64,
        generator: &ReferenceGenerator,
        reference: Option<&Reference>,
    ) -> Following {
        let positions = &mut self.positions[..=self.ahead];
        if let Some(channel) = &mut self.channel {
            let accepted = channel.update(reference, sequence, elapsed, position, positions);
            return Following { refused: !accepted, counts: channel.has_engaged() };
        }
        let tick = sequence.saturating_sub(self.start);
        for (i, target) in positions.iter_mut().enumerate() {
            let t = (tick + i as u64) as f64 * self.period;
            let wanted = generator.position(self.axis, t).unwrap_or(self.start_position);
            *target = self.start_position + smooth(t / self.blend_time) * (wanted - self.start_position);
        }
        Following { refused: false, counts: tick as f64 * self.period >= self.blend_time }
    }

    /// y_r(k), y_r(k+1), .. as of the last update, m.
    pub fn positions(&self) -> &[f64] {
        &self.positions[..=self.ahead]
    }
}
