//! From where the axis stands to what its generator asks for, without a jump.
//!
//! ```text
//! y_r(t) = y_0 + s(t / T_b) (g(t) - y_0)           s(r) = 10 r^3 - 15 r^4 + 6 r^5 for 0 <= r <= 1, then 1
//! T_b    = max(2 s, 15/8 |g(0) - y_0| / (v_max / 4))
//! ```
//!
//! y_0 position when the axis began to follow, g generator, v_max `max_speed`. s has no speed and no acceleration at
//! both ends; its steepest slope is 15/8, hence T_b keeps the way there below a quarter of the axis' speed. y_r lies
//! between y_0 and g, so it leaves the soft limits nowhere that the axis did not already stand. While the axis holds, y_r
//! comes from [`crate::profile`] instead, and following begins where that has come to a stand; so do the targets of a
//! channel that has stopped, or sends what is refused, until it goes on from where they are. Trap: the preview must be
//! blended too, or prediction sees a step at the end of its window.

use pipeline::{
    machine::{Axis, ReferenceSource},
    message::Reference,
};

use crate::{
    channel::ChannelFollower, course::smooth, profile::Profile, reference::ReferenceGenerator, response::MAX_AHEAD,
};

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
    /// The channel has stopped, and its target comes to a stand.
    brakes: bool,
    profile: Profile,
    state: State,
    start: u64,
    start_position: f64,
    blend_time: f64,
    ahead: usize,
    positions: [f64; MAX_AHEAD],
    /// Of the target, m/s.
    speed: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Follows,
    Holds,
    /// Follows once it stands.
    Halts,
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
        let ahead = ahead.min(MAX_AHEAD - 1);
        let from_channel = axis.reference == ReferenceSource::Channel;
        Self {
            axis: index,
            period,
            blend_speed: BLEND_SPEED * axis.max_speed,
            channel: from_channel.then(|| ChannelFollower::new(index, axis, period)),
            brakes: false,
            profile: Profile::new(axis, period, ahead),
            state: State::Follows,
            start: 0,
            start_position: 0.0,
            blend_time: BLEND_TIME,
            ahead,
            positions: [0.0; MAX_AHEAD],
            speed: 0.0,
        }
    }

    /// Begins to follow at tick `sequence`, from where the axis stands (m).
    pub fn begin(&mut self, sequence: u64, position: f64, generator: &ReferenceGenerator) {
        (self.start, self.start_position) = (sequence, position);
        (self.state, self.positions[0], self.speed, self.brakes) = (State::Follows, position, 0.0, false);
        let distance = generator.position(self.axis, 0.0).map_or(0.0, |first| (first - position).abs());
        self.blend_time = BLEND_TIME.max(STEEPEST * distance / self.blend_speed);
        if let Some(channel) = &mut self.channel {
            channel.begin(position);
        }
    }

    /// Comes to a stand and holds: from where the target is, or from `position` (m) at `speed` (m/s) where it has none.
    pub fn hold(&mut self, from: Option<(f64, f64)>) {
        if from.is_some() || self.state == State::Follows {
            let (position, speed) = from.unwrap_or((self.positions[0], self.speed));
            self.profile.begin(position, speed);
            (self.positions[0], self.speed) = (position, speed);
        }
        self.state = State::Holds;
    }

    /// Holds at `goal` (m) instead.
    pub fn aim(&mut self, goal: f64) {
        if self.state == State::Holds {
            self.profile.aim(goal);
        }
    }

    /// Comes to a stand and then follows, where it holds.
    pub fn follow(&mut self) {
        if self.state == State::Holds {
            self.profile.stop();
            self.state = State::Halts;
        }
    }

    /// Speed of the target, m/s.
    pub fn speed(&self) -> f64 {
        self.speed
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
        let before = self.positions[0];
        if self.state == State::Halts && self.profile.stands() {
            self.begin(sequence, self.profile.goal(), generator);
        }
        let following = if self.state == State::Follows {
            self.pursue(sequence, elapsed, position, generator, reference)
        } else {
            self.profile.advance(elapsed);
            self.profile.fill(&mut self.positions[..=self.ahead]);
            Following { refused: false, counts: false }
        };
        self.speed = (self.positions[0] - before) / (elapsed.max(1) as f64 * self.period);
        following
    }

    /// The targets of generator or channel.
    fn pursue(
        &mut self,
        sequence: u64,
        elapsed: u64,
        position: f64,
        generator: &ReferenceGenerator,
        reference: Option<&Reference>,
    ) -> Following {
        let before = self.positions[0];
        let positions = &mut self.positions[..=self.ahead];
        if let Some(channel) = &mut self.channel {
            let accepted = channel.update(reference, sequence, elapsed, position, positions);
            if accepted {
                self.brakes = false;
            } else if self.brakes || self.speed != 0.0 {
                if !self.brakes {
                    self.profile.begin(before, self.speed);
                    self.brakes = true;
                }
                self.profile.advance(elapsed);
                self.profile.fill(positions);
                channel.hold(positions[0]);
            }
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
