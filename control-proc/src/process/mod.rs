//! The stage: samples, snapshots, references and requests in, valve commands out.
//!
//! In real time the stage watches two times:
//!
//! - No sample for more than 50 ms or three periods, and one period: the valves are made neutral by a message that only
//!   has to be copied. After more than `feedback_timeout` the axes are latched, too. A sample that is older than that
//!   when it is read is not acted on.
//! - A command that goes out more than a period after its sample was acquired is late. It is made with the newest data.
//!   As many late commands in a row as periods fit into `feedback_timeout`, at least two, latch the axes.
//!
//! Neither can be told by clocks that are wrong. A sample with a time that is still to come latches the axes, and so
//! does a computer that has been suspended.
//!
//! In lock-step the command of tick k is made with the snapshot of tick k-1, and the stage waits for that.

mod deadlines;
mod trace;

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use pipeline::{
    channel::{Board, Group, Publisher, Reader, Stop, Stops},
    machine::Machine,
    message::{
        CoefficientSnapshot, EncoderSample, Header, MachineState, MissCause, Reference, Request, ValveCommand,
        command_event, control_flag,
    },
    stage::{
        Channels, Clock, Next, Stage, StageError, StageKind, StageOptions, Turn, Waiter, asleep_ns, monotonic_ns,
        run as run_stage,
    },
};

use crate::{Controller, gains};
use deadlines::{Deadlines, FeedbackAge};
use trace::Trace;

/// Runs the stage until its last tick or a signal; the last command is neutral.
///
/// # Errors
/// A trajectory cannot be used, or a channel cannot.
pub fn run(machine: &Machine, options: StageOptions) -> Result<(), StageError> {
    let setup = options.clone();
    run_stage(StageKind::ControlProc, machine, options, |group, board| Process::new(machine, &setup, group, board))
}

struct Process {
    core: Controller,
    inputs: Inputs,
    stops: Stops,
    /// Set by a signal: all axes are to be disarmed.
    off: Arc<AtomicBool>,
    commands: Publisher<ValveCommand>,
    states: Publisher<MachineState>,
    /// Filled in at every heartbeat; the names of the axes stay.
    state: MachineState,
    /// The last command that was sent.
    last: ValveCommand,
    waiter: Waiter,
    clock: Clock,
    feedback: FeedbackAge,
    deadlines: Deadlines,
}

/// The channels that the stage reads, and what came from them.
struct Inputs {
    samples: Reader<EncoderSample>,
    snapshots: Reader<CoefficientSnapshot>,
    references: Reader<Reference>,
    requests: Reader<Request>,
    trace: Trace,
}

/// A sample that has come, and the ticks that it followed.
struct Arrival {
    header: Header,
    /// Samples that have come in this turn.
    count: u64,
    /// Ticks between the last sample and this one.
    passed: u64,
}

impl Process {
    fn new(machine: &Machine, options: &StageOptions, group: &Group, board: Board) -> Result<Self, StageError> {
        let mut core = Controller::new(machine).map_err(StageError::setup)?;
        let state = at_rest(machine);
        core.allow_gains(state.axes.map(|axis| axis.gain_range));
        let mut trace = Trace::new(machine);
        if options.arm {
            core.arm();
            trace.note(command_event::ARMED);
        }
        Ok(Self {
            core,
            inputs: Inputs {
                samples: group.reader()?,
                snapshots: group.reader()?,
                references: group.reader()?,
                requests: group.reader()?,
                trace,
            },
            stops: Stops::new(board),
            off: Arc::clone(&options.off),
            commands: group.publisher()?,
            states: group.publisher()?,
            state,
            last: ValveCommand::default(),
            waiter: Waiter::new::<EncoderSample>(group, machine, StageKind::ControlProc, options.clock)?,
            clock: options.clock,
            feedback: FeedbackAge::new(machine),
            deadlines: Deadlines::new(machine),
        })
    }

    /// Waits for a sample; none if the turn ends without one.
    fn await_sample(&mut self, turn: &mut Turn) -> Result<Option<Arrival>, StageError> {
        let Inputs { samples, trace, .. } = &mut self.inputs;
        let (clock, core) = (self.clock, &mut self.core);
        let before = samples.last().map(|sample| sample.header.sequence);
        let mut count = 0;
        turn.wait_for(&self.waiter, || {
            // Only the newest sample is worth a command; the gap in the sequence tells the core what it missed.
            while let Some(sample) = samples.read()?.if_new() {
                count += 1;
                // Also one between two others counts, and one that is too old to be acted on.
                if sample.emergency_stop != 0 && clock == Clock::RealTime {
                    let stop = Stop { emergency: true, ..Stop::default() };
                    core.stop(stop);
                    trace.stop(stop);
                }
                if clock == Clock::LockStep {
                    break;
                }
            }
            Ok(count > 0)
        })?;
        let newest = samples.last().filter(|_| count > 0);
        Ok(newest.map(|sample| {
            let header = sample.header;
            let passed = before.map_or(0, |before| header.sequence.saturating_sub(before + 1));
            Arrival { header, count, passed }
        }))
    }

    /// Does what was asked for on the board or by the signal; whether anything was.
    fn take_stops(&mut self) -> bool {
        let mut stop = self.stops.take();
        if self.off.swap(false, Ordering::Relaxed) {
            stop.axes = Stop::ALL.axes;
        }
        if stop.is_any() {
            self.core.stop(stop);
            self.inputs.trace.stop(stop);
        }
        stop.is_any()
    }

    /// Tells the board what the last command has done.
    fn answer_stops(&self) {
        self.stops.done(&self.last);
        if !self.core.is_emergency() {
            self.stops.reset();
        }
    }

    /// Without a sample: a stop does not wait for one.
    fn stop_at_once(&mut self) -> Result<(), StageError> {
        if !self.take_stops() {
            return Ok(());
        }
        let last = self.last.header;
        let mut command = self.core.message();
        command.header = Header { axis_count: command.header.axis_count, sent_ns: monotonic_ns(), ..last };
        self.inputs.trace.note(command_event::REPEATED);
        command.inputs = self.inputs.trace.take();
        self.last = command;
        self.commands.send(&command)?;
        self.answer_stops();
        Ok(())
    }

    /// Real time: makes the valves neutral once no sample has come for a while, and again at every call after that.
    /// Once the last sample is too old, the axes are latched.
    fn watch_feedback(&mut self) -> Result<(), StageError> {
        let now = monotonic_ns();
        let has_stopped = self.feedback.has_stopped(now);
        if self.clock == Clock::RealTime && (has_stopped || self.feedback.is_silent(now)) {
            self.core.fall_silent();
            self.inputs.trace.note(command_event::SILENT);
            if has_stopped && self.feedback.lose() {
                self.core.feedback_lost();
                self.inputs.trace.note(command_event::LOST);
            }
            self.send_neutral(now)?;
        }
        Ok(())
    }

    /// Real time: whether a sample says nothing of now any more. Samples that were written while the stage was stopped
    /// are read when it goes on.
    fn is_too_old(&self, sample: &Header) -> bool {
        self.clock == Clock::RealTime && self.feedback.is_too_old(monotonic_ns(), sample.acquired_ns)
    }

    /// Real time: latches where the clocks say nothing of the age of a sample. `acquired` is the time of the newest
    /// one, if one has come, ns.
    fn watch_clocks(&mut self, acquired: Option<u64>) -> Result<(), StageError> {
        if self.clock != Clock::RealTime {
            return Ok(());
        }
        if self.feedback.was_suspended(asleep_ns()) {
            self.core.latch(control_flag::CLOCK);
            self.inputs.trace.note(command_event::CLOCK);
        }
        let now = monotonic_ns();
        if acquired.is_some_and(|acquired| acquired > now) {
            self.core.latch(control_flag::CLOCK);
            self.inputs.trace.note(command_event::CLOCK);
            self.send_neutral(now)?;
        }
        Ok(())
    }

    fn send_neutral(&mut self, now: u64) -> Result<(), StageError> {
        let last = self.inputs.samples.last().map(|sample| sample.header).unwrap_or_default();
        let mut neutral = self.core.neutral(last.sequence);
        neutral.header.acquired_ns = last.acquired_ns.min(now);
        neutral.header.sent_ns = now;
        self.inputs.trace.note(command_event::NEUTRAL);
        neutral.inputs = self.inputs.trace.take();
        self.last = neutral;
        self.commands.send(&neutral)?;
        self.answer_stops();
        Ok(())
    }

    /// Takes in the snapshot for a sample. In lock-step it waits for the snapshot of the tick before. False when the
    /// loop is to stop.
    fn take_snapshot(&mut self, turn: &mut Turn, sample: &Header) -> Result<bool, StageError> {
        let snapshots = &mut self.inputs.snapshots;
        let Some(before) = sample.sequence.checked_sub(1).filter(|_| self.clock == Clock::LockStep) else {
            if self.clock == Clock::RealTime {
                snapshots.newest()?;
            }
            return Ok(true);
        };
        while !turn.wait_for(&Waiter::Yield, || snapshots.reach(before))? {
            if turn.stopping() {
                return Ok(false);
            }
            self.commands.greet();
        }
        Ok(true)
    }

    /// The command for the newest sample. It is neutral when too many commands in a row are late.
    fn command(&mut self, header: &Header) -> Result<Option<ValveCommand>, StageError> {
        self.take_stops();
        self.inputs.references.newest()?;
        let (core, Inputs { requests, trace, .. }) = (&mut self.core, &mut self.inputs);
        requests.each(|request| {
            trace.request(&request.header);
            core.ask(request);
        })?;
        let Some(sample) = self.inputs.samples.last() else { return Ok(None) };
        let (snapshot, reference) = (self.inputs.snapshots.last(), self.inputs.references.last());
        self.inputs.trace.messages(snapshot, reference);
        let mut command = self.core.update(sample, snapshot, reference);
        if self.clock == Clock::RealTime && self.deadlines.are_missed(monotonic_ns(), header.acquired_ns) {
            self.core.lose(control_flag::DEADLINE);
            self.inputs.trace.note(command_event::DEADLINE);
            command = self.core.neutral(header.sequence);
        }
        command.inputs = self.inputs.trace.take();
        Ok(Some(command))
    }
}

impl Stage for Process {
    fn turn(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        let arrival = self.await_sample(turn)?;
        self.watch_clocks(arrival.as_ref().map(|arrival| arrival.header.acquired_ns))?;
        let Some(Arrival { header, count, passed }) = arrival else {
            self.stop_at_once()?;
            self.watch_feedback()?;
            return Ok(Next::Waiting);
        };
        turn.pick_up(header.sent_ns);
        // Some of the passed ticks have come and were too old to be worked, the others never came.
        let unworked = count.saturating_sub(1).min(passed);
        let newest = header.sequence.saturating_sub(1);
        turn.skip(passed - unworked, newest, MissCause::LateInput);
        turn.skip(unworked, newest, MissCause::LateRelease);
        if self.is_too_old(&header) {
            turn.skip(1, header.sequence, MissCause::LateRelease);
            self.stop_at_once()?;
            self.watch_feedback()?;
            return Ok(if turn.is_last(header.sequence) { Next::Finished } else { Next::Waiting });
        }
        if !self.take_snapshot(turn, &header)? {
            return Ok(Next::Waiting);
        }
        let Some(mut command) = self.command(&header)? else { return Ok(Next::Waiting) };
        turn.finish(&mut command.header, header.sequence, header.acquired_ns, header.acquired_ns);
        self.commands.send(&command)?;
        self.last = command;
        self.answer_stops();
        turn.arrive(&command.header);
        self.feedback.renew(header.acquired_ns, self.last.header.sent_ns);
        Ok(if turn.is_last(header.sequence) { Next::Finished } else { Next::Worked })
    }

    fn greet(&self) {
        self.commands.greet();
    }

    fn stop(&mut self) -> Result<(), StageError> {
        self.send_neutral(monotonic_ns())
    }

    fn channels(&mut self, channels: &mut Channels<'_>) {
        channels.visit(&mut self.inputs.samples);
        channels.visit(&mut self.inputs.snapshots);
        channels.visit(&mut self.inputs.references);
        channels.visit(&mut self.inputs.requests);
    }

    fn tell(&mut self) -> Result<(), StageError> {
        let now = monotonic_ns();
        self.state.header = Header { sent_ns: now, ..self.last.header };
        self.state.teeth = self.last.teeth;
        let (sample, snapshot) = (self.inputs.samples.last(), self.inputs.snapshots.last());
        for (i, state) in self.state.axes.iter_mut().enumerate() {
            state.command = self.last.axes[i];
            if let Some(sample) = sample {
                state.sample = sample.axes[i];
            }
            if let Some(snapshot) = snapshot {
                let axis = &snapshot.axes[i];
                (state.has_model, state.model_faults) = (1, axis.faults);
                state.model_age_ns = now.saturating_sub(snapshot.header.acquired_ns);
                state.forgetting_factor = axis.forgetting_factor;
                state.h_step_sigma = axis.adaptive_errors.h_step.sigma();
            }
        }
        Ok(self.states.send(&self.state)?)
    }
}

/// The state of a machine before its first sample: what the machine file says.
pub fn at_rest(machine: &Machine) -> MachineState {
    let (mut state, period) = (MachineState::default(), machine.timing.period.as_secs_f64());
    for (state, axis) in state.axes.iter_mut().zip(&machine.axes) {
        state.set_name(&axis.name);
        state.gain_range = gains::range(axis, period);
    }
    state
}
