//! The references of one axis: of this tick and of the coming ones.
//!
//! | module | what it holds |
//! |---|---|
//! | [`generator`] | sines, ramps and trajectories, as the machine file sets them |
//! | [`trajectory`] | straight lines through points in time |
//! | [`path`] | the time along the path, slower where an axis cannot follow |
//! | [`blend`] | the way from standing still to a generator that starts elsewhere or has gone on |
//! | [`channel`] | references from another program, accepted or refused |
//! | [`profile`] | motions to a set point, bounded in speed, acceleration and jerk |
//!
//! While the axis tracks, its references come from its generator or from the channel. While it holds, they come from
//! the profile; tracking begins once the profile has come to a stand. The profile also brings the references to a stand
//! when the channel stops or sends what is refused, until an accepted message goes on from there.
//!
//! Runs in the loop: nothing here allocates after construction.

pub mod blend;
pub mod channel;
pub mod generator;
pub mod path;
pub mod profile;
pub mod trajectory;

use pipeline::{
    machine::{Axis, ReferenceSource},
    message::Reference,
};

use crate::model::response::MAX_AHEAD;
use blend::Blend;
use channel::ChannelFollower;
use generator::ReferenceGenerator;
use path::Capability;
use profile::Profile;

/// The references of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct References {
    axis: usize,
    period: f64,
    /// `None` for an axis whose references come from its generator.
    channel: Option<ChannelFollower>,
    /// The channel has stopped, and the profile brings the reference to a stand.
    brakes: bool,
    blend: Blend,
    /// `None` for an axis that slows no reference.
    capability: Option<Capability>,
    profile: Profile,
    state: State,
    ahead: Ahead,
    /// References of this tick and the coming ones, m.
    positions: [f64; MAX_AHEAD],
    /// Tick along the path of the last position that the generator has given.
    filled: Option<f64>,
    /// Speed of the reference, m/s.
    speed: f64,
}

/// Numbers of coming ticks.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ahead {
    /// That the laws of the axis use.
    used: usize,
    /// That are worked out.
    all: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Follows generator or channel.
    Tracks,
    /// Goes to a set point and stays there.
    Holds,
    /// Comes to a stand, and tracks then.
    Halts,
}

/// How the references of a tick came about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReferenceStatus {
    /// The channel's message is refused, and the axis holds its reference.
    pub is_refused: bool,
    /// The blend is over, or the channel has been taken up: the tracking error counts.
    pub counts: bool,
    /// The axis tracks, and is on the way to a reference that starts elsewhere.
    pub is_approach: bool,
    /// The generator goes on more slowly, since an axis cannot give what the references ask for.
    pub is_slowed: bool,
}

/// Part of the speed that an axis of the teeth reaches with which it goes to the begin of their way: the others go
/// there at the same time, and the pump serves all of them.
const APPROACH: f64 = 0.5;

/// Fastest speed with which an axis goes to the begin of a way that others trace with it, m/s.
fn approach(axis: &Axis) -> f64 {
    let model = axis.commissioned.as_ref().filter(|_| axis.reference == ReferenceSource::Tip);
    model.map_or(f64::INFINITY, |model| APPROACH * model.reached(axis.control.command_limit))
}

impl References {
    /// References of the axis with this number for this tick and `used` more ticks, of which `ahead` are worked out if
    /// these are more; `period` in s.
    pub fn new(index: usize, axis: &Axis, period: f64, used: usize, ahead: usize) -> Self {
        let [used, ahead] = [used, ahead.max(used)].map(|ticks| ticks.min(MAX_AHEAD - 1));
        let from_channel = axis.reference == ReferenceSource::Channel;
        Self {
            axis: index,
            period,
            channel: from_channel.then(|| ChannelFollower::new(index, axis, period)),
            brakes: false,
            blend: Blend::new(axis.max_speed, axis.soft_limits).within(approach(axis)),
            capability: Capability::of(axis, period),
            profile: Profile::new(axis, period, ahead),
            state: State::Tracks,
            ahead: Ahead { used, all: ahead },
            positions: [0.0; MAX_AHEAD],
            filled: None,
            speed: 0.0,
        }
    }

    /// Number of coming ticks that are worked out.
    pub fn ahead(&self) -> usize {
        self.ahead.all
    }

    /// The rate at which time along the path may go on at `tick` of the path, as far as this axis can follow.
    pub fn rate(&self, tick: f64, generator: &ReferenceGenerator) -> f64 {
        let Some(capability) = self.capability.as_ref().filter(|_| self.state == State::Tracks) else { return 1.0 };
        let position = |tick: f64| self.blend.back.position(tick, self.blended(tick, generator));
        let from = position(tick);
        capability.rate(from, (position(tick + 1.0) - from) / self.period)
    }

    /// The reference of the generator at `tick` of the path, with the way to it, m.
    fn blended(&self, tick: f64, generator: &ReferenceGenerator) -> f64 {
        let t = self.blend.ticks(tick) * self.period;
        self.blend.position(t, generator.along(self.axis, t, tick, self.period))
    }

    /// Whether the reference follows its generator or channel, or is on the way to it.
    pub fn pursues(&self) -> bool {
        self.state == State::Tracks
    }

    /// Whether the reference follows its generator and has come to it at `tick` of the path.
    pub fn has_arrived(&self, tick: f64) -> bool {
        self.pursues() && self.blend.is_over(self.blend.ticks(tick) * self.period)
    }

    /// Begins to track at `tick` of the path, from where the axis stands (m).
    pub fn begin(&mut self, tick: f64, position: f64, generator: &ReferenceGenerator) {
        (self.state, self.positions[0], self.speed, self.brakes) = (State::Tracks, position, 0.0, false);
        self.filled = None;
        self.blend.begin(tick, position, generator.position(self.axis, 0.0));
        if let Some(channel) = &mut self.channel {
            channel.begin(position);
        }
    }

    /// Stands, and goes to its generator from `tick` of the path on.
    pub fn stay(&mut self, tick: f64, generator: &ReferenceGenerator) {
        self.begin(tick, self.positions[0], generator);
    }

    /// Goes on at `tick` of the path from where the axis stands (m), after a time in which it could not follow. A
    /// reference that has not moved meanwhile stays as it is.
    pub fn go_on(&mut self, tick: f64, position: f64, generator: &ReferenceGenerator) {
        let wanted = self.blended(tick, generator);
        let is_still = match self.state {
            State::Tracks => self.channel.is_none() && wanted == self.positions[0] && self.speed == 0.0,
            State::Holds | State::Halts => self.profile.stands(),
        };
        if is_still {
            return;
        }
        (self.positions[0], self.speed, self.brakes, self.filled) = (position, 0.0, false, None);
        if self.state != State::Tracks {
            let set_point = self.profile.set_point();
            self.profile.begin(position, 0.0);
            self.profile.aim(set_point);
        } else if let Some(channel) = &mut self.channel {
            channel.begin(position);
        } else {
            self.blend.back.begin(tick, position, wanted, self.period);
        }
    }

    /// Comes to a stand and holds. The motion begins at `from`, a position (m) and a speed (m/s), or goes on from the
    /// present reference.
    pub fn hold(&mut self, from: Option<(f64, f64)>) {
        if from.is_some() || self.state == State::Tracks {
            let (position, speed) = from.unwrap_or((self.positions[0], self.speed));
            self.profile.begin(position, speed);
            (self.positions[0], self.speed) = (position, speed);
        }
        self.state = State::Holds;
    }

    /// Changes the set point (m) of an axis that holds.
    pub fn aim(&mut self, set_point: f64) {
        if self.state == State::Holds {
            self.profile.aim(set_point);
        }
    }

    /// Lets an axis that holds come to a stand and track then.
    pub fn track(&mut self) {
        if self.state == State::Holds {
            self.profile.stop();
            self.state = State::Halts;
        }
    }

    /// Speed of the reference, m/s.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Works out the references from tick `sequence` on, `elapsed` ticks after the last call. `path` has this tick and
    /// the coming ones along the path.
    pub fn update(
        &mut self,
        (sequence, elapsed): (u64, u64),
        position: f64,
        path: &[f64],
        generator: &ReferenceGenerator,
        reference: Option<&Reference>,
    ) -> ReferenceStatus {
        let before = self.positions[0];
        if self.state == State::Halts && self.profile.stands() {
            self.begin(path[0], self.profile.set_point(), generator);
        }
        let status = if self.state == State::Tracks {
            self.pursue((sequence, elapsed), position, path, generator, reference)
        } else {
            self.profile.advance(elapsed, before - position);
            self.profile.fill(&mut self.positions[..=self.ahead.all]);
            ReferenceStatus { is_refused: false, counts: false, is_approach: false, is_slowed: false }
        };
        self.speed = (self.positions[0] - before) / (elapsed.max(1) as f64 * self.period);
        status
    }

    /// The references of generator or channel.
    fn pursue(
        &mut self,
        (sequence, elapsed): (u64, u64),
        position: f64,
        path: &[f64],
        generator: &ReferenceGenerator,
        reference: Option<&Reference>,
    ) -> ReferenceStatus {
        let before = self.positions[0];
        if let Some(channel) = &mut self.channel {
            let positions = &mut self.positions[..=self.ahead.all];
            let is_accepted = channel.update(reference, sequence, elapsed, position, positions);
            if is_accepted {
                self.brakes = false;
            } else if self.brakes || self.speed != 0.0 {
                if !self.brakes {
                    self.profile.begin(before, self.speed);
                    self.brakes = true;
                }
                self.profile.advance(elapsed, before - position);
                self.profile.fill(positions);
                channel.hold(positions[0]);
            }
            let (counts, is_slowed) = (channel.has_engaged(), channel.is_on_the_way());
            return ReferenceStatus { is_refused: !is_accepted, counts, is_approach: !counts, is_slowed };
        }
        // A reference depends on its time alone, so all but the newest are known from the tick before.
        let is_known = elapsed == 1 && self.ahead.all > 0 && self.filled == Some(path[self.ahead.all - 1]);
        let known = if is_known {
            self.positions.copy_within(1..=self.ahead.all, 0);
            self.ahead.all
        } else {
            0
        };
        self.filled = Some(path[self.ahead.all]);
        for (i, tick) in path.iter().enumerate().take(self.ahead.all + 1).skip(known) {
            self.positions[i] = self.blend.back.position(*tick, self.blended(*tick, generator));
        }
        let counts = self.blend.is_over(self.blend.ticks(path[0]) * self.period);
        ReferenceStatus { is_refused: false, counts, is_approach: !counts, is_slowed: path[1] - path[0] < 1.0 }
    }

    /// y_r(k), y_r(k+1), .. as of the last update, m, as far as the laws of the axis use them.
    pub fn positions(&self) -> &[f64] {
        &self.positions[..=self.ahead.used]
    }

    /// y_r(k), y_r(k+1), .. as of the last update, m, as far as they are worked out; none while they come from a
    /// channel, whose preview ends somewhere: an axis that seems to stop there is not about to.
    pub fn coming(&self) -> Option<&[f64]> {
        let is_known = self.channel.is_none() || self.state != State::Tracks;
        is_known.then(|| &self.positions[..=self.ahead.all])
    }
}
