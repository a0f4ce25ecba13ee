//! The stage `ident-proc`: reads samples and commands from their channels and publishes coefficient snapshots.

use pipeline::{
    channel::{Group, Publisher, Reader},
    machine::Machine,
    message::{CoefficientSnapshot, EncoderSample, ValveCommand},
    stage::{Channels, Clock, Next, Stage, StageError, StageKind, StageOptions, Turn, Waiter, run as run_stage},
};

use crate::Identifiers;

/// Runs the stage until its last tick or a signal.
///
/// # Errors
/// When a channel cannot be opened or used.
pub fn run(machine: &Machine, options: StageOptions) -> Result<(), StageError> {
    let clock = options.clock;
    run_stage(StageKind::IdentProc, machine, options, |group, _| Process::new(machine, clock, group))
}

struct Process {
    core: Identifiers,
    samples: Reader<EncoderSample>,
    commands: Reader<ValveCommand>,
    snapshots: Publisher<CoefficientSnapshot>,
    snapshot: CoefficientSnapshot,
    waiter: Waiter,
}

impl Process {
    fn new(machine: &Machine, clock: Clock, group: &Group) -> Result<Self, StageError> {
        Ok(Self {
            core: Identifiers::new(machine),
            samples: group.reader()?,
            commands: group.reader()?,
            snapshots: group.publisher()?,
            snapshot: CoefficientSnapshot::default(),
            waiter: Waiter::new::<EncoderSample>(group, machine, StageKind::IdentProc, clock)?,
        })
    }
}

impl Stage for Process {
    fn turn(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        let samples = &mut self.samples;
        if !turn.wait_for(&self.waiter, || Ok(samples.read()?.if_new().is_some()))? {
            return Ok(Next::Waiting);
        }
        let Some(sample) = self.samples.last() else { return Ok(Next::Waiting) };
        let tick = sample.header.sequence;
        turn.pick_up(sample.header.sent_ns);
        if let Some(before) = tick.checked_sub(1) {
            // In real time the command of the last tick has arrived, or there is none. In lock-step it may still come.
            let commands = &mut self.commands;
            match turn.options.clock {
                Clock::RealTime => {
                    commands.reach(before)?;
                }
                Clock::LockStep => {
                    while !turn.wait_for(&Waiter::Yield, || commands.reach(before))? {
                        if turn.stopping() {
                            return Ok(Next::Waiting);
                        }
                        self.snapshots.greet();
                    }
                }
            }
        }
        self.core.update(sample, self.commands.last(), &mut self.snapshot);
        turn.finish(&mut self.snapshot.header, tick, sample.header.acquired_ns, sample.header.acquired_ns);
        self.snapshots.send(&self.snapshot)?;
        Ok(if turn.is_last(tick) { Next::Finished } else { Next::Worked })
    }

    fn greet(&self) {
        self.snapshots.greet();
    }

    fn stop(&mut self) -> Result<(), StageError> {
        Ok(())
    }

    fn channels(&mut self, channels: &mut Channels<'_>) {
        channels.visit(&mut self.samples);
        channels.visit(&mut self.commands);
    }
}
