//! A program that operates the axes of a running group. It reads the samples of the group and answers each of them with
//! a request.
//!
//! A request names the newest sample that the operator has read. The controller computes from it how old the request
//! is. So samples drive the operator, and it stops when they do.
//!
//! Runs in the operator's process, beside the loop. The controller never waits for it.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use control_proc::axis::{MISSING_PART, SETTLING};
use pipeline::{
    MAX_AXES,
    channel::{
        Board, BoardError, ChannelError, Group, GroupMachine, GroupState, Listener, Prefix, Publisher, Reader, groups,
    },
    message::{
        AxisCommand, AxisMode, AxisRequest, AxisSample, EncoderSample, Header, Message, Request, TeethState, TipState,
        ValveCommand, bit_names, control_flag,
    },
    nearest::did_you_mean,
    stage::monotonic_ns,
};
use thiserror::Error;

use super::obstacles::Obstacles;

/// Longest sleep before the operator looks at the stop flag, and at the samples of a group without a notifier.
const SLICE: Duration = Duration::from_millis(5);
/// Time in which a sample must come.
const SAMPLE_PATIENCE: Duration = Duration::from_secs(2);
/// Periods in which a sample must come; they count where they are longer than [`SAMPLE_PATIENCE`].
const SAMPLE_PERIODS: u32 = 3;
/// Time in which the controller must do what it is asked, settling included.
const ANSWER_PATIENCE: Duration = Duration::from_secs(5);
/// Periods in which the controller must do it; they count where they are longer than [`ANSWER_PATIENCE`].
const ANSWER_PERIODS: u32 = 50;

/// Flags about models. They do not matter to an operator and are not shown.
const ABOUT_MODELS: u32 = control_flag::NO_MODEL
    | control_flag::MODEL_STALE
    | control_flag::MODEL_REFUSED
    | control_flag::MODEL_WORSE
    | control_flag::MODEL_TRIAL;

/// Why a group cannot be operated.
#[derive(Debug, Error)]
pub enum OperatorError {
    /// No group of this name runs.
    #[error("no group \"{0}\" runs; start one with: hydraxis run MACHINE.toml --prefix {0}{hint}", hint = near(.0))]
    NoGroup(Prefix),
    /// The group has an operator already.
    #[error(
        "another program operates group \"{prefix}\" (`hydraxis status --prefix {prefix}` names it); end that one \
         first, or take its place with --take-over; `hydraxis disarm --prefix {prefix}` stops the axes whoever operates"
    )]
    Taken {
        /// The group.
        prefix: Prefix,
    },
    /// Another program has taken over.
    #[error("another program has taken over the operation of group \"{0}\"; this one has no effect any more")]
    Replaced(Prefix),
    /// A channel of the group cannot be used.
    #[error(transparent)]
    Channel(#[from] ChannelError),
    /// The board of the group cannot be read.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The group sends no samples.
    #[error(
        "group \"{prefix}\": no sample within {}: it has ended, or the program that reads the sensor has not been \
         started, has ended, or waits for a device that `hydraxis run` names; `hydraxis status --prefix {prefix}` \
         shows the group",
        humantime::format_duration(*.patience)
    )]
    NoSample {
        /// The group.
        prefix: Prefix,
        /// Time in which one should have come.
        patience: Duration,
    },
    /// The controller did not do what it was asked.
    #[error("{wanted}: not within {}; {}{why}", humantime::format_duration(*.patience), .states.join("; "))]
    NoAnswer {
        /// What it was asked for.
        wanted: String,
        /// Time in which it should have been done.
        patience: Duration,
        /// The states of all axes.
        states: Vec<String>,
        /// What in the samples keeps the controller from doing it; may be empty.
        why: String,
    },
    /// A stop was asked for while this program was on its way to arm axes.
    #[error(
        "group \"{prefix}\": a stop was asked for after this command was typed, so it arms nothing; when the machine \
         may move, type it again"
    )]
    Stopped {
        /// The group.
        prefix: Prefix,
    },
    /// The emergency stop is pressed, which nothing releases but the stop itself.
    #[error(
        "group \"{0}\": the emergency stop is pressed, so its latch cannot be released: release the stop, then type \
         the command again"
    )]
    Pressed(Prefix),
    /// The controller has refused other gains.
    #[error(
        "{state}: gains of {gain} times those of the machine file are refused; allowed: {allowed}, while it is off"
    )]
    Gain {
        /// The state of the axis.
        state: String,
        /// The part that was asked for.
        gain: f64,
        /// The parts that are allowed.
        allowed: String,
    },
    /// The controller has disarmed an axis on its way to a mode.
    #[error(
        "{state}: not {wanted}, it was armed and is not any more: another axis has cut the pilot pressure off, or the \
         controller has ended, and starts disarmed"
    )]
    Disarmed {
        /// The state of the axis.
        state: String,
        /// The mode that was asked for.
        wanted: &'static str,
    },
    /// A fault latched an axis on its way to a mode.
    #[error("{state}: not {wanted}, a fault has latched it")]
    Latched {
        /// The state of the axis.
        state: String,
        /// The mode that was asked for.
        wanted: &'static str,
    },
}

/// The nearest names of groups that run, as a question.
fn near(prefix: &Prefix) -> String {
    let alive = groups().into_iter().filter(|group| group.state == GroupState::Alive);
    let names: Vec<String> = alive.map(|group| group.prefix.to_string()).collect();
    did_you_mean(&prefix.to_string(), names.iter().map(String::as_str))
}

/// The operator of a group; a group has at most one.
pub struct Operator {
    machine: GroupMachine,
    prefix: Prefix,
    board: Board,
    /// Stops that were asked for before this program began.
    stops: [u32; MAX_AXES + 1],
    /// The stops that matter to the present requests: those of the axes that they arm, and of all.
    arming: [bool; MAX_AXES + 1],
    samples: Reader<EncoderSample>,
    commands: Reader<ValveCommand>,
    requests: Publisher<Request>,
    listener: Listener,
    request: Request,
    /// The controller has taken a request of this program.
    is_current: bool,
    sample_patience: Duration,
    answer_patience: Duration,
    stop: Arc<AtomicBool>,
    group: Group,
}

impl Operator {
    /// Joins a group, and waits until the controller takes its requests, which ask for nothing yet. `stop` ends all
    /// waiting. `takes_over`: in the place of a program that operates the group now.
    ///
    /// # Errors
    /// No such group runs, it has no controller, or another program operates it.
    pub fn join(prefix: &Prefix, takes_over: bool, stop: Arc<AtomicBool>) -> Result<Self, OperatorError> {
        let board = board(prefix)?;
        let (machine, stops) = (*board.machine(), board.asked());
        let group = Group::join(prefix, "operator").map_err(ChannelError::from)?;
        // An operator that was killed would count as one that operates.
        group.bury_the_dead();
        let requests = group.publisher::<Request>().map_err(ChannelError::from)?;
        if !takes_over && group.publishers::<Request>().map_err(ChannelError::from)? > 1 {
            return Err(OperatorError::Taken { prefix: prefix.clone() });
        }
        let period = Duration::from_nanos(machine.period_ns);
        let mut operator = Self {
            machine,
            prefix: prefix.clone(),
            board,
            stops,
            arming: [false; MAX_AXES + 1],
            samples: group.reader().map_err(ChannelError::from)?,
            commands: group.reader().map_err(ChannelError::from)?,
            listener: group.listener::<EncoderSample>().map_err(ChannelError::from)?,
            requests,
            request: Request { session: monotonic_ns(), takes_over: u32::from(takes_over), ..Request::default() },
            is_current: false,
            sample_patience: SAMPLE_PATIENCE.max(period * SAMPLE_PERIODS),
            answer_patience: ANSWER_PATIENCE.max(period * ANSWER_PERIODS),
            stop,
            group,
        };
        operator.request.header = Header { axis_count: machine.axis_count as u32, ..Header::default() };
        // The controller counts the edges of `enable` from the first message that it has taken.
        let (session, mut taken) = (operator.request.session, None);
        operator.ask_until("an answer of the controller", |command, _| {
            let now = command.axes[0].taken_requests;
            command.operator == session && now > *taken.get_or_insert(now)
        })?;
        operator.is_current = true;
        Ok(operator)
    }

    /// The machine of the group.
    pub fn machine(&self) -> &GroupMachine {
        &self.machine
    }

    /// Opens a channel of the group that this program writes besides its requests.
    ///
    /// # Errors
    /// Another program writes it.
    pub fn publisher<M: Message>(&self) -> Result<Publisher<M>, OperatorError> {
        Ok(self.group.publisher().map_err(ChannelError::from)?)
    }

    /// Whether the user wants this program to end.
    pub fn stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// The next sample, in order; none when the program is to end.
    ///
    /// # Errors
    /// No sample comes.
    pub fn sample(&mut self) -> Result<Option<EncoderSample>, OperatorError> {
        // The first one comes after devices have been set up.
        let patience = if self.samples.last().is_some() { self.sample_patience } else { self.answer_patience };
        let until = Instant::now() + patience;
        while !self.stopping() {
            if let Some(sample) = self.await_sample()? {
                return Ok(Some(sample));
            }
            if Instant::now() > until {
                return Err(OperatorError::NoSample { prefix: self.prefix.clone(), patience });
            }
        }
        Ok(None)
    }

    fn await_sample(&mut self) -> Result<Option<EncoderSample>, OperatorError> {
        if let Some(sample) = self.samples.read().map_err(ChannelError::from)?.if_new() {
            return Ok(Some(*sample));
        }
        self.listener.wait(SLICE).map_err(ChannelError::from)?;
        Ok(self.samples.read().map_err(ChannelError::from)?.if_new().copied())
    }

    /// The next command of the controller, in order, if one has come.
    ///
    /// # Errors
    /// The channel cannot be read, or another program has taken over.
    pub fn command(&mut self) -> Result<Option<ValveCommand>, OperatorError> {
        let command = self.commands.read().map_err(ChannelError::from)?.if_new().copied();
        // A controller that has been started again does not know of any program yet.
        if command.is_some_and(|command| command.operator != 0 && command.operator != self.request.session)
            && self.is_current
        {
            return Err(OperatorError::Replaced(self.prefix.clone()));
        }
        Ok(command)
    }

    /// The controller's last command of an axis, if there has been one.
    pub fn last(&self, axis: usize) -> Option<AxisCommand> {
        self.commands.last().map(|command| command.axes[axis])
    }

    /// Where the teeth were at the controller's last command.
    pub fn teeth(&self) -> Option<TeethState> {
        self.commands.last().map(|command| command.teeth).filter(|teeth| teeth.state != TipState::Unknown as u32)
    }

    /// The request for an axis that goes out with the next message.
    pub fn axis(&mut self, axis: usize) -> &mut AxisRequest {
        &mut self.request.axes[axis]
    }

    /// Sends the requests of all axes as an answer to this sample.
    ///
    /// A program that was suspended goes on where it was, also after a stop. The controller takes no request that arms
    /// and names a sample from before the stop. So it is enough to look for a stop after the sample was read.
    ///
    /// # Errors
    /// The message cannot be sent, or arms an axis after a stop.
    pub fn ask(&mut self, sample: &EncoderSample) -> Result<(), OperatorError> {
        let asked = self.board.asked();
        if (0..=MAX_AXES).any(|i| self.arming[i] && asked[i] != self.stops[i]) {
            return Err(OperatorError::Stopped { prefix: self.prefix.clone() });
        }
        self.request.header.sequence = sample.header.sequence;
        self.request.header.acquired_ns = sample.header.acquired_ns;
        self.request.header.sent_ns = monotonic_ns();
        Ok(self.requests.send(&self.request).map_err(ChannelError::from)?)
    }

    /// Answers samples until `is_done` accepts a command of the controller; false when the program is to end before.
    /// `is_done` may change the request: commands that have come are looked at before the next request is sent.
    fn ask_until(
        &mut self,
        wanted: &str,
        mut is_done: impl FnMut(&ValveCommand, &mut Request) -> bool,
    ) -> Result<bool, OperatorError> {
        let (mut has_asked, mut obstacles, mut until) = (false, Obstacles::default(), None);
        loop {
            let Some(sample) = self.sample()? else { return Ok(false) };
            let until = *until.get_or_insert_with(|| Instant::now() + self.answer_patience);
            obstacles.see(&sample);
            while let Some(command) = self.command()? {
                if is_done(&command, &mut self.request) && has_asked {
                    return Ok(true);
                }
            }
            self.ask(&sample)?;
            has_asked = true;
            if Instant::now() > until {
                return Err(self.no_answer(wanted, &obstacles));
            }
        }
    }

    fn no_answer(&self, wanted: &str, obstacles: &Obstacles) -> OperatorError {
        OperatorError::NoAnswer {
            wanted: wanted.to_owned(),
            patience: self.answer_patience,
            states: (0..self.machine.axis_count as usize).map(|axis| self.state(axis)).collect(),
            why: obstacles.text(&self.machine),
        }
    }

    /// Disarms axes that are not latched, and waits until the controller says that they are. A latched axis stays
    /// latched, also one that is latched meanwhile: only a person releases it.
    ///
    /// # Errors
    /// The controller does not say so in time.
    pub fn disarm(&mut self, axes: &[usize]) -> Result<(), OperatorError> {
        let is_latched = |command: &ValveCommand, axis: usize| command.axes[axis].flags & control_flag::LATCHED != 0;
        let ask = |command: &ValveCommand, request: &mut Request| {
            for axis in axes {
                let mode = if is_latched(command, *axis) { AxisMode::Unchanged } else { AxisMode::Off };
                request.axes[*axis].mode = mode as u32;
            }
        };
        ask(&self.commands.last().copied().unwrap_or_default(), &mut self.request);
        self.switch_off(|command, request| {
            ask(command, request);
            let is_disarmed = |axis: usize| command.axes[axis].flags & control_flag::DISARMED != 0;
            axes.iter().all(|axis| is_disarmed(*axis) || is_latched(command, *axis))
        })
    }

    /// Disarms axes, latched ones as well, and waits until the controller says that they are disarmed. What has latched
    /// them is what a person has seen and acknowledges.
    ///
    /// # Errors
    /// The emergency stop is pressed, another fault latches one of them meanwhile, or the controller does not say so in
    /// time.
    pub fn release(&mut self, axes: &[usize]) -> Result<(), OperatorError> {
        let causes = |command: &ValveCommand, axis: usize| command.axes[axis].flags & control_flag::LATCHED;
        let seen = self.commands.last().copied().unwrap_or_default();
        let is_stopped = axes.iter().any(|axis| causes(&seen, *axis) & control_flag::EMERGENCY_STOP != 0);
        if is_stopped && self.samples.last().is_some_and(|sample| sample.emergency_stop != 0) {
            return Err(OperatorError::Pressed(self.prefix.clone()));
        }
        let mut latched = None;
        axes.iter().for_each(|axis| self.axis(*axis).mode = AxisMode::Off as u32);
        self.switch_off(|command, request| {
            latched = axes.iter().copied().find(|axis| causes(command, *axis) & !causes(&seen, *axis) != 0);
            if latched.is_some() {
                axes.iter().for_each(|axis| request.axes[*axis].mode = AxisMode::Unchanged as u32);
            }
            latched.is_some() || axes.iter().all(|axis| command.axes[*axis].flags & control_flag::DISARMED != 0)
        })?;
        match latched {
            Some(axis) => Err(OperatorError::Latched { state: self.state(axis), wanted: "released" }),
            None => Ok(()),
        }
    }

    fn switch_off(&mut self, is_done: impl FnMut(&ValveCommand, &mut Request) -> bool) -> Result<(), OperatorError> {
        // The stop flag does not count here: when the program is to end, the axes must be disarmed all the more.
        let stop = std::mem::take(&mut self.stop);
        let off = self.ask_until("off", is_done);
        self.stop = stop;
        off.map(|_| ())
    }

    /// Changes axes to a mode, arms those that are disarmed, and waits until all are in it; false when the program is
    /// to end before.
    ///
    /// Nothing is armed before the samples of all these axes have been usable for a while: they begin together, and a
    /// fault that is over only after this program was killed moves none of them.
    ///
    /// The controller takes no edge of a message that comes too late, or too long after the one before. A program that
    /// had no core for a moment asks for another edge then, until the axis has been armed once.
    ///
    /// # Errors
    /// They are not in the mode in time, or a fault latches one of them on the way.
    pub fn change(&mut self, axes: &[usize], mode: AxisMode) -> Result<bool, OperatorError> {
        if !self.await_usable(axes, mode)? {
            return Ok(false);
        }
        for axis in axes {
            self.axis(*axis).mode = mode as u32;
            self.axis(*axis).enable += 1;
            self.arming[*axis] = true;
        }
        self.arming[MAX_AXES] = true;
        let (mut was_armed, mut taken, mut lost) = ([false; MAX_AXES], [u64::MAX; MAX_AXES], None);
        let is_changed = self.await_mode(axes, mode, |command, request| {
            for axis in axes.iter().copied() {
                let found = &command.axes[axis];
                let is_armed = found.flags & control_flag::DISARMED == 0;
                lost = lost.or((was_armed[axis] && !is_armed).then_some(axis));
                was_armed[axis] |= is_armed;
                // A message with the edge was taken, and has not armed the axis.
                if !was_armed[axis] && found.taken_requests > taken[axis] {
                    request.axes[axis].enable = request.axes[axis].enable.wrapping_add(1);
                }
                taken[axis] = found.taken_requests;
            }
            lost.is_some()
        });
        self.arming = [false; MAX_AXES + 1];
        match lost {
            Some(axis) => Err(OperatorError::Disarmed { state: self.state(axis), wanted: mode.name() }),
            None => is_changed,
        }
    }

    /// Waits until the samples of axes have been usable for [`SETTLING`], counted as the controller does when an axis
    /// settles; false when the program is to end before.
    fn await_usable(&mut self, axes: &[usize], mode: AxisMode) -> Result<bool, OperatorError> {
        let (mut last, mut usable) = (Instant::now(), Duration::ZERO);
        let (until, mut obstacles) = (last + self.answer_patience, Obstacles::default());
        while let Some(sample) = self.sample()? {
            obstacles.see(&sample);
            let found = || axes.iter().map(|axis| &sample.axes[*axis]);
            let now = Instant::now();
            usable = if sample.emergency_stop != 0 || found().any(|axis| axis.usable().is_none() && !axis.is_stale()) {
                Duration::ZERO
            } else if found().any(AxisSample::is_stale) {
                usable.saturating_sub(SETTLING / MISSING_PART)
            } else if usable + (now - last) < SETTLING {
                usable + (now - last)
            } else {
                return Ok(true);
            };
            last = now;
            while self.command()?.is_some() {}
            let latched = axes.iter().copied().find(|axis| !self.latched_by(*axis).is_empty());
            if let Some(axis) = latched.filter(|_| sample.emergency_stop == 0) {
                return Err(OperatorError::Latched { state: self.state(axis), wanted: mode.name() });
            }
            self.ask(&sample)?;
            if now > until {
                return Err(self.no_answer(mode.name(), &obstacles));
            }
        }
        Ok(false)
    }

    /// Waits until axes that are armed in a mode have settled in it; false when the program is to end before.
    ///
    /// # Errors
    /// They have not settled in time, or a fault latches one of them.
    pub fn await_settled(&mut self, axes: &[usize], mode: AxisMode) -> Result<bool, OperatorError> {
        self.await_mode(axes, mode, |_, _| false)
    }

    /// Answers samples until axes have settled in a mode, or `look` gives up. It sees each command of the controller.
    fn await_mode(
        &mut self,
        axes: &[usize],
        mode: AxisMode,
        mut look: impl FnMut(&ValveCommand, &mut Request) -> bool,
    ) -> Result<bool, OperatorError> {
        let mut latched = None;
        let is_in = self.ask_until(mode.name(), |command, request| {
            let gives_up = look(command, request);
            let is_in = |axis: &AxisCommand| axis.operation == mode as u32 && axis.flags & control_flag::SETTLING == 0;
            latched = axes.iter().copied().find(|axis| command.axes[*axis].flags & control_flag::LATCHED != 0);
            gives_up || latched.is_some() || axes.iter().all(|axis| is_in(&command.axes[*axis]))
        });
        match latched {
            Some(axis) => Err(OperatorError::Latched { state: self.state(axis), wanted: mode.name() }),
            None => is_in,
        }
    }

    /// Changes the gains of the fallback of an axis to this part of those in the machine file. `range`: the parts that
    /// are allowed, for what is said. Returns the part before.
    ///
    /// # Errors
    /// The controller refuses it, or does not answer in time.
    pub fn scale(&mut self, axis: usize, gain: f64, range: [f64; 2]) -> Result<f64, OperatorError> {
        let before = self.last(axis).unwrap_or_default();
        self.axis(axis).gain = gain;
        let mut is_refused = false;
        let answered = self.ask_until("the new gains", |command, _| {
            let now = &command.axes[axis];
            is_refused = now.refused_requests != before.refused_requests;
            is_refused || now.gain == gain
        });
        self.axis(axis).gain = 0.0;
        answered?;
        if is_refused {
            let allowed = format!("{:.3} to {:.3}", range[0], range[1]);
            return Err(OperatorError::Gain { state: self.state(axis), gain, allowed });
        }
        Ok(before.gain)
    }

    /// Names of the faults that have latched an axis; empty when it is not latched.
    pub fn latched_by(&self, axis: usize) -> String {
        let flags = self.last(axis).map_or(0, |last| last.flags & control_flag::LATCHED);
        bit_names(flags, &control_flag::NAMES).collect::<Vec<_>>().join(", ")
    }

    /// The state of an axis in words: its mode and its flags.
    pub fn state(&self, axis: usize) -> String {
        let name = self.machine.name(axis);
        match self.last(axis) {
            Some(last) => state(name, last.flags, last.operation),
            None => format!("axis.{name}: no command yet"),
        }
    }
}

/// The board of a group that runs.
///
/// # Errors
/// No such group runs, or its board cannot be read.
pub fn board(prefix: &Prefix) -> Result<Board, OperatorError> {
    Board::find(prefix)?.ok_or_else(|| OperatorError::NoGroup(prefix.clone()))
}

/// The state of an axis in words: its mode and its flags.
pub fn state(name: &str, flags: u32, operation: u32) -> String {
    let flags: Vec<&str> = bit_names(flags & !ABOUT_MODELS, &control_flag::NAMES).collect();
    let flags = if flags.is_empty() { String::new() } else { format!(" ({})", flags.join(", ")) };
    let mode = AxisMode::from_number(operation).map_or("unknown", AxisMode::name);
    format!("axis.{name}: {mode}{flags}")
}
