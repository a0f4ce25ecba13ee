//! The stage: samples, snapshots, references and requests in, valve commands out.
//!
//! In real time a sample that is late by more than `feedback_timeout` makes the valves neutral, by a message that takes
//! nothing but copying, and latches them there; one that comes later than that is not acted on. So do commands that go out
//! more than a period after their samples were acquired, as many in a row as periods fit into `feedback_timeout`, two at
//! the least. A single one is late, and made for what is known by then. In lock-step the command of tick k is made with the snapshot of tick
//! k-1, which is waited for.

use pipeline::{
    channel::{Group, Publisher, Reader},
    machine::{Machine, samples_of},
    message::{
        CoefficientSnapshot, EncoderSample, Header, MachineState, MissCause, Reference, Request, ValveCommand,
        control_flag,
    },
    stage::{
        Channels, Clock, Next, Stage, StageError, StageKind, StageOptions, Turn, Waiter, monotonic_ns, run as run_stage,
    },
};

use crate::Controller;

/// Late commands in a row that latch the axes at the least: one is the scheduler's, two are a trend.
const LEAST_LATE: usize = 2;

/// Runs the stage until its last tick or a signal; the last command is neutral.
///
/// # Errors
/// A trajectory cannot be used, or a channel cannot.
pub fn run(machine: &Machine, options: StageOptions) -> Result<(), StageError> {
    let setup = options.clone();
    run_stage(StageKind::ControlProc, machine, options, |group| Process::new(machine, &setup, group))
}

struct Process {
    core: Controller,
    samples: Reader<EncoderSample>,
    snapshots: Reader<CoefficientSnapshot>,
    references: Reader<Reference>,
    requests: Reader<Request>,
    commands: Publisher<ValveCommand>,
    states: Publisher<MachineState>,
    /// Filled in at every heartbeat; the names of the axes stay.
    state: MachineState,
    /// What was sent last.
    last: ValveCommand,
    waiter: Waiter,
    clock: Clock,
    feedback_timeout_ns: u64,
    /// When the last sample was acquired; none before the first.
    last_sample_ns: Option<u64>,
    lost: bool,
    deadlines: Deadlines,
}

/// Commands that are late.
#[derive(Debug, Clone, PartialEq)]
struct Deadlines {
    period_ns: u64,
    limit: usize,
    late_in_a_row: usize,
}

impl Deadlines {
    fn new(machine: &Machine) -> Self {
        let timing = &machine.timing;
        Self {
            period_ns: timing.period.as_nanos() as u64,
            limit: samples_of(timing.feedback_timeout, timing.period).max(LEAST_LATE),
            late_in_a_row: 0,
        }
    }

    /// Whether too many in a row are late, with one sent at `now` for a sample that was acquired at `acquired`, ns.
    fn are_missed(&mut self, now: u64, acquired: u64) -> bool {
        let is_late = now.saturating_sub(acquired) > self.period_ns;
        self.late_in_a_row = if is_late { self.late_in_a_row.saturating_add(1) } else { 0 };
        self.late_in_a_row >= self.limit
    }
}

impl Process {
    fn new(machine: &Machine, options: &StageOptions, group: &Group) -> Result<Self, StageError> {
        let mut core = Controller::new(machine).map_err(StageError::setup)?;
        if options.arm {
            core.arm();
        }
        Ok(Self {
            core,
            samples: group.reader()?,
            snapshots: group.reader()?,
            references: group.reader()?,
            requests: group.reader()?,
            commands: group.publisher()?,
            states: group.publisher()?,
            state: named(machine),
            last: ValveCommand::default(),
            waiter: Waiter::new::<EncoderSample>(group, machine, StageKind::ControlProc, options.clock)?,
            clock: options.clock,
            feedback_timeout_ns: machine.timing.feedback_timeout.as_nanos() as u64,
            last_sample_ns: None,
            lost: false,
            deadlines: Deadlines::new(machine),
        })
    }

    /// Real time, no sample came: neutral once the last one is too old, and again at every look after.
    fn watch_feedback(&mut self) -> Result<(), StageError> {
        let now = monotonic_ns();
        let too_old = self.last_sample_ns.is_some_and(|last| now.saturating_sub(last) > self.feedback_timeout_ns);
        if self.clock == Clock::RealTime && too_old {
            if !self.lost {
                self.core.feedback_lost();
                self.lost = true;
            }
            self.send_neutral(now)?;
        }
        Ok(())
    }

    /// Real time: whether a sample is so old that it says nothing of now, as those do that were written before a stage was
    /// stopped and are read after it goes on.
    fn is_too_old(&self, sample: &Header) -> bool {
        self.clock == Clock::RealTime && monotonic_ns().saturating_sub(sample.acquired_ns) > self.feedback_timeout_ns
    }

    fn send_neutral(&mut self, now: u64) -> Result<(), StageError> {
        let last = self.samples.last().map(|sample| sample.header).unwrap_or_default();
        let mut neutral = self.core.neutral(last.sequence);
        neutral.header.acquired_ns = last.acquired_ns;
        neutral.header.sent_ns = now;
        self.last = neutral;
        Ok(self.commands.send(&neutral)?)
    }

    /// Lock-step: the snapshot of the tick before is on its way or here. False when the loop is to stop.
    fn await_snapshot(&mut self, turn: &mut Turn, before: u64) -> Result<bool, StageError> {
        let snapshots = &mut self.snapshots;
        while !turn.wait_for(&Waiter::Yield, || snapshots.reach(before))? {
            if turn.stopping() {
                return Ok(false);
            }
            self.commands.greet();
        }
        Ok(true)
    }
}

impl Stage for Process {
    fn turn(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        let (samples, clock) = (&mut self.samples, self.clock);
        let before = samples.last().map(|sample| sample.header.sequence);
        let mut come = 0;
        turn.wait_for(&self.waiter, || {
            // Only the newest sample is worth a command; the gap tells the core what it missed.
            while samples.read()?.if_new().is_some() {
                come += 1;
                if clock == Clock::LockStep {
                    break;
                }
            }
            Ok(come > 0)
        })?;
        if come == 0 {
            self.watch_feedback()?;
            return Ok(Next::Waiting);
        }
        let Some(header) = self.samples.last().map(|sample| sample.header) else { return Ok(Next::Waiting) };
        turn.pick_up(header.sent_ns);
        // Of the ticks since the last one some have come and were too old to be worked, the others never came.
        let passed = before.map_or(0, |before| header.sequence.saturating_sub(before + 1));
        let unworked = u64::saturating_sub(come, 1).min(passed);
        let newest = header.sequence.saturating_sub(1);
        turn.skip(passed - unworked, newest, MissCause::LateInput);
        turn.skip(unworked, newest, MissCause::LateRelease);
        if self.is_too_old(&header) {
            self.watch_feedback()?;
            return Ok(if turn.is_last(header.sequence) { Next::Finished } else { Next::Waiting });
        }
        match clock {
            Clock::RealTime => {
                self.snapshots.newest()?;
            }
            Clock::LockStep => {
                if let Some(before) = header.sequence.checked_sub(1)
                    && !self.await_snapshot(turn, before)?
                {
                    return Ok(Next::Waiting);
                }
            }
        }
        self.references.newest()?;
        if let Some(request) = self.requests.newest()?.if_new() {
            self.core.ask(request);
        }
        let Some(sample) = self.samples.last() else { return Ok(Next::Waiting) };
        let mut command = self.core.update(sample, self.snapshots.last(), self.references.last());
        if clock == Clock::RealTime && self.deadlines.are_missed(monotonic_ns(), header.acquired_ns) {
            self.core.latch(control_flag::DEADLINE);
            command = self.core.neutral(header.sequence);
        }
        turn.finish(&mut command.header, header.sequence, header.acquired_ns, header.acquired_ns);
        self.commands.send(&command)?;
        self.last = command;
        turn.arrive(&command.header);
        self.last_sample_ns = Some(header.acquired_ns);
        self.lost = false;
        Ok(if turn.is_last(header.sequence) { Next::Finished } else { Next::Worked })
    }

    fn greet(&self) {
        self.commands.greet();
    }

    fn stop(&mut self) -> Result<(), StageError> {
        self.send_neutral(monotonic_ns())
    }

    fn channels(&mut self, channels: &mut Channels<'_>) {
        channels.visit(&mut self.samples);
        channels.visit(&mut self.snapshots);
        channels.visit(&mut self.references);
        channels.visit(&mut self.requests);
    }

    fn tell(&mut self) -> Result<(), StageError> {
        let now = monotonic_ns();
        self.state.header = Header { sent_ns: now, ..self.last.header };
        let (sample, snapshot) = (self.samples.last(), self.snapshots.last());
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

/// The state of a machine of which nothing is known but the names of its axes.
fn named(machine: &Machine) -> MachineState {
    let mut state = MachineState::default();
    state.axes.iter_mut().zip(&machine.axes).for_each(|(state, axis)| state.set_name(&axis.name));
    state
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Commands of which these were late, in ms: which of them are one too many.
    fn missed(late: &[u64], feedback_timeout: u64) -> Vec<bool> {
        let mut machine = crate::tests::machine(1);
        machine.timing.feedback_timeout = Duration::from_millis(feedback_timeout);
        let mut deadlines = Deadlines::new(&machine);
        let acquired = 1_000_000_000;
        late.iter().map(|late| deadlines.are_missed(acquired + late * 1_000_000, acquired)).collect()
    }

    #[test]
    fn as_many_late_commands_in_a_row_as_fit_into_the_time_out_are_too_many() {
        assert_eq!(missed(&[11, 50, 10, 11, 11, 11, 0], 30), [false, false, false, false, false, true, false]);
        assert_eq!(missed(&[10, 10, 10, 10], 30), [false; 4]);
        // Two at the least.
        assert_eq!(missed(&[11, 9, 11, 11], 1), [false, false, false, true]);
        assert_eq!(missed(&[11; 7], 60), [false, false, false, false, false, true, true]);
    }
}
