//! One axis: what it may do when, and who makes its command.
//!
//! ```text
//! disarmed --arm--> settling --0.2 s of healthy samples--> following --fault--> latched
//!     ^----------------------- disarm -----------------------'------------------'
//!
//! while following, by its mode (see [`crate::operation`]):
//!   manual, commission: the command that is asked for, within all limits
//!   hold, track: fallback --model judged good for 0.1 s--> model --stale, absent, refused--> fallback
//! ```
//!
//! Only an axis that follows is ever commanded anything but neutral. A sample or two without a usable position are
//! bridged: the last command stays. Three in a row, a position outside the stroke, or an encoder that stands still
//! while the axis is driven, latch the axis at neutral until a person disarms and arms again. Trap: a latch that
//! heals by itself moves the machine while somebody looks at why it stopped.
//!
//! From a command by hand to a controller: the targets begin where the axis is and as fast as it is, the fallback at the
//! command that was.

mod modes;

use std::time::Duration;

use pipeline::{
    machine::{Axis, Forgetting, ModelChoice, Timing, samples_of},
    message::{
        AxisCommand, AxisMode, AxisSample, AxisSnapshot, ControlMode, Reference, Request, control_flag, sample_fault,
    },
    statistics::ErrorStatistics,
};

use crate::{
    end_stops::EndStops,
    fallback::Fallback,
    history::History,
    judge::{Approved, Judge},
    limits::Limits,
    operation::Requests,
    predictive::Predictive,
    recent::Recent,
    reference::ReferenceGenerator,
    rest::Rest,
    target::Target,
    trust::Trust,
};

/// Healthy samples before anything moves: long enough to see an encoder that comes and goes.
pub const SETTLING: Duration = Duration::from_millis(200);
/// A model must be judged good for this long before it controls: no switching to and fro with a borderline one.
pub const PROBATION: Duration = Duration::from_millis(100);
/// Samples in a row without a usable position that latch the axis.
pub const UNUSABLE_LIMIT: u64 = 3;
/// How far a command must be beyond the calibrated dead band for a position that stands still to be a fault: the
/// calibration is a little low on purpose, and just above the band the axis may creep below the encoder's resolution.
pub const STUCK_MARGIN: f64 = 0.05;
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
    Latched,
}

/// The controller of one axis.
#[derive(Debug, Clone)]
pub struct AxisController {
    period: f64,
    limits: Limits,
    end_stops: EndStops,
    settling_ticks: u64,
    probation_ticks: u64,
    feedback_ticks: u64,
    model_ticks: u64,
    stuck_ticks: u64,
    /// Commands below which the axis need not move, retracting and extending.
    resting_range: (f64, f64),
    choice: ModelChoice,
    /// The adaptive model is used whether it predicts better than the held one or not.
    at_once: bool,
    judge: Judge,
    recent: Recent,
    predictive: Predictive,

    requests: Requests,
    /// What it is operated in while it is not off.
    mode: AxisMode,
    /// Where to hold once it does, m.
    goal: Option<f64>,
    /// Requests stopped, and it is off since.
    stopped: bool,
    state: State,
    fallback: Fallback,
    rest: Rest,
    trust: Trust,
    target: Target,
    /// `None` until the first usable position.
    history: Option<History>,
    /// Ticks since the last usable position, and how many of them the model has filled.
    blind: u64,
    bridged: u64,
    /// Ticks that the command has been beyond `resting_range` in one direction.
    driven: u64,
    /// Ticks in a row that the model was judged good.
    trusted: u64,
    /// Tick of the last snapshot that was taken in.
    seen: Option<u64>,
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
        // The fallback compensates a little less than the valve's dead band, or none of it.
        let found = axis.commissioned.as_ref().map_or(control.dead_band, |commissioned| commissioned.dead_band);
        let (extend, retract) =
            (control.dead_band.extend.max(found.extend), control.dead_band.retract.max(found.retract));
        Self {
            period,
            limits: Limits::new(control, period),
            end_stops: EndStops::new(axis),
            requests: Requests::new(index, axis, timing),
            mode: AxisMode::Track,
            goal: None,
            stopped: false,
            settling_ticks: ticks(SETTLING),
            probation_ticks: ticks(PROBATION),
            feedback_ticks: ticks(timing.feedback_timeout),
            model_ticks: ticks(timing.model_timeout),
            // The motion cannot show before the dead time.
            stuck_ticks: ticks(axis.encoder.stuck_after) + structure.nk as u64,
            resting_range: (-retract - STUCK_MARGIN, extend + STUCK_MARGIN),
            choice: control.model,
            // A grey box knows what commissioning has found, which is more than what the training has shown.
            at_once: control.model == ModelChoice::Classical || axis.identification.forgetting == Forgetting::GreyBox,
            judge: Judge::new(axis, period),
            recent: Recent::new(period),
            predictive: Predictive::new(control, axis.soft_limits, period),
            state: State::Disarmed,
            rest: Rest::new(axis.encoder.resolution, period),
            trust: Trust::new(period),
            target: Target::new(index, axis, period, ahead.max(fallback.ahead())),
            fallback,
            history: None,
            blind: 0,
            bridged: 0,
            driven: 0,
            trusted: 0,
            seen: None,
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

    /// Neutral from the next command on; releases the latch and forgets the past.
    pub fn disarm(&mut self) {
        self.stand_still(State::Disarmed);
        self.stopped = false;
        self.last.flags = control_flag::DISARMED;
        self.history = None;
        (self.blind, self.bridged) = (0, 0);
    }

    /// Latches the axis at neutral.
    pub fn latch(&mut self) {
        self.stand_still(State::Latched);
        self.last.flags = control_flag::FEEDBACK;
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
        self.take_request(input);
        let usable = self.take_feedback(input);
        let (model, model_flags) = self.take_snapshot(input.snapshot);
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
        self.driven = if self.rests() { 0 } else { self.driven.saturating_add(input.elapsed) };
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

        let out_of_range = faults & sample_fault::RANGE != 0;
        match self.state {
            State::Settling(_) if out_of_range => self.latch(),
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
                let stuck = faults & sample_fault::STUCK != 0 && self.driven >= self.stuck_ticks;
                if out_of_range || lost || stuck {
                    self.latch();
                }
            }
            State::Disarmed | State::Latched => {}
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

    /// Whether the last command need not move the axis.
    fn rests(&self) -> bool {
        (self.resting_range.0..=self.resting_range.1).contains(&self.last.command)
    }

    /// The model, if it may be used, and the flags that say why not.
    fn take_snapshot<'a>(&mut self, snapshot: Option<(u64, &'a AxisSnapshot)>) -> (Option<Approved<'a>>, u32) {
        if self.choice == ModelChoice::None {
            return (None, 0);
        }
        let Some((made_after, snapshot)) = snapshot else {
            return (None, control_flag::NO_MODEL);
        };
        // The same snapshot comes again until there is a newer one; its errors and its defects count once.
        let is_new = self.seen.replace(made_after) != Some(made_after);
        if is_new {
            self.recent.update(&snapshot.separated_h_step, &snapshot.classical_errors.h_step);
        }
        // What was identified offline and held is used until the adaptive model has shown that it is better.
        let held = |judge: &Judge| judge.judge_held(snapshot).ok();
        match self.judge.judge(snapshot) {
            Ok(model) if self.at_once || self.recent.is_better() => (Some(model), 0),
            Ok(model) => (held(&self.judge).or(Some(model)), 0),
            Err(None) => (None, control_flag::NO_MODEL),
            Err(Some(refusal)) => {
                if is_new {
                    self.last.rejected_snapshots[refusal as usize] += 1;
                }
                (held(&self.judge), control_flag::MODEL_REFUSED)
            }
        }
    }

    /// Begins to follow from where the axis stands.
    fn begin(&mut self, input: &AxisInput<'_>, position: f64) {
        self.state = State::Following;
        self.trusted = 0;
        self.fallback.reset();
        self.rest.reset();
        self.trust.reset();
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
        let stale =
            input.snapshot.is_some_and(|(made_after, _)| input.sequence.abs_diff(made_after) > self.model_ticks);
        if stale {
            flags |= control_flag::MODEL_STALE;
        }

        let model = model.filter(|_| !stale);
        self.trusted = if model.is_some() { self.trusted.saturating_add(1) } else { 0 };
        let mut wanted = None;
        if let (Some(model), Some(history)) = (model, history) {
            // Also on probation, so that it has an estimate of the noise when it takes over.
            wanted = predictive.update(&model, limits, history, target.positions());
            self.last.unsolved_plans = predictive.unsolved();
            if wanted.is_none() {
                flags |= control_flag::MODEL_REFUSED;
                self.trusted = 0;
            }
        } else {
            predictive.reset();
        }
        let reference = target.positions()[0];
        let error = reference - position;
        let was_model = self.last.mode == ControlMode::Model as u32;
        let was_by_hand = [ControlMode::Manual as u32, ControlMode::Commission as u32].contains(&self.last.mode);
        let at_limit = self.last.command.abs() >= AT_LIMIT * self.limits.magnitude;
        if !self.trust.update(reference, error, was_model, at_limit) {
            flags |= control_flag::MODEL_REFUSED;
            self.trusted = 0;
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

    /// Makes the command of an axis that does not follow.
    fn stand(&mut self, state: State, model_flags: u32) {
        self.stand_still(state);
        self.last.flags = model_flags
            | match state {
                State::Disarmed if self.stopped => control_flag::DISARMED | control_flag::REQUEST_STOPPED,
                State::Disarmed => control_flag::DISARMED,
                State::Settling(_) => control_flag::SETTLING,
                State::Latched | State::Following => control_flag::FEEDBACK,
            };
    }

    /// Neutral, with the target where the axis is.
    fn stand_still(&mut self, state: State) {
        self.state = state;
        self.trusted = 0;
        if !matches!(state, State::Settling(_)) {
            self.last.operation = AxisMode::Off as u32;
        }
        self.send(0.0, ControlMode::Neutral);
        if let Some(history) = &self.history {
            self.last.reference = history.outputs()[0];
        }
        self.last.error = 0.0;
    }

    fn send(&mut self, command: f64, mode: ControlMode) {
        if command * self.last.command <= 0.0 {
            // Neutral or the other direction: not yet driven that way.
            self.driven = 0;
        }
        self.last.command = command;
        self.last.mode = mode as u32;
    }
}
