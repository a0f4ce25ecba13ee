//! What is commanded when: rest, pulses, strokes, random steps.
//!
//! ```text
//! rest     neutral, to see the noise
//! pulses   up, down, and a wait in which every dead time ends; levels rise by 0.03 until that direction has moved
//! strokes  towards the middle of the window, from rest to rest; level l' = l_0 + (l - l_0) min(2, sqrt(0.9 v_max/v))
//! random   steps of random level and length, while  low <= y -+ rest(k) <= high
//! end      neutral until the axis stands
//! ```
//!
//! l level of the last stroke and v its fastest speed m/s, v_max speed bound m/s, l_0 the level that first moved the axis,
//! rest(k) what is under way, m ([`direction`]). No curve that is less than quadratic above l_0 overruns the bound. Trap:
//! an encoder that is stuck from the beginning looks like a valve that does not open. So the pulses are short, go both
//! ways, and end at [`PULSE_LIMIT`].

pub mod direction;
mod step;
pub mod watch;

use std::time::Duration;

use pipeline::{
    machine::{Axis, samples_of},
    message::AxisSample,
};

use direction::Direction;
use step::Step;
use watch::{Abort, Watch};

use super::{ExperimentOptions, ExperimentRecord, Outcome, Phase};
use crate::protection::limits::Limits;

/// Highest level of the pulses.
pub const PULSE_LIMIT: f64 = 0.6;
/// Rise of the level from pulse to pulse.
const PULSE_STEP: f64 = 0.03;
/// Length of a pulse, s.
const PULSE_TIME: f64 = 0.25;
/// Wait after the pulses: the longest dead time, 0.5 s, and the valve's lag, s.
const PULSE_WAIT: f64 = 0.7;
/// Time at rest in which the noise is seen, s.
const REST_TIME: f64 = 0.5;
/// Motion is clear from here on, m.
const CLEAR: f64 = 1e-3;
/// Opening of the first stroke above the level that moved the axis.
const FIRST_OPENING: f64 = 0.015;
/// How long a stroke goes on once the axis moves, s.
const STROKE_TIME: f64 = 0.4;
/// How long a stroke waits for motion beyond the reaction that is known, s.
const STROKE_PATIENCE: f64 = 1.0;
/// Part of the speed bound that ends the strokes of a direction.
const FAST_ENOUGH: f64 = 0.75;
/// Part of the speed bound that a stroke aims at.
const AIM: f64 = 0.9;
/// Longest reaction that is looked back for, s.
const MEMORY: f64 = 1.5;
/// Time for which the random steps have to last at least, s.
const LEAST_RANDOM: f64 = 8.0;
/// Part of the window, on either side, that the axis may be outside before the experiment ends.
const MARGIN: f64 = 0.05;
/// The least margin, m.
const LEAST_MARGIN: f64 = 5e-3;
/// Part of the soft limits' travel that is used when nobody says.
const DEFAULT_TRAVEL: f64 = 0.4;
/// Part of the axis' greatest speed that is allowed when nobody says.
const DEFAULT_SPEED: f64 = 0.25;

/// The experiment with one axis.
#[derive(Debug, Clone)]
pub struct Experiment {
    period: f64,
    limits: Limits,
    soft_limits: (f64, f64),
    travel: f64,
    /// Speed bound, m/s, and the one that the window allows.
    fastest: f64,
    aim: f64,
    window: (f64, f64),
    margin: f64,
    /// Way from which on motion is clear, and within which the axis stands over a speed's time, m.
    clear: f64,
    quiet: f64,
    watch: Watch,
    /// Extending and retracting.
    directions: [Direction; 2],
    level: f64,
    /// Longest time from neutral to rest, ticks.
    reaction: usize,
    phase: Phase,
    step: Step,
    tick: usize,
    total: usize,
    random: u64,
    record: ExperimentRecord,
    outcome: Option<Outcome>,
}

impl Experiment {
    /// An experiment with an axis that is sampled every `period`. Nothing is allocated after this.
    pub fn new(axis: &Axis, period: Duration, options: &ExperimentOptions) -> Self {
        let seconds = period.as_secs_f64();
        let total = samples_of(options.duration, period);
        let (low, high) = axis.soft_limits;
        let travel = options.travel.unwrap_or(DEFAULT_TRAVEL * (high - low));
        let fastest = options.speed.unwrap_or(DEFAULT_SPEED * axis.max_speed).min(axis.max_speed);
        let resolution = axis.encoder.resolution;
        Self {
            period: seconds,
            limits: Limits::new(&axis.control, seconds),
            soft_limits: axis.soft_limits,
            travel,
            fastest,
            aim: fastest,
            window: (f64::NEG_INFINITY, f64::INFINITY),
            margin: 0.0,
            clear: CLEAR.max(10.0 * resolution),
            quiet: 4.0 * resolution,
            watch: Watch::new(seconds, samples_of(Duration::from_secs_f64(MEMORY), period), 2.0 * resolution),
            directions: [Direction::new(), Direction::new()],
            level: PULSE_STEP,
            reaction: 3,
            phase: Phase::Rest,
            step: Step::begin(f64::NAN, 0.0, 0),
            tick: 0,
            total,
            random: options.seed,
            record: ExperimentRecord {
                period: seconds,
                commands: Vec::with_capacity(total + 1),
                positions: Vec::with_capacity(total + 1),
            },
            outcome: None,
        }
    }

    /// The command for one tick from its sample; none where none came.
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

    /// Ends it from outside; the command is neutral from now on.
    pub fn stop(&mut self) {
        if self.outcome.is_none() {
            self.end(Outcome::Aborted(Abort::Stopped));
        }
    }

    /// How it ended, once it has.
    pub fn outcome(&self) -> Option<Outcome> {
        self.outcome
    }

    /// Where it is.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// How much of its time is over, 0 to 1.
    pub fn progress(&self) -> f64 {
        if self.outcome.is_some() { 1.0 } else { self.tick as f64 / self.total.max(1) as f64 }
    }

    /// Low and high end of the window, and the margin beyond, m; known after the first sample.
    pub fn window(&self) -> ((f64, f64), f64) {
        (self.window, self.margin)
    }

    /// Everything so far.
    pub fn record(&self) -> &ExperimentRecord {
        &self.record
    }

    fn end(&mut self, outcome: Outcome) {
        self.outcome = Some(outcome);
        self.phase = Phase::Over;
    }

    fn ticks(&self, seconds: f64) -> usize {
        ((seconds / self.period).round() as usize).max(1)
    }

    fn act(&mut self, sample: Option<&AxisSample>) -> Result<f64, Abort> {
        let usable = self.watch.take(sample)?;
        self.tick += 1;
        let Some(position) = usable else { return Ok(self.watch.command()) };
        if self.step.from.is_nan() {
            self.place(position)?;
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
        if self.tick + self.reaction + self.ticks(0.3) >= self.total {
            if self.phase != Phase::Random && self.phase != Phase::End {
                return Err(self.too_short());
            }
            self.phase = Phase::End;
            if self.tick >= self.total {
                self.end(Outcome::Finished);
            }
            return Ok(0.0);
        }
        // The rate limit counts from neutral where the direction changes: neutral is allowed at once.
        let last = self.watch.command();
        Ok(if wanted == 0.0 { 0.0 } else { self.limits.apply(wanted, if wanted * last < 0.0 { 0.0 } else { last }) })
    }

    fn too_short(&self) -> Abort {
        Abort::TooShort { duration: self.total as f64 * self.period, needed: LEAST_RANDOM }
    }

    /// Lays the window around where the axis stands.
    fn place(&mut self, position: f64) -> Result<(), Abort> {
        let (low, high) = self.soft_limits;
        self.window = ((position - 0.5 * self.travel).max(low), (position + 0.5 * self.travel).min(high));
        let travel = self.window.1 - self.window.0;
        self.margin = (MARGIN * travel).max(LEAST_MARGIN);
        self.step = Step::begin(position, 0.0, 0);
        if !(low..=high).contains(&position) {
            return Err(Abort::Window { position, window: self.soft_limits, margin: 0.0 });
        }
        self.expect_travel()
    }

    /// That the window lets the axis move at a speed that can be seen and stopped, and which that is.
    fn expect_travel(&mut self) -> Result<(), Abort> {
        let travel = self.window.1 - self.window.0;
        let time = self.reaction as f64 * self.period + STROKE_TIME;
        let needed = 50.0 * self.clear * time;
        if travel < needed {
            return Err(Abort::TooSmall { travel, needed });
        }
        self.aim = self.fastest.min(0.5 * travel / time);
        Ok(())
    }

    fn check(&mut self) -> Result<(), Abort> {
        self.watch.check_bounds(self.window, self.margin, self.fastest)?;
        let found = !self.directions.iter().any(|direction| direction.last().is_none());
        let memory = if found { self.reaction + self.ticks(0.3) } else { self.ticks(1.0) };
        self.watch.check_direction(memory, self.fastest)?;
        let directions = &self.directions;
        self.watch.check_change(self.reaction, |command| {
            let direction = &directions[usize::from(command < 0.0)];
            if command.abs() > direction.moving { direction.speed(command.abs()) } else { 0.0 }
        })
    }

    /// Notes what the axis does in this step.
    fn observe(&mut self, position: f64) {
        let quiet = self.watch.speed().abs() * watch::SPEED_TIME <= self.quiet;
        let speed = self.watch.speed();
        let step = &mut self.step;
        step.ticks += 1;
        step.lowest = step.lowest.min(position);
        step.highest = step.highest.max(position);
        step.fall = step.fall.max(step.highest - position);
        step.peak = step.peak.max(speed * step.wanted.signum());
        if step.moved_at.is_none() && (position - step.from).abs() > self.clear {
            step.moved_at = Some(step.ticks);
        }
        if !quiet {
            step.last_motion = step.ticks;
        }
        let (low, high) = self.watch.span(self.reaction);
        self.directions[usize::from(speed < 0.0)].learn(if speed < 0.0 { -low } else { high }, speed.abs());
    }

    /// Whether the step has gone neutral and the axis has stood since long enough.
    fn stands(&self, wait: usize) -> bool {
        let step = &self.step;
        step.neutral_at.is_some_and(|neutral| step.ticks >= neutral + wait)
            && step.ticks >= step.last_motion + self.ticks(0.1)
    }

    fn learn_reaction(&mut self) {
        let longest = self.ticks(MEMORY) - self.ticks(0.3);
        let seen = self.step.last_motion.saturating_sub(self.step.neutral_at.unwrap_or(usize::MAX));
        self.reaction = self.reaction.max(seen).min(longest);
    }

    fn rest(&mut self, position: f64) -> Result<f64, Abort> {
        if self.step.ticks >= self.ticks(REST_TIME) {
            let noise = self.step.highest - self.step.lowest;
            self.clear = self.clear.max(5.0 * noise);
            self.quiet = self.quiet.max(2.0 * noise);
            self.watch.set_band(noise);
            self.expect_travel()?;
            (self.phase, self.step) = (Phase::Pulses, Step::begin(position, 0.0, 0));
        }
        Ok(0.0)
    }

    fn pulses(&mut self, position: f64) -> Result<f64, Abort> {
        let length = self.ticks(PULSE_TIME);
        let searched = [0, 1].map(|side| self.directions[side].moving.is_infinite());
        let up = if searched[0] { length } else { 0 };
        let end = up + if searched[1] { length } else { 0 };
        let at = self.step.ticks - 1;
        if at < end {
            return Ok(if at < up { self.level } else { -self.level });
        }
        self.step.neutral_at.get_or_insert(at);
        if !self.stands(self.ticks(PULSE_WAIT)) {
            return Ok(0.0);
        }
        let rise = self.step.highest - self.step.from;
        // What swings back is not a motion of its own.
        let moved = [rise > self.clear, self.step.fall > self.clear.max(0.4 * rise)];
        for side in 0..2 {
            if searched[side] && moved[side] {
                self.directions[side].moving = self.level;
            }
        }
        if moved[usize::from(searched[1])] {
            self.learn_reaction();
        }
        let highest = PULSE_LIMIT.min(self.limits.magnitude);
        if let Some(side) = self.directions.iter().position(|direction| direction.moving.is_infinite()) {
            if self.level >= highest {
                return Err(Abort::NoMotion { extend: side == 0, level: highest });
            }
            self.level = (self.level + PULSE_STEP).min(highest);
            self.step = Step::begin(position, 0.0, 0);
        } else {
            self.expect_travel()?;
            self.phase = Phase::Strokes;
            self.begin_stroke(position);
        }
        Ok(0.0)
    }

    fn is_fast_enough(&self, side: usize) -> bool {
        let direction = &self.directions[side];
        direction.is_full()
            || direction
                .last()
                .is_some_and(|(level, speed)| speed >= FAST_ENOUGH * self.aim || level >= self.limits.magnitude)
    }

    fn begin_stroke(&mut self, position: f64) {
        let side = usize::from(position > 0.5 * (self.window.0 + self.window.1));
        let direction = &self.directions[side];
        let level = match direction.last() {
            None => direction.moving + FIRST_OPENING,
            Some((level, _)) if self.is_fast_enough(side) => level,
            Some((level, speed)) => {
                let factor = (AIM * self.aim / speed.max(1e-6)).sqrt().clamp(1.0, 2.0);
                direction.moving + (level - direction.moving) * factor
            }
        };
        let level = level.min(self.limits.magnitude);
        self.step = Step::begin(position, if side == 0 { level } else { -level }, 0);
    }

    fn stroke(&mut self, position: f64) -> Result<f64, Abort> {
        let Step { ticks, wanted, neutral_at, moved_at, .. } = self.step;
        if neutral_at.is_none() {
            let over = moved_at.is_some_and(|moved| ticks >= moved + self.ticks(STROKE_TIME))
                || ticks >= self.reaction + self.ticks(STROKE_PATIENCE)
                || self.would_leave(position, wanted);
            if !over {
                return Ok(wanted);
            }
            self.step.neutral_at = Some(ticks);
        }
        if !self.stands(self.reaction + self.ticks(0.2)) {
            return Ok(0.0);
        }
        let (side, level) = (usize::from(wanted < 0.0), wanted.abs());
        if moved_at.is_none() {
            return Err(Abort::NoMotion { extend: side == 0, level });
        }
        self.learn_reaction();
        self.expect_travel()?;
        self.directions[side].push(level, self.step.peak);
        if self.is_fast_enough(0) && self.is_fast_enough(1) {
            if self.tick + self.ticks(LEAST_RANDOM) > self.total {
                return Err(self.too_short());
            }
            self.phase = Phase::Random;
            self.step = Step::begin(position, 0.0, 0);
        } else {
            self.begin_stroke(position);
        }
        Ok(0.0)
    }

    fn random_steps(&mut self, position: f64) -> f64 {
        if self.step.ticks > self.step.length {
            let (low, high) = self.window;
            let up = self.uniform() < (high - position) / (high - low);
            self.choose(position, if up { 0 } else { 1 });
        }
        if self.would_leave(position, self.step.wanted) {
            let other = usize::from(self.step.wanted > 0.0);
            self.choose(position, other);
            if self.would_leave(position, self.step.wanted) {
                self.step = Step::begin(position, 0.0, self.ticks(0.1));
            }
            return 0.0;
        }
        self.step.wanted
    }

    /// A random step of one direction, or neutral.
    fn choose(&mut self, position: f64, side: usize) {
        let direction = &self.directions[side];
        let (low, high) = (0.7 * direction.moving, direction.last().map_or(direction.moving, |(level, _)| level));
        let level = if self.uniform() < 0.1 { 0.0 } else { low + (high - low) * self.uniform() };
        let time = 0.1 + 0.7 * self.uniform();
        let length = self.ticks(time);
        self.step = Step::begin(position, if side == 0 { level } else { -level }, length);
    }

    /// Whether the axis would leave the window, were it commanded so once more and then neutral.
    fn would_leave(&self, position: f64, wanted: f64) -> bool {
        if wanted == 0.0 {
            return false;
        }
        let sign = wanted.signum();
        let direction = &self.directions[usize::from(wanted < 0.0)];
        let under_way = self.watch.commands(self.reaction).iter().chain([&wanted]);
        let way: f64 = under_way.map(|command| direction.speed((command * sign).max(0.0)) * self.period).sum();
        if sign > 0.0 { position + way > self.window.1 } else { position - way < self.window.0 }
    }

    /// SplitMix64 (Steele, Lea, Flood 2014), as a number in [0, 1).
    fn uniform(&mut self) -> f64 {
        self.random = self.random.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.random;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}
