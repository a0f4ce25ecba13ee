//! One axis: what it may do when, and who makes its command.
//!
//! ```text
//! disarmed --arm--> settling --0.2 s of healthy samples--> following --fault--> latched
//!     ^----------------------- disarm -----------------------'------------------'
//!
//! while following, by its mode (see [`requests`]):
//!   manual, commission: the command that is asked for, within all limits
//!   hold, track: fallback --model judged good for 0.1 s--> model --too old, absent, distrusted--> fallback
//! ```
//!
//! Only an axis that follows is ever commanded anything but neutral. A sample or two without a usable position are
//! bridged: the last command stays. What latches the axis at neutral until a person disarms and arms again:
//!
//! | flag | after |
//! |---|---|
//! | `FEEDBACK` | three samples in a row without a usable position, one outside the stroke, an encoder that stands still while the axis is driven |
//! | `STALL` | no motion of an axis that is driven ([`crate::protection::motion`]), in hold and track |
//! | `FOLLOWING` | a following error ([`crate::protection::following_error`]) |
//! | `SOLVER` | [`UNSOLVED_LIMIT`] plans in a row without an answer of the solver |
//! | `DEADLINE` | late commands ([`crate::process`]) |
//! | `EMERGENCY_STOP` | the emergency stop, whatever the axis does, off too; not to be reset while it is pressed |
//!
//! The first of them stays what it is; an emergency stop comes on top. Trap: a latch that heals by itself moves the
//! machine while somebody looks at why it stopped.
//!
//! A refused snapshot is not used once; the last approved one is, until it is too old ([`crate::model::age`]). Then the axis goes
//! on by the fallback, at half of its speed.
//!
//! From a command by hand to a controller: the targets begin where the axis is and as fast as it is, the fallback at the
//! command that was.

mod latch;
mod modes;
pub mod requests;

use std::time::Duration;

use pipeline::{
    machine::{Axis, Control, Estimator, ModelChoice, Timing, samples_of},
    message::{
        AxisCommand, AxisMode, AxisSample, AxisSnapshot, ControlMode, Reference, Request, control_flag, sample_fault,
    },
    statistics::ErrorStatistics,
};

use requests::Requests;

use crate::{
    fallback::{Fallback, rest::Rest},
    model::{
        age::{Age, Kept},
        comparison::Comparison,
        judge::{Approved, Judge, Refusal},
        trust::Trust,
    },
    predictive::{Predictive, history::History},
    protection::{
        end_stops::EndStops,
        following_error::FollowingError,
        limits::Limits,
        motion::{Motion, Standing},
    },
    target::{Target, generator::ReferenceGenerator},
};

/// Healthy samples before anything moves: long enough to see an encoder that comes and goes.
pub const SETTLING: Duration = Duration::from_millis(200);
/// A model must be judged good for this long before it controls: no switching to and fro with a borderline one.
pub const PROBATION: Duration = Duration::from_millis(100);
/// Samples in a row without a usable position that latch the axis.
pub const UNUSABLE_LIMIT: u64 = 3;
/// Plans in a row without an answer of the solver that latch the axis.
pub const UNSOLVED_LIMIT: u64 = 5;
/// A command beyond this part of its limit is all that can be done.
const AT_LIMIT: f64 = 0.99;

/// What one axis gets for one tick.
#[derive(Debug, Clone, Copy)]
pub struct AxisInput<'a> {
    /// Tick of the sample.
    pub sequence: u64,
    /// Ticks since the last sample, 1 when none is missing.
    pub elapsed: u64,
    /// The axis' sample, if the message holds it.
    pub sample: Option<&'a AxisSample>,
    /// The axis' newest snapshot, if there is one, and the tick it was made after.
    pub snapshot: Option<(u64, &'a AxisSnapshot)>,
    /// The newest reference message, if there is one.
    pub reference: Option<&'a Reference>,
    /// The emergency stop is pressed.
    pub emergency_stop: bool,
    /// The newest request, if there is one.
    pub request: Option<&'a Request>,
    /// The generators of all axes.
    pub generator: &'a ReferenceGenerator,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Disarmed,
    /// Healthy samples so far.
    Settling(u64),
    Following,
    /// The [`control_flag`] bits that say why.
    Latched(u32),
}

/// The controller of one axis.
#[derive(Debug, Clone)]
pub struct AxisController {
    period: f64,
    limits: Limits,
    /// Largest magnitude of a command for half of the speed.
    half_speed: f64,
    end_stops: EndStops,
    settling_ticks: u64,
    probation_ticks: u64,
    feedback_ticks: u64,
    choice: ModelChoice,
    /// The adaptive model is used whether it predicts better than the held one or not.
    at_once: bool,
    judge: Judge,
    comparison: Comparison,
    kept: Kept,
    predictive: Predictive,

    requests: Requests,
    /// What it is operated in while it is not off.
    mode: AxisMode,
    /// Where to hold once it does, m.
    goal: Option<f64>,
    /// Requests stopped, and it is off since.
    stopped: bool,
    /// The emergency stop was pressed when it was last seen.
    is_pressed: bool,
    state: State,
    fallback: Fallback,
    rest: Rest,
    trust: Trust,
    following: FollowingError,
    motion: Motion,
    target: Target,
    /// `None` until the first usable position.
    history: Option<History>,
    /// Ticks since the last usable position, and how many of them the model has filled.
    blind: u64,
    bridged: u64,
    /// Ticks in a row that the model was judged good.
    trusted: u64,
    /// Tick of the last snapshot that was taken in, and what was said of it.
    seen: Option<u64>,
    said: u32,
    /// What was sent for the last tick.
    last: AxisCommand,
}

impl AxisController {
    /// Disarmed. `index` is the axis' number in the messages.
    pub fn new(index: usize, axis: &Axis, timing: &Timing) -> Self {
        let ticks = |duration| samples_of(duration, timing.period).max(1) as u64;
        let period = timing.period.as_secs_f64();
        let control = &axis.control;
        let structure = axis.identification.structure;
        let fallback = Fallback::new(control, axis.commissioned.as_ref(), period);
        let ahead = if control.model == ModelChoice::None { 0 } else { structure.nk + 2 * control.horizon };
        Self {
            period,
            limits: Limits::new(control, period),
            half_speed: half_speed(axis),
            end_stops: EndStops::new(axis),
            requests: Requests::new(index, axis, timing),
            mode: AxisMode::Track,
            goal: None,
            stopped: false,
            is_pressed: false,
            settling_ticks: ticks(SETTLING),
            probation_ticks: ticks(PROBATION),
            feedback_ticks: ticks(timing.feedback_timeout),
            choice: control.model,
            // A grey box knows what commissioning has found, which is more than what the training has shown.
            at_once: control.model == ModelChoice::Classical || axis.identification.estimator == Estimator::GreyBox,
            judge: Judge::new(axis, period),
            comparison: Comparison::new(period),
            kept: Kept::new(ticks(timing.model_timeout), ticks(timing.model_lifetime)),
            predictive: Predictive::new(control, axis.soft_limits, period),
            state: State::Disarmed,
            rest: Rest::new(axis.encoder.resolution, period),
            trust: Trust::new(control.following_error, period),
            following: FollowingError::new(control.following_error, period),
            motion: Motion::new(axis, timing),
            target: Target::new(index, axis, period, ahead.max(fallback.ahead())),
            fallback,
            history: None,
            blind: 0,
            bridged: 0,
            trusted: 0,
            seen: None,
            said: 0,
            last: AxisCommand {
                flags: control_flag::DISARMED,
                operation: AxisMode::Off as u32,
                ..AxisCommand::default()
            },
        }
    }

    /// Lets a disarmed axis settle and then track its reference. A latched one stays latched.
    pub fn arm(&mut self) {
        self.enable(AxisMode::Track, None);
    }

    /// The same in any mode.
    fn enable(&mut self, mode: AxisMode, goal: Option<f64>) {
        if self.state == State::Disarmed {
            self.state = State::Settling(0);
            (self.mode, self.goal, self.stopped) = (mode, goal, false);
            self.last.operation = mode as u32;
            self.last.tracking = ErrorStatistics::default();
            self.last.model_tracking = ErrorStatistics::default();
            self.last.flags = control_flag::SETTLING;
        }
    }

    /// What was last sent, or what stands in its place since.
    pub fn last(&self) -> AxisCommand {
        self.last
    }

    /// The command for one sample.
    pub fn update(&mut self, input: &AxisInput<'_>) -> AxisCommand {
        if let Some(history) = &mut self.history {
            history.hold_command(input.elapsed.saturating_sub(1));
        }
        self.take_emergency_stop(input.emergency_stop);
        self.take_request(input);
        let usable = self.take_feedback(input);
        let model_flags = self.take_snapshot(input);
        // A copy, so that the axis may change while it is in use.
        let kept = self.kept;
        let model = kept.approved(input.sequence);
        match (self.state, usable) {
            (State::Following, Some(position)) if self.mode.is_by_hand() => self.drive(input.sequence, position),
            (State::Following, Some(position)) => self.follow(input, position, model, model_flags),
            // The last command stays until the position is back or given up.
            (State::Following, None) => self.bridge(model),
            (state, _) => self.stand(state, model_flags),
        }
        (self.last.taken_requests, self.last.refused_requests) = self.requests.counts();
        if self.requests.is_refused() {
            self.last.flags |= control_flag::REQUEST;
        } else {
            // A command that is bridged keeps its flags.
            self.last.flags &= !control_flag::REQUEST;
        }
        if let Some(history) = &mut self.history {
            history.push_command(self.last.command);
        }
        self.last
    }

    /// Takes in the position, if it is usable, and moves from state to state.
    fn take_feedback(&mut self, input: &AxisInput<'_>) -> Option<f64> {
        self.blind = self.blind.saturating_add(input.elapsed);
        let faults = input.sample.map_or(sample_fault::STALE, |sample| sample.faults);
        let position = input.sample.and_then(AxisSample::usable);
        let missing = self.blind.saturating_sub(1);
        if let Some(position) = position {
            match &mut self.history {
                None => self.history = Some(History::resting(position)),
                Some(history) => history.push_output(position, missing.saturating_sub(self.bridged)),
            }
            (self.blind, self.bridged) = (0, 0);
        }
        let standing = self.motion.update(input.elapsed, self.last.command, position);

        let out_of_range = faults & sample_fault::RANGE != 0;
        match self.state {
            State::Settling(_) if out_of_range => self.latch(control_flag::FEEDBACK),
            State::Settling(healthy) => match position {
                Some(position) if missing == 0 && healthy >= self.settling_ticks => self.begin(input, position),
                Some(_) if missing == 0 || healthy == 0 => self.state = State::Settling(healthy + 1),
                _ => self.state = State::Settling(0),
            },
            State::Following => {
                let lost = match position {
                    Some(_) => missing >= self.feedback_ticks,
                    None => self.blind >= UNUSABLE_LIMIT,
                };
                if out_of_range || lost || standing == Some(Standing::Stuck) {
                    self.latch(control_flag::FEEDBACK);
                } else if standing.is_some() && !self.mode.is_by_hand() {
                    // A person sees it, and a commissioning has to find out from where on it moves.
                    self.latch(control_flag::STALL);
                }
            }
            State::Disarmed | State::Latched(_) => {}
        }
        position
    }

    /// Puts what the model expects in the place of the position that has not come.
    fn bridge(&mut self, model: Option<Approved<'_>>) {
        let (Some(model), Some(history)) = (model, &mut self.history) else { return };
        if let Some(expected) = self.predictive.bridge(&model, history) {
            history.push_output(expected, self.blind.saturating_sub(self.bridged + 1));
            self.bridged = self.blind;
        }
    }

    /// Takes in the newest snapshot, once; the flags that say what is wrong with it.
    fn take_snapshot(&mut self, input: &AxisInput<'_>) -> u32 {
        if self.choice == ModelChoice::None {
            return 0;
        }
        let Some((made_after, snapshot)) = input.snapshot else {
            return control_flag::NO_MODEL;
        };
        if self.seen.replace(made_after) == Some(made_after) {
            return self.said;
        }
        self.comparison.update(&snapshot.separated_h_step, &snapshot.classical_errors.h_step);
        let held = || self.judge.judge_held(snapshot).ok();
        let (model, flags) = match self.judge.judge(snapshot) {
            Ok(model) if self.at_once || self.comparison.is_better() => (Some(model), 0),
            // What was identified offline and held is used until the adaptive model has shown that it is better.
            Ok(model) => (held().or(Some(model)), 0),
            Err(None) => (None, control_flag::NO_MODEL),
            Err(Some(refusal)) => {
                self.last.rejected_snapshots[refusal as usize] += 1;
                // One that predicts worse has been on its way there for long: the one before it is no better.
                let old_one_stays = refusal != Refusal::Worse && self.kept.age(input.sequence) == Age::Fresh;
                (if old_one_stays { None } else { held() }, control_flag::MODEL_REFUSED)
            }
        };
        if let Some(model) = model {
            self.kept.keep(&model, made_after);
        }
        self.said = flags;
        flags
    }

    /// Begins to follow from where the axis stands.
    fn begin(&mut self, input: &AxisInput<'_>, position: f64) {
        self.state = State::Following;
        self.trusted = 0;
        self.fallback.reset();
        self.rest.reset();
        self.trust.reset();
        self.following.reset();
        self.target.begin(input.sequence, position, input.generator);
        if self.mode == AxisMode::Hold {
            self.target.hold(None);
            self.goal.into_iter().for_each(|goal| self.target.aim(goal));
        }
    }

    /// Makes the command of an axis that follows, from its position in m.
    fn follow(&mut self, input: &AxisInput<'_>, position: f64, model: Option<Approved<'_>>, model_flags: u32) {
        let speed = self.speed();
        let Self { target, history, predictive, limits, .. } = self;
        let following = target.update(input.sequence, input.elapsed, position, input.generator, input.reference);
        let mut flags = model_flags;
        if following.refused {
            flags |= control_flag::REFERENCE;
        }
        let reference = target.positions()[0];
        let error = reference - position;
        let age = self.kept.age(input.sequence);
        if matches!(age, Age::Stale | Age::Over) {
            flags |= control_flag::MODEL_STALE;
        }
        let is_slow = age == Age::Over;
        let limits = if is_slow {
            flags |= control_flag::HALF_SPEED;
            // Not all at once.
            let magnitude = self.half_speed.max(self.last.command.abs() - limits.step);
            Limits { magnitude: magnitude.min(limits.magnitude), ..*limits }
        } else {
            *limits
        };
        let at_limit = self.last.command.abs() >= AT_LIMIT * limits.magnitude;
        // An axis that has been slowed down cannot always follow, and is to go on.
        if self.following.update(input.elapsed, if is_slow && at_limit { 0.0 } else { error }, target.speed()) {
            self.latch(control_flag::FOLLOWING);
            return;
        }

        self.trusted = if model.is_some() { self.trusted.saturating_add(1) } else { 0 };
        let mut wanted = None;
        if let (Some(model), Some(history)) = (model, history) {
            // Also on probation, so that it has an estimate of the noise when it takes over.
            wanted = predictive.update(&model, &limits, history, target.positions());
            self.last.unsolved_plans = predictive.unsolved();
            if predictive.unsolved_in_a_row() >= UNSOLVED_LIMIT {
                self.latch(control_flag::SOLVER);
                return;
            }
            if wanted.is_none() {
                flags |= control_flag::MODEL_REFUSED;
                self.trusted = 0;
            }
        } else {
            predictive.reset();
        }
        let was_model = self.last.mode == ControlMode::Model as u32;
        let was_by_hand = [ControlMode::Manual as u32, ControlMode::Commission as u32].contains(&self.last.mode);
        if !self.trust.update(reference, error, was_model, at_limit) {
            flags |= control_flag::MODEL_REFUSED;
            self.trusted = 0;
            self.kept.discard();
        }
        let wanted = wanted.filter(|_| self.trusted > self.probation_ticks);
        let rests = self.rest.update(error, target.positions());
        let (command, mode) = match wanted {
            _ if rests => (0.0, if wanted.is_some() { ControlMode::Model } else { ControlMode::Fallback }),
            Some(wanted) => (wanted, ControlMode::Model),
            None => {
                if was_model || was_by_hand {
                    self.fallback.resume(self.last.command, error, target.positions());
                }
                self.fallback.limit(limits.magnitude);
                (self.fallback.update(error, target.positions(), self.last.command), ControlMode::Fallback)
            }
        };
        let stoppable = self.end_stops.apply(command, position, speed, true);
        if stoppable != command {
            flags |= control_flag::SOFT_LIMIT;
        }
        self.send(stoppable, mode);
        (self.last.reference, self.last.error, self.last.flags) = (reference, error, flags);
        if following.counts {
            self.last.tracking.push(error);
            if mode == ControlMode::Model {
                self.last.model_tracking.push(error);
            }
        }
    }

    fn send(&mut self, command: f64, mode: ControlMode) {
        self.last.command = command;
        self.last.mode = mode as u32;
    }
}

/// The magnitude of a command that makes at most half of the axis' speed: half of the way from the dead band to the limit,
/// or less where the commissioned curve bends.
fn half_speed(axis: &Axis) -> f64 {
    let Control { command_limit, dead_band, .. } = axis.control;
    let found = axis.commissioned.as_ref().map_or(dead_band, |model| model.dead_band);
    let closed = dead_band.extend.min(dead_band.retract).min(found.extend).min(found.retract);
    let half = closed + 0.5 * (command_limit - closed).max(0.0);
    axis.commissioned.as_ref().map_or(half, |model| {
        let by_curve = |limit: f64| model.command(0.5 * model.speed(limit)).abs();
        half.min(by_curve(command_limit)).min(by_curve(-command_limit))
    })
}
