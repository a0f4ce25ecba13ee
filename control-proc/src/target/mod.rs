//! The reference of one axis: of this tick and of the coming ones.
//!
//! | module | what it holds |
//! |---|---|
//! | [`generator`] | sines, ramps and trajectories, as the machine file sets them |
//! | [`trajectory`] | straight lines through points in time |
//! | [`blend`] | the way from standing still to a generator that starts elsewhere |
//! | [`channel`] | references from another program, accepted or refused |
//! | [`profile`] | motions to a set point, bounded in speed, acceleration and jerk |
//!
//! While the axis tracks, its reference comes from its generator or from the channel. While it holds, its reference
//! comes from the profile; tracking begins once the profile has come to a stand. The profile also brings the reference to
//! a stand when the channel stops or sends what is refused, until an accepted message goes on from there.
//!
//! Runs in the loop: nothing here allocates after construction.

pub mod blend;
pub mod channel;
pub mod generator;
pub mod profile;
pub mod trajectory;

use pipeline::{
    machine::{Axis, ReferenceSource},
    message::Reference,
};

use blend::Blend;
use channel::ChannelFollower;
use generator::ReferenceGenerator;
use profile::Profile;

use crate::model::response::MAX_AHEAD;

/// The targets of one axis: this tick's and the coming ones.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    axis: usize,
    period: f64,
    channel: Option<ChannelFollower>,
    /// The channel has stopped, and its target comes to a stand.
    brakes: bool,
    profile: Profile,
    state: State,
    blend: Blend,
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
            channel: from_channel.then(|| ChannelFollower::new(index, axis, period)),
            brakes: false,
            profile: Profile::new(axis, period, ahead),
            state: State::Follows,
            blend: Blend::new(axis.max_speed),
            ahead,
            positions: [0.0; MAX_AHEAD],
            speed: 0.0,
        }
    }

    /// Begins to follow at tick `sequence`, from where the axis stands (m).
    pub fn begin(&mut self, sequence: u64, position: f64, generator: &ReferenceGenerator) {
        (self.state, self.positions[0], self.speed, self.brakes) = (State::Follows, position, 0.0, false);
        self.blend.begin(sequence, position, generator.position(self.axis, 0.0));
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
        let tick = self.blend.ticks(sequence);
        for (i, target) in positions.iter_mut().enumerate() {
            let t = (tick + i as u64) as f64 * self.period;
            *target = self.blend.position(t, generator.position(self.axis, t));
        }
        Following { refused: false, counts: self.blend.is_over(tick as f64 * self.period) }
    }

    /// y_r(k), y_r(k+1), .. as of the last update, m.
    pub fn positions(&self) -> &[f64] {
        &self.positions[..=self.ahead]
    }
}
