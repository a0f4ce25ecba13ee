//! The experiment with one axis: what is commanded when.
//!
//! | module | what it holds |
//! |---|---|
//! | [`terms`] | options, phases and outcome |
//! | `window` | where the axis may move, and how fast |
//! | `pulses`, `strokes`, `random_steps` | the commands of the phases |
//! | `step` | one step, and what the axis does in it |
//! | [`direction`] | how fast the commands of one direction move the axis |
//! | [`watch`] | the bounds, checked at every sample |
//! | [`abort`] | reasons that end the experiment before its time |
//!
//! ```text
//! rest     neutral, to see the noise
//! pulses   up and down without a pause; levels rise by 0.03 or a tenth until the axis has moved, then a wait; a
//!          direction that has not moved goes on alone, with a wait in which every dead time ends after every pulse
//! strokes  towards the middle of the window, from rest to rest; level l' where sqrt(v) reaches sqrt(0.9 v_max) on the
//!          line through the last two strokes, l' - l_0 <= 3 (l - l_0)
//! random   steps of random level and length, while  low <= y -+ rest(k) <= high
//! shaken   after a stroke by which a fast valve has shaken its load, commands rise within a period of its swing
//! end      neutral until the axis stands
//! ```
//!
//! l level of the last stroke and v its fastest speed m/s, v_max speed bound m/s, l_0 the level that first moved the
//! axis, y position m, low and high ends of the window m, rest(k) way that is under way m ([`direction`]). A speed
//! curve that is less than quadratic above l_0 does not exceed the bound.
//!
//! Traps: an encoder that is stuck from the beginning looks like a valve that does not open. So the pulses are short,
//! go both ways, and end at [`PULSE_LIMIT`]. And a load that a step has shaken lets in less oil while it swings towards
//! the pump: speeds would be found too low. A ramp of one period of the swing shakes it little (N. Singer and
//! W. Seering, Preshaping Command Inputs to Reduce System Vibration, 1990).
//!
//! Runs once per sample: nothing here allocates after construction.

pub mod abort;
pub mod direction;
mod pulses;
mod random;
mod random_steps;
mod step;
mod strokes;
pub mod terms;
pub mod watch;
mod window;

pub use pulses::PULSE_LIMIT;

use std::time::Duration;

use pipeline::{
    machine::{Axis, Timing, samples_of},
    message::AxisSample,
};

use super::record::ExperimentRecord;
use crate::{margins::FAST_VALVE, protection::limits::Limits};
use abort::Abort;
use direction::Direction;
use random::Random;
use step::Step;
use terms::{ExperimentOptions, Outcome, Phase};
use watch::{SPEED_TIME, Watch};
use window::Window;

/// Motion is clear from here on, m, for an encoder that is fine enough.
const CLEAR: f64 = 1e-3;
/// Counts of the encoder from which on motion is clear.
const CLEAR_COUNTS: f64 = 10.0;
/// Counts of the encoder, within [`SPEED_TIME`], that are no motion.
const QUIET_COUNTS: f64 = 4.0;
/// Part of the speed bound that is told from standstill. A coarse encoder needs longer than [`SPEED_TIME`] for it.
const SLOW: f64 = 0.1;
/// Longest time for telling motion from standstill, s.
const LONGEST_LOOK: f64 = 0.4;
/// Counts of the encoder within which positions are equal.
const EQUAL_COUNTS: f64 = 2.0;
/// Longest reaction that is looked back for, s.
const MEMORY: f64 = 1.5;
/// Time from command to motion that is counted on before one was seen, ticks.
const FIRST_REACTION: usize = 3;
/// Time beyond the reaction for which a command may still be at work, s.
const AFTER_REACTION: f64 = 0.3;
/// Time for which a command may be at work before the axis' reaction is known, s.
const UNKNOWN_REACTION: f64 = 1.0;
/// Time within which an axis that creeps from the middle to an end of the window has left it by itself, s.
const CREEP_TIME: f64 = 20.0;
/// Time without motion after which the axis stands, s.
const STANDING_TIME: f64 = 0.1;
/// Lowest level of the random steps, as part of the level that moved the axis: the dead band has to be in the data too.
const LOWEST_LEVEL: f64 = 0.7;
/// Part of the way of a stroke by which a load that swings comes back, and its longest period, s.
const SWUNG: f64 = 0.03;
const LONGEST_SWING: f64 = 0.6;
/// Time for which the random steps have to last at least, s.
const LEAST_RANDOM: f64 = 8.0;

/// What was found of the axis so far.
#[derive(Debug, Clone)]
struct Found {
    /// Extending and retracting.
    directions: [Direction; 2],
    /// Level of a stroke that the window had no room for, since the last one that it had.
    cut: [Option<f64>; 2],
    /// Whether pulses have searched the direction a second time.
    is_searched_again: [bool; 2],
    /// Longest time from neutral to rest, or to where a load that swings turns back, ticks.
    reaction: usize,
    /// Longest time from neutral to rest, with all swings, ticks.
    settling: usize,
    /// Longest time from a command to clear motion, ticks: a spool takes longer to leave its dead band than to return.
    start: usize,
    /// Way from which on motion is clear, m.
    clear: f64,
    /// Way within which the axis stands over [`SPEED_TIME`], or over longer where the encoder is coarse, m.
    quiet: f64,
    /// Way that the axis creeps by itself, m per tick.
    drift: f64,
}

/// What pulses depend on.
#[derive(Debug, Clone, Copy)]
struct Pulse {
    level: f64,
    /// Time constant of the pump, s.
    pump_response: f64,
}

/// The experiment with one axis.
#[derive(Debug, Clone)]
pub struct Experiment {
    limits: Limits,
    window: Window,
    watch: Watch,
    found: Found,
    pulse: Pulse,
    phase: Phase,
    step: Step,
    /// Ticks since the beginning.
    tick: usize,
    /// Ticks of the whole experiment.
    total: usize,
    random: Random,
    record: ExperimentRecord,
    outcome: Option<Outcome>,
}

impl Experiment {
    /// An experiment with an axis that is sampled as `timing` says. Nothing is allocated after this.
    pub fn new(axis: &Axis, timing: &Timing, options: &ExperimentOptions) -> Self {
        let period = timing.period;
        let seconds = period.as_secs_f64();
        let total = samples_of(options.duration, period);
        let resolution = axis.encoder.resolution;
        let memory = samples_of(Duration::from_secs_f64(MEMORY), period);
        Self {
            limits: Limits::new(&axis.control, seconds),
            window: Window::new(axis, options),
            watch: Watch::new(timing, memory, EQUAL_COUNTS * resolution),
            found: Found {
                directions: [Direction::new(), Direction::new()],
                cut: [None; 2],
                is_searched_again: [false; 2],
                reaction: FIRST_REACTION,
                settling: FIRST_REACTION,
                start: FIRST_REACTION,
                clear: CLEAR.max(CLEAR_COUNTS * resolution),
                quiet: QUIET_COUNTS * resolution,
                drift: 0.0,
            },
            pulse: Pulse { level: pulses::PULSE_STEP, pump_response: axis.control.pump_response },
            phase: Phase::Rest,
            step: Step::begin(f64::NAN, 0.0, 0),
            tick: 0,
            total,
            random: Random::new(options.seed),
            record: ExperimentRecord::new(seconds, total + 1),
            outcome: None,
        }
    }

    /// The command for one tick from its sample, if there is one.
    pub fn update(&mut self, sample: Option<&AxisSample>) -> f64 {
        if self.outcome.is_some() {
            return 0.0;
        }
        let command = match self.act(sample) {
            Ok(command) => command,
            Err(abort) => {
                self.end(Outcome::Aborted(abort));
                0.0
            }
        };
        self.watch.commanded(command);
        if self.record.commands.len() < self.record.commands.capacity() {
            self.record.commands.push(command);
            self.record.positions.push(sample.and_then(AxisSample::usable).unwrap_or(f64::NAN));
        }
        command
    }

    /// Ends the experiment from outside; the command is neutral from now on.
    pub fn stop(&mut self) {
        if self.outcome.is_none() {
            self.end(Outcome::Aborted(Abort::Stopped));
        }
    }

    /// How the experiment ended, once it has.
    pub fn outcome(&self) -> Option<Outcome> {
        self.outcome
    }

    /// The present phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// The part of its time that is over, 0 to 1.
    pub fn progress(&self) -> f64 {
        if self.outcome.is_some() { 1.0 } else { self.tick as f64 / self.total.max(1) as f64 }
    }

    /// Low and high end of the window, and the margin beyond, m; known after the first sample.
    pub fn window(&self) -> ((f64, f64), f64) {
        (self.window.range, self.window.margin)
    }

    /// The record so far.
    pub fn record(&self) -> &ExperimentRecord {
        &self.record
    }

    fn end(&mut self, outcome: Outcome) {
        self.outcome = Some(outcome);
        self.phase = Phase::Over;
    }

    fn ticks(&self, seconds: f64) -> usize {
        ((seconds / self.record.period).round() as usize).max(1)
    }

    /// The command of a tick: takes in the sample, checks the bounds, and acts as the phase says.
    fn act(&mut self, sample: Option<&AxisSample>) -> Result<f64, Abort> {
        let usable = self.watch.take(sample)?;
        self.tick += 1;
        let Some(position) = usable else {
            return Ok(if self.watch.is_waiting() { 0.0 } else { self.watch.command() });
        };
        if self.step.from.is_nan() {
            self.window.place(position)?;
            self.step = Step::begin(position, 0.0, 0);
            self.choose_aim()?;
        }
        self.check()?;
        self.observe(position);
        let wanted = match self.phase {
            Phase::Rest => self.rest(position)?,
            Phase::Pulses => self.pulses(position)?,
            Phase::Strokes => self.stroke(position)?,
            Phase::Random => self.random_steps(position),
            Phase::End | Phase::Over => 0.0,
        };
        if self.tick + self.found.reaction + self.ticks(AFTER_REACTION) >= self.total {
            return self.come_to_an_end();
        }
        // The rate limit counts from neutral where the direction changes: neutral is allowed at once.
        let last = self.watch.command();
        let last = if wanted * last < 0.0 { 0.0 } else { last };
        let reached = last.abs().max(self.closed(side_of(wanted)));
        let ramp = self.step.ramp;
        let opening = if ramp.is_finite() { wanted.abs().clamp(reached - ramp, reached + ramp) } else { wanted.abs() };
        Ok(if wanted == 0.0 { 0.0 } else { self.limits.apply(opening.copysign(wanted), last) })
    }

    /// The command when no time is left but for coming to rest.
    fn come_to_an_end(&mut self) -> Result<f64, Abort> {
        if self.phase != Phase::Random && self.phase != Phase::End {
            return Err(self.too_short());
        }
        self.phase = Phase::End;
        if self.tick >= self.total {
            self.end(Outcome::Finished);
        }
        Ok(0.0)
    }

    fn too_short(&self) -> Abort {
        Abort::TooShort { duration: self.total as f64 * self.record.period, needed: LEAST_RANDOM }
    }

    /// Chooses the speed that strokes aim at, by the window and the reaction that is known.
    fn choose_aim(&mut self) -> Result<(), Abort> {
        let time = (self.found.reaction + self.rise()) as f64 * self.record.period + strokes::STROKE_TIME;
        self.window.choose_aim(time, self.found.clear)
    }

    /// Checks the bounds.
    fn check(&mut self) -> Result<(), Abort> {
        let Window { range, margin, fastest, .. } = self.window;
        self.watch.check_bounds(range, margin, fastest).map_err(|abort| self.explained(abort))?;
        let directions = &self.found.directions;
        let is_known = !directions.iter().any(|direction| direction.last().is_none());
        let at_work =
            if is_known { self.found.settling + self.ticks(AFTER_REACTION) } else { self.ticks(UNKNOWN_REACTION) };
        self.watch.check_direction(at_work, fastest, is_known)?;
        self.watch.check_change(self.found.settling.max(self.found.start), self.found.reaction, |command| {
            let direction = &directions[side_of(command)];
            if command.abs() > direction.moving { direction.speed(command.abs()) } else { 0.0 }
        })
    }

    /// Tells an axis that has left the window by itself from one that was commanded to.
    fn explained(&self, abort: Abort) -> Abort {
        let Abort::Window { position, window, .. } = abort else { return abort };
        let (low, high) = self.watch.span(usize::MAX);
        let speed = if low == 0.0 && high == 0.0 {
            self.watch.speed_over(self.ticks(MEMORY))
        } else {
            self.found.drift / self.record.period
        };
        let out = if position > window.1 { speed } else { -speed };
        if out * CREEP_TIME > 0.5 * (window.1 - window.0) { Abort::Creep { position, window, speed } } else { abort }
    }

    /// Notes what the axis does in this step.
    fn observe(&mut self, position: f64) {
        let speed = self.watch.speed();
        let look = (self.found.quiet / (SLOW * self.window.fastest)).clamp(SPEED_TIME, LONGEST_LOOK);
        let is_quiet = self.watch.speed_over(self.ticks(look)).abs() * look <= self.found.quiet;
        self.step.observe(position, speed, self.found.drift, self.found.clear, is_quiet);
        // A load on oil swings back after a command of the other direction. That speed is not this direction's.
        let (low, high) = self.watch.span(self.found.reaction + self.ticks(AFTER_REACTION));
        let (mine, other) = if speed < 0.0 { (-low, high) } else { (high, low) };
        let direction = &mut self.found.directions[side_of(speed)];
        if other == 0.0 && mine > direction.moving {
            direction.learn(mine, speed.abs());
        }
    }

    /// Whether the command of the step went neutral `wait` ticks ago or earlier, and the axis stands.
    fn stands(&self, wait: usize) -> bool {
        let step = &self.step;
        step.neutral_at.is_some_and(|neutral| step.ticks >= neutral + wait)
            && step.ticks >= step.last_motion + self.ticks(STANDING_TIME)
    }

    /// Takes in the times of this step, which moved in the direction in place `side`.
    fn learn_reaction(&mut self, side: usize) {
        let longest = self.ticks(MEMORY) - self.ticks(AFTER_REACTION);
        let Step { last_motion, neutral_at, .. } = self.step;
        let since_neutral = |tick: usize| tick.saturating_sub(neutral_at.unwrap_or(usize::MAX));
        let turns = since_neutral(last_motion.min(self.step.farthest(side).at));
        self.learn_start();
        let found = &mut self.found;
        found.reaction = found.reaction.max(turns).min(longest);
        found.settling = found.settling.max(since_neutral(last_motion)).min(longest);
    }

    /// Takes in how long this step took to move the axis.
    fn learn_start(&mut self) {
        let longest = self.ticks(MEMORY) - self.ticks(AFTER_REACTION);
        self.found.start = self.found.start.max(self.step.moved_at.unwrap_or(0)).min(longest);
    }

    /// Takes in how a load swung back after this stroke, which moved in the direction in place `side`.
    fn learn_swing(&mut self, side: usize) {
        let (from, back, farthest) = (self.step.from, self.step.reached.back, self.step.farthest(side));
        let (way, swung) = ((farthest.position - from).abs(), (farthest.position - back.position).abs());
        let period = 2 * (back.at - farthest.at);
        let is_shaken = self.found.reaction as f64 <= FAST_VALVE * period as f64;
        if swung > self.found.clear.max(SWUNG * way) && is_shaken && period <= self.ticks(LONGEST_SWING) {
            self.record.swing = self.record.swing.max(period as f64 * self.record.period);
        }
    }

    /// A level at which the valve of the direction in place `side` is about to open.
    fn closed(&self, side: usize) -> f64 {
        LOWEST_LEVEL * self.found.directions[side].moving
    }

    /// The change of the command from tick to tick by which the valve gets to the level `wanted` of the direction in
    /// place `side` within a period of the swing.
    fn ramp(&self, side: usize, wanted: f64) -> f64 {
        let last = (self.watch.command() * signed(side, 1.0)).max(self.closed(side));
        if self.rise() == 0 { f64::INFINITY } else { (wanted - last).abs() / self.rise() as f64 }
    }

    /// Ticks in which a command rises to its level.
    fn rise(&self) -> usize {
        (self.record.swing / self.record.period).round() as usize
    }

    /// Whether the axis would leave the window if it were commanded so once more and then neutral.
    fn would_leave(&self, position: f64, wanted: f64) -> bool {
        if wanted == 0.0 {
            return false;
        }
        let sign = wanted.signum();
        let direction = &self.found.directions[side_of(wanted)];
        let under_way = self.watch.commands(self.found.reaction).iter().chain([&wanted]);
        let way: f64 = under_way.map(|command| direction.speed((command * sign).max(0.0)) * self.record.period).sum();
        let (low, high) = self.window.range;
        if sign > 0.0 { position + way > high } else { position - way < low }
    }
}

/// Place of a direction: 0 for extending, 1 for retracting (a negative command or speed).
fn side_of(signed: f64) -> usize {
    usize::from(signed < 0.0)
}

/// A command of this magnitude in the direction in place `side`.
fn signed(side: usize, level: f64) -> f64 {
    if side == 0 { level } else { -level }
}
