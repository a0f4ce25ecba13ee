//! Who operates the axes of a running group: reads its samples, and answers every one with a request.
//!
//! A request names the newest sample that the operator has seen; the controller tells by it how old the request is. So
//! whoever operates is driven by the samples, and stops with them.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

use pipeline::{
    channel::{ChannelError, Group, Listener, Prefix, Publisher, Reader},
    machine::Machine,
    message::{
        AxisCommand, AxisMode, AxisRequest, EncoderSample, Header, Request, ValveCommand, bit_names, control_flag,
    },
    stage::monotonic_ns,
};

use crate::failure::Failure;

/// Longest sleep before the stop flag is looked at, and samples of a group without a notifier.
const SLICE: Duration = Duration::from_millis(5);
/// How long a sample may take, and periods where those are longer.
const PATIENCE: (Duration, u32) = (Duration::from_secs(2), 3);
/// How long the controller may take to do what it is asked, settling included; and periods.
const ANSWER_PATIENCE: (Duration, u32) = (Duration::from_secs(5), 50);

/// What is nothing to whoever operates.
const ABOUT_MODELS: u32 = control_flag::NO_MODEL | control_flag::MODEL_STALE | control_flag::MODEL_REFUSED;

/// One program's place at the levers of a group.
pub struct Operator {
    names: Vec<String>,
    prefix: Prefix,
    samples: Reader<EncoderSample>,
    commands: Reader<ValveCommand>,
    requests: Publisher<Request>,
    listener: Listener,
    request: Request,
    patience: Duration,
    answer_patience: Duration,
    stop: Arc<AtomicBool>,
    _group: Group,
}

impl Operator {
    /// Joins a group that runs `machine`, and makes itself heard, asking for nothing yet; `stop` ends all waiting.
    ///
    /// # Errors
    /// No such group runs, it has other axes or no controller, or another program operates it.
    pub fn join(machine: &Machine, prefix: &Prefix, stop: Arc<AtomicBool>) -> Result<Self, Failure> {
        if !prefix.folder().exists() {
            return Err(Failure::Run(format!(
                "no group \"{prefix}\" runs; start one with: hydraxis run --prefix {prefix}"
            )));
        }
        let group = Group::join(prefix, "operator").map_err(Failure::run)?;
        // An operator that was killed would hold its place for good.
        group.bury_the_dead();
        let requests = group.publisher::<Request>().map_err(|error| match error {
            ChannelError::Open { .. } => {
                Failure::Run(format!("{error}: another program operates group \"{prefix}\"; end that one first"))
            }
            other => Failure::run(other),
        })?;
        let mut operator = Self {
            names: machine.axes.iter().map(|axis| axis.name.clone()).collect(),
            prefix: prefix.clone(),
            samples: group.reader().map_err(Failure::run)?,
            commands: group.reader().map_err(Failure::run)?,
            listener: group.listener::<EncoderSample>().map_err(Failure::run)?,
            requests,
            request: Request { session: monotonic_ns(), ..Request::default() },
            patience: PATIENCE.0.max(machine.timing.period * PATIENCE.1),
            answer_patience: ANSWER_PATIENCE.0.max(machine.timing.period * ANSWER_PATIENCE.1),
            stop,
            _group: group,
        };
        operator.request.header = Header { axis_count: machine.axes.len() as u32, ..Header::default() };
        if let Some(sample) = operator.sample()?
            && sample.header.axis_count != operator.request.header.axis_count
        {
            return Err(Failure::Usage(format!(
                "machine: found {} axes where group \"{prefix}\" has {}; allowed: the machine file that it was started \
                 with",
                machine.axes.len(),
                sample.header.axis_count
            )));
        }
        // The edge of an enable is counted from a message that the controller has taken.
        let mut taken = None;
        operator.ask_until("an answer of the controller", |command| {
            let now = command.axes[0].taken_requests;
            now > *taken.get_or_insert(now)
        })?;
        Ok(operator)
    }

    /// Whether somebody wants it to end.
    pub fn stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// The next sample, in their order; none when it is to end.
    ///
    /// # Errors
    /// No sample comes.
    pub fn sample(&mut self) -> Result<Option<EncoderSample>, Failure> {
        let until = Instant::now() + self.patience;
        while !self.stopping() {
            if let Some(sample) = self.await_sample()? {
                return Ok(Some(sample));
            }
            if Instant::now() > until {
                return Err(self.silent());
            }
        }
        Ok(None)
    }

    fn await_sample(&mut self) -> Result<Option<EncoderSample>, Failure> {
        if let Some(sample) = self.samples.read().map_err(Failure::run)?.if_new() {
            return Ok(Some(*sample));
        }
        self.listener.wait(SLICE).map_err(Failure::run)?;
        Ok(self.samples.read().map_err(Failure::run)?.if_new().copied())
    }

    fn silent(&self) -> Failure {
        Failure::Run(format!(
            "group \"{}\": no sample within {:?}: it has ended, or its sensor has",
            self.prefix, self.patience
        ))
    }

    /// The next command of the controller, in their order, if it has come.
    ///
    /// # Errors
    /// The channel cannot be read.
    pub fn command(&mut self) -> Result<Option<ValveCommand>, Failure> {
        Ok(self.commands.read().map_err(Failure::run)?.if_new().copied())
    }

    /// What the controller last did with an axis, if it has done anything.
    pub fn last(&self, axis: usize) -> Option<AxisCommand> {
        self.commands.last().map(|command| command.axes[axis])
    }

    /// What is asked of an axis with the next message.
    pub fn axis(&mut self, axis: usize) -> &mut AxisRequest {
        &mut self.request.axes[axis]
    }

    /// Asks, as an answer to this sample.
    ///
    /// # Errors
    /// The message cannot be sent.
    pub fn ask(&mut self, sample: &EncoderSample) -> Result<(), Failure> {
        self.request.header.sequence = sample.header.sequence;
        self.request.header.acquired_ns = sample.header.acquired_ns;
        self.request.header.sent_ns = monotonic_ns();
        self.requests.send(&self.request).map_err(Failure::run)
    }

    /// Answers samples until the controller's commands are as they should be; false when it is to end first.
    fn ask_until(&mut self, what: &str, mut is_done: impl FnMut(&ValveCommand) -> bool) -> Result<bool, Failure> {
        let until = Instant::now() + self.answer_patience;
        loop {
            let Some(sample) = self.sample()? else { return Ok(false) };
            self.ask(&sample)?;
            while let Some(command) = self.command()? {
                if is_done(&command) {
                    return Ok(true);
                }
            }
            if Instant::now() > until {
                let states: Vec<String> = (0..self.names.len()).map(|axis| self.state(axis)).collect();
                return Err(Failure::Run(format!(
                    "{what}: not within {:?}; {}",
                    self.answer_patience,
                    states.join("; ")
                )));
            }
        }
    }

    /// Puts axes off, a latched one too, and waits until they are.
    ///
    /// # Errors
    /// They are not within a bound.
    pub fn off(&mut self, axes: &[usize]) -> Result<(), Failure> {
        // Also when it is to end: that is when it matters most.
        let stop = std::mem::take(&mut self.stop);
        axes.iter().for_each(|axis| self.axis(*axis).mode = AxisMode::Off as u32);
        let off = self.ask_until("off", |command| {
            axes.iter().all(|axis| command.axes[*axis].flags & control_flag::DISARMED != 0)
        });
        self.stop = stop;
        off.map(|_| ())
    }

    /// Changes axes to a mode, with an enable for those that are off, and waits until they are in it; false when it is
    /// to end first.
    ///
    /// # Errors
    /// They are not within a bound, or a fault latches one of them on the way.
    pub fn change(&mut self, axes: &[usize], mode: AxisMode) -> Result<bool, Failure> {
        for axis in axes {
            self.axis(*axis).mode = mode as u32;
            self.axis(*axis).enable += 1;
        }
        let mut latched = None;
        let is_changed = self.ask_until(mode.name(), |command| {
            let is_in = |axis: &AxisCommand| axis.operation == mode as u32 && axis.flags & control_flag::SETTLING == 0;
            latched = axes.iter().copied().find(|axis| command.axes[*axis].flags & control_flag::LATCHED != 0);
            latched.is_some() || axes.iter().all(|axis| is_in(&command.axes[*axis]))
        })?;
        match latched {
            Some(axis) => {
                Err(Failure::Run(format!("{}: not {}, a fault has latched it", self.state(axis), mode.name())))
            }
            None => Ok(is_changed),
        }
    }

    /// Names of the faults that have latched an axis; empty when none has.
    pub fn latched_by(&self, axis: usize) -> String {
        let flags = self.last(axis).map_or(0, |last| last.flags & control_flag::LATCHED);
        bit_names(flags, &control_flag::NAMES).collect::<Vec<_>>().join(", ")
    }

    /// The state of an axis in words.
    pub fn state(&self, axis: usize) -> String {
        let name = &self.names[axis];
        let Some(last) = self.last(axis) else { return format!("axis.{name}: no command yet") };
        let flags: Vec<&str> = bit_names(last.flags & !ABOUT_MODELS, &control_flag::NAMES).collect();
        let flags = if flags.is_empty() { String::new() } else { format!(" ({})", flags.join(", ")) };
        let mode = AxisMode::from_number(last.operation).map_or("unknown", AxisMode::name);
        format!("axis.{name}: {mode}{flags}")
    }
}
