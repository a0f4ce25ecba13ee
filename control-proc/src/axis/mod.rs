//! One axis: when it may move, and who makes its command.
//!
//! ```text
//! disarmed --arm--> settling --0.2 s of healthy samples--> following --fault--> latched
//!     ^----------------------- disarm -----------------------'------------------'
//!
//! while following, by its mode (see [`operation`]):
//!   manual, commission: the command of the request, within all limits
//!   hold, track: fallback --model usable for 0.1 s--> by model --expired, absent, distrusted, worse--> fallback
//! ```
//!
//! | module | step of a tick | what it holds |
//! |---|---|---|
//! | `state`, `modes` | emergency stop, request | states of the axis, changes of its mode |
//! | [`requests`], [`operation`] | request | requests are accepted or refused; mode and set point |
//! | `feedback` | feedback | history of positions and commands, missing samples, motion |
//! | [`crate::model::gate`] | model gate | a snapshot goes in, the approved model or none comes out |
//! | `state` | state machine | settling, following, latched |
//! | `closed_loop`, `decision`, `law` | decision | who commands at this tick, and why |
//! | `command` | assembly | the [`AxisCommand`] message |
//!
//! Only an axis that follows is commanded anything but neutral. Up to two samples in a row without a usable position
//! are bridged: the last command stays. A fault latches an armed axis at neutral until somebody disarms and arms it
//! again:
//!
//! | flag | after |
//! |---|---|
//! | `FEEDBACK` | three samples without usable position, one outside the stroke, a stuck encoder, no end of settling |
//! | `STALL` | no motion of a driven axis in hold and track ([`crate::protection::motion`]) |
//! | `FOLLOWING` | a following error ([`crate::protection::following_error`]) |
//! | `SWING` | a swing that the lowest gains do not end ([`crate::protection::hunting`]) |
//! | `SOLVER` | [`UNSOLVED_LIMIT`] plans in a row without an answer of the solver |
//! | `DEADLINE` | late commands ([`crate::process`]) |
//! | `MOTION` | motion that nobody commanded, in every state ([`crate::protection::uncommanded`]) |
//! | `EMERGENCY_STOP` | the emergency stop, in every state; not to be reset while it is pressed |
//!
//! The first cause stays; an emergency stop and motion that nobody commanded are added to it. Both ask for the
//! pilot pressure to be cut off until the axis is reset. Trap: a latch that releases itself moves the machine while
//! somebody looks for the reason why it stopped.
//!
//! A refused snapshot is not used. The last approved model is used until it has expired ([`crate::model::age`]); then
//! the fallback controls, at half of the axis' speed. When a controller takes over from a direct mode, the reference
//! begins at the position and speed of the axis, and the fallback at the last command.
//!
//! Runs in the loop: nothing here allocates after construction.

mod closed_loop;
mod command;
mod decision;
mod feedback;
mod law;
mod modes;
pub mod operation;
pub mod requests;
mod state;

pub use closed_loop::UNSOLVED_LIMIT;
pub use feedback::{UNUSABLE_LIMIT, patience};
pub use state::{MISSING_PART, SETTLING};

use pipeline::{
    machine::{Axis, Timing},
    message::{AxisCommand, AxisMode, AxisSample, AxisSnapshot, Reference, Request, control_flag, sample_fault},
};

use crate::{
    fallback::Fallback,
    load::Load,
    model::gate::Gate,
    protection::{Protection, walls::Wanted},
    reference::{References, generator::ReferenceGenerator},
    standstill::Standstill,
};
use command::Tracking;
use decision::Decision;
use feedback::{Feedback, Observation, SPEED_TIME};
use law::ModelLaw;
use operation::Operation;
use state::{State, StateMachine, Transition};

/// Following error at which an axis of the teeth has come to the begin of their way, m, and the same in counts of its
/// encoder, of which the larger one counts.
const ARRIVAL: f64 = 2e-3;
const ARRIVAL_COUNTS: f64 = 3.0;
/// Following error with which an axis may begin that has not come closer for a time, m: its load drifts, or its valve
/// does not answer so close to its middle.
const LATE_ARRIVAL: f64 = 1e-2;

/// What one axis gets for one tick.
#[derive(Debug, Clone, Copy)]
pub struct AxisInput<'a> {
    /// Tick of the sample.
    pub sequence: u64,
    /// Ticks since the last sample, 1 when none is missing; in closed loop since the last usable position.
    pub elapsed: u64,
    /// The axis' sample, if the message holds it.
    pub sample: Option<&'a AxisSample>,
    /// The axis' newest snapshot, if there is one, and the tick that it was made after.
    pub snapshot: Option<(u64, &'a AxisSnapshot)>,
    /// The newest reference message, if there is one.
    pub reference: Option<&'a Reference>,
    /// The emergency stop is pressed.
    pub emergency_stop: bool,
    /// The newest request, if there is one.
    pub request: Option<&'a Request>,
    /// The generators of all axes.
    pub generator: &'a ReferenceGenerator,
    /// Ticks along the path of the generators ([`crate::reference::path`]): this one and the coming ones.
    pub path: &'a [f64],
}

/// The controller of one axis.
#[derive(Debug, Clone)]
pub struct AxisController {
    operation: Operation,
    state: StateMachine,
    feedback: Feedback,
    gate: Gate,
    references: References,
    law: ModelLaw,
    fallback: Fallback,
    standstill: Standstill,
    protection: Protection,
    tracking: Tracking,
    /// Following error at which the axis has come to the begin of a way, m.
    arrival: f64,
    /// Of the last tick: its command is on the valve.
    decision: Decision,
}

impl AxisController {
    /// Disarmed. `index` is the axis' number in the messages. References are worked out for at least `ahead` ticks.
    pub fn new(index: usize, axis: &Axis, timing: &Timing, ahead: usize) -> Self {
        let period = timing.period.as_secs_f64();
        let control = &axis.control;
        let fallback = Fallback::new(control, axis.commissioned.as_ref(), period);
        let law = ModelLaw::new(axis, period);
        let used = ModelLaw::ahead(axis, period).max(fallback.ahead());
        Self {
            operation: Operation::new(index, axis, timing),
            state: StateMachine::new(timing),
            feedback: Feedback::new(axis, timing),
            gate: Gate::new(axis, timing),
            references: References::new(index, axis, period, used, ahead),
            law,
            fallback,
            standstill: Standstill::new(axis, period),
            protection: Protection::new(axis, period, SPEED_TIME.max(period)),
            tracking: Tracking::default(),
            arrival: ARRIVAL.max(ARRIVAL_COUNTS * axis.encoder.resolution),
            decision: Decision::neutral(0.0, control_flag::DISARMED),
        }
    }

    /// Requests may change the gains of the fallback within this range of parts, [`crate::gains`].
    pub fn allow_gains(&mut self, range: [f64; 2]) {
        self.operation.gain_range = range;
    }

    /// The command for one sample.
    pub fn update(&mut self, input: &AxisInput<'_>) -> AxisCommand {
        self.state.begin_tick(input.sequence);
        self.feedback.hold_command(input.elapsed.saturating_sub(1));
        if self.follows() && self.feedback.are_too_many(input.elapsed) {
            // Nothing was commanded for longer than a drive keeps a command.
            self.stand(0);
        }
        self.take_emergency_stop(input.emergency_stop);
        if input.emergency_stop {
            self.operation.requests.stop(input.sequence);
        }
        self.take_request(input);
        self.fallback.damp(self.feedback.damping(input.sample));
        let observation = self.feedback.observe(input.elapsed, input.sample, self.decision.command);
        self.take_motion(input, observation.position);
        let snapshot_flags = self.gate.take(input.sequence, input.snapshot);
        self.change_state(input, &observation);
        self.decide(input, &observation, snapshot_flags);
        self.decision.set_flag(control_flag::REQUEST, self.operation.requests.is_refused());
        self.feedback.push_command(self.decision.command);
        self.message()
    }

    /// The command on the valve since the last sample is this one in the place of the axis' own.
    pub fn apply(&mut self, command: f64) {
        self.decision.command = command;
        self.feedback.replace_command(command);
    }

    /// Number of coming references that the axis looks at.
    pub fn ahead(&self) -> usize {
        self.references.ahead()
    }

    /// The rate at which time along the path may go on at `tick` of the path, as far as this axis can follow.
    pub fn rate(&self, tick: f64, generator: &ReferenceGenerator) -> f64 {
        if self.follows() { self.references.rate(tick, generator) } else { 1.0 }
    }

    /// Whether the axis settles or follows.
    pub fn is_armed(&self) -> bool {
        self.state.is_armed()
    }

    /// Whether the axis is to follow a reference, but has had no reading for too long.
    pub fn waits(&self) -> bool {
        self.follows() && self.feedback.is_silent()
    }

    /// Whether the axis tracks its reference, or is on the way to it.
    pub fn pursues(&self) -> bool {
        self.follows() && self.operation.mode == AxisMode::Track && self.references.pursues()
    }

    /// Whether the axis tracks its reference, and its reference has come to the generator at `tick` of the path.
    pub fn tracks(&self, tick: f64) -> bool {
        self.pursues() && self.references.has_arrived(tick)
    }

    /// Whether the axis has come to its reference as well; `is_late` says that it has had much time for it.
    pub fn has_arrived(&self, tick: f64, is_late: bool) -> bool {
        let allowed = if is_late { self.arrival.max(LATE_ARRIVAL) } else { self.arrival };
        self.tracks(tick) && self.decision.error.abs() <= allowed
    }

    /// Lets an axis that tracks come to a stand and hold there, because another one does not trace the way with it.
    pub fn leave_way(&mut self) {
        if self.follows() && self.operation.mode == AxisMode::Track {
            self.stop_to_hold();
        }
    }

    /// Comes to a stand from where the axis is, and holds: its reference may be far ahead, as when the pump failed.
    fn stop_to_hold(&mut self) {
        self.operation.mode = AxisMode::Hold;
        self.references.hold(self.feedback.position().map(|position| (position, self.feedback.speed())));
    }

    /// Lets an axis that tracks stand where its reference is, and go on its way from `tick` of the path on.
    pub fn stay(&mut self, tick: f64, generator: &ReferenceGenerator) {
        if self.pursues() {
            self.references.stay(tick, generator);
        }
    }

    /// The newest position, m; none before the first one, and while readings are missing.
    pub fn position(&self) -> Option<f64> {
        self.feedback.position().filter(|_| !self.feedback.is_silent())
    }

    /// What the axis asks of the virtual walls after [`Self::update`].
    pub fn wanted(&self) -> Wanted {
        Wanted {
            command: self.decision.command,
            motion: self.position().map(|position| (position, self.feedback.speed())),
            is_manual: self.operation.mode == AxisMode::Manual,
        }
    }

    /// A virtual wall leaves this command of the one that [`Self::update`] has made. `is_stopped`: an axis in closed
    /// loop leaves its reference, comes to a stand and holds.
    pub fn stop_before_wall(&mut self, command: f64, is_stopped: bool) {
        self.apply(command);
        self.decision.set_flag(control_flag::WALL, true);
        // A set point that stands stays: an axis that sinks by leakage is to be brought back to it.
        let moves = self.operation.mode == AxisMode::Track || self.references.speed() != 0.0;
        if is_stopped && moves && self.follows() {
            self.stop_to_hold();
        }
    }

    fn follows(&self) -> bool {
        self.state.current() == State::Following && !self.operation.mode.is_direct()
    }

    /// Moves from state to state by what was observed.
    fn change_state(&mut self, input: &AxisInput<'_>, observation: &Observation) {
        match self.state.observe(observation, self.operation.mode.is_direct()) {
            Transition::Stay => {}
            Transition::Begin(position) => self.begin(input, position),
            Transition::Latch(cause) => self.latch(cause),
        }
    }

    /// Decides on the command of this tick.
    fn decide(&mut self, input: &AxisInput<'_>, observation: &Observation, snapshot_flags: u32) {
        if let Some(position) = observation.position {
            self.law.observe(observation.missing + 1, position, self.decision.command);
        }
        match (self.state.current(), observation.position) {
            (State::Following, Some(position)) if self.operation.mode.is_direct() => {
                self.decision = self.command_directly(input.sequence, position);
            }
            (State::Following, Some(position)) => {
                // References and errors were last looked at when there was a position.
                let since = AxisInput { elapsed: observation.missing + 1, ..*input };
                match self.follow(&since, position, snapshot_flags) {
                    Ok(decision) => self.decision = decision,
                    Err(cause) => self.latch(cause),
                }
            }
            // The last command stays for a moment, so that a single sample makes no difference. Then the axis waits at
            // neutral until the position is back or given up.
            (State::Following, None) => {
                if observation.missing + 1 >= UNUSABLE_LIMIT {
                    self.stand(snapshot_flags);
                }
                self.bridge(input.sequence);
            }
            _ => self.stand(snapshot_flags),
        }
    }

    /// The references of the last tick and of those after it, m; none for an axis that follows no reference, or that of
    /// a channel.
    pub fn coming(&self) -> Option<&[f64]> {
        self.references.coming().filter(|_| self.follows())
    }

    /// The axis bears this load from now on.
    pub fn bear(&mut self, load: Load) {
        self.fallback.bear(load);
        self.law.bear(load);
    }

    /// Arms a disarmed axis: it settles and then tracks its reference. Without effect on an axis in another state.
    pub fn arm(&mut self) {
        self.arm_in(AxisMode::Track, None);
    }

    /// Makes the axis neutral from the next command on, releases the latch and forgets the past. Without effect while
    /// the emergency stop is pressed. The way that nobody has commanded is measured anew only where a latch is
    /// released: an axis that is disarmed while its spool is stuck goes on.
    pub fn disarm(&mut self) {
        let was_latched = self.cause() != 0;
        if self.state.disarm() {
            self.stand(0);
            self.feedback.reset();
            if was_latched {
                self.protection.uncommanded().reset();
            }
            self.gate.reset();
        }
    }

    /// Disarms the axis unless it is latched. Requests made at tick `sequence` or before do not arm it again.
    pub fn stop(&mut self, sequence: Option<u64>) {
        if self.cause() == 0 {
            self.disarm();
        }
        sequence.into_iter().for_each(|sequence| self.operation.requests.stop(sequence));
    }

    /// A request was refused for all axes.
    pub fn refuse_request(&mut self) {
        self.operation.requests.count_refused();
    }

    /// Latches the axis at neutral for this cause, a [`control_flag`] bit. The first cause stays; an emergency
    /// stop and motion that nobody commanded are added to it.
    pub fn latch(&mut self, cause: u32) {
        self.state.latch(cause);
        self.stand(0);
    }

    /// Latches the axis for this cause, because its samples or commands come too late; one that still settles has not
    /// moved, and settles anew.
    pub fn lose(&mut self, cause: u32) {
        if !self.state.settle_anew(cause) {
            self.latch(cause);
        }
    }

    /// Makes an axis that follows neutral because no sample comes for now.
    pub fn fall_silent(&mut self) {
        if self.state.current() == State::Following {
            self.stand(0);
        }
    }

    /// Why the axis is latched, [`control_flag`] bits; 0 while it is not.
    pub fn cause(&self) -> u32 {
        self.state.cause()
    }

    /// Takes in the emergency stop, which comes before everything else.
    pub fn take_emergency_stop(&mut self, is_pressed: bool) {
        self.state.press(is_pressed);
        if is_pressed {
            self.latch(control_flag::EMERGENCY_STOP);
        }
    }

    /// Latches an axis that moves though nobody has commanded it.
    fn take_motion(&mut self, input: &AxisInput<'_>, position: Option<f64>) {
        let command = self.decision.command;
        let is_unexplained = self.protection.uncommanded().update(input.elapsed, command, position, UNUSABLE_LIMIT);
        // No command explains a speed that the axis cannot have.
        let runs_away = input.sample.is_some_and(|sample| sample.faults & sample_fault::RUNAWAY != 0);
        if is_unexplained || runs_away {
            self.latch(control_flag::MOTION);
        }
    }

    /// Decides for neutral in the present state.
    fn stand(&mut self, snapshot_flags: u32) {
        self.gate.interrupt();
        let reference = self.feedback.position().unwrap_or(self.decision.reference);
        self.decision = Decision::neutral(reference, snapshot_flags | self.state.flags());
    }

    /// Begins to follow at `position` (m), where the axis stands.
    fn begin(&mut self, input: &AxisInput<'_>, position: f64) {
        self.feedback.begin();
        self.gate.begin();
        self.law.begin();
        self.fallback.reset();
        self.standstill.reset();
        self.protection.reset();
        self.references.begin(input.path[0], position, input.generator);
        if self.operation.mode == AxisMode::Hold {
            self.references.hold(None);
            self.operation.set_point.into_iter().for_each(|set_point| self.references.aim(set_point));
        }
    }
}
