//! The stage: readings (or a recording) in, samples out.

use std::path::Path;

use pipeline::{
    channel::{Group, Notifier, Publisher, Reader},
    machine::{Machine, Source},
    message::{CoefficientSnapshot, EncoderReading, EncoderSample, MissCause, ValveCommand},
    stage::{
        Channels, Clock, Next, Stage, StageError, StageKind, StageOptions, Turn, Waiter, monotonic_ns, run as run_stage,
    },
};

use crate::source::{Acquisition, Replay, is_implausible};

/// How often the first reading is looked for, ns.
const FIRST_READING_POLL_NS: u64 = 1_000_000;

/// Runs the stage until its last tick, the end of the recording, or a signal.
///
/// # Errors
/// The recording cannot be used, or a channel cannot.
pub fn run(machine: &Machine, options: StageOptions) -> Result<(), StageError> {
    let (clock, first_tick) = (options.clock, options.first_tick);
    match &machine.source {
        Source::Sim => run_stage(StageKind::SensorProc, machine, options, |group| Live::new(machine, clock, group)),
        Source::Replay(file) => run_stage(StageKind::SensorProc, machine, options, |group| {
            Recorded::new(machine, file, clock, first_tick, group)
        }),
    }
}

/// The way out: samples, and the notifier that wakes the stages that sleep.
struct Output {
    samples: Publisher<EncoderSample>,
    /// Real time only.
    notifier: Option<Notifier>,
}

impl Output {
    fn new(group: &Group, clock: Clock) -> Result<Self, StageError> {
        let notifier = if clock == Clock::RealTime { Some(group.notifier::<EncoderSample>()?) } else { None };
        Ok(Self { samples: group.publisher()?, notifier })
    }

    fn send(
        &self,
        turn: &mut Turn,
        sample: &mut EncoderSample,
        acquired_ns: u64,
        due_ns: u64,
    ) -> Result<(), StageError> {
        if is_implausible(sample) {
            turn.implausible();
        }
        let sequence = sample.header.sequence;
        turn.finish(&mut sample.header, sequence, acquired_ns, due_ns);
        self.samples.send(sample)?;
        if let Some(notifier) = &self.notifier {
            notifier.notify()?;
        }
        Ok(())
    }
}

/// The release of ticks by absolute timers: tick k is due at start + (k - first) periods.
struct Timer {
    start_ns: u64,
    period_ns: u64,
    first: u64,
    next: u64,
}

impl Timer {
    /// Tick `first` is due one period from now.
    fn new(period_ns: u64, first: u64) -> Self {
        Self { start_ns: monotonic_ns() + period_ns, period_ns, first, next: first }
    }

    fn due_ns(&self, tick: u64) -> u64 {
        self.start_ns + (tick - self.first) * self.period_ns
    }

    /// Sleeps until the next tick; returns its number and when it was due, or `None` when a signal came first. Ticks
    /// that have passed meanwhile are counted, and their numbers left out: whoever reads the samples sees the gap.
    fn release(&mut self, turn: &mut Turn) -> Option<(u64, u64)> {
        let due_ns = self.due_ns(self.next);
        if !turn.sleep_until(due_ns) {
            return None;
        }
        let now = turn.release(due_ns);
        let passed = now.saturating_sub(due_ns) / self.period_ns;
        let tick = self.next + passed;
        turn.skip(passed, tick.saturating_sub(1), MissCause::LateRelease);
        self.next = tick + 1;
        Some((tick, self.due_ns(tick)))
    }
}

/// Source `sim`: readings from plant-sim, or from any program in its place.
struct Live {
    core: Acquisition,
    readings: Reader<EncoderReading>,
    output: Output,
    period_ns: u64,
    /// Real time only; set by the first reading.
    timer: Option<Timer>,
}

impl Live {
    fn new(machine: &Machine, clock: Clock, group: &Group) -> Result<Self, StageError> {
        Ok(Self {
            core: Acquisition::new(machine),
            readings: group.reader()?,
            output: Output::new(group, clock)?,
            period_ns: machine.timing.period.as_nanos() as u64,
            timer: None,
        })
    }

    fn real_time(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        let Some(timer) = &mut self.timer else {
            // The ticks begin when the encoders do.
            turn.sleep_until(monotonic_ns() + FIRST_READING_POLL_NS);
            if self.readings.newest()?.if_new().is_some() {
                self.timer = Some(Timer::new(self.period_ns, turn.options.first_tick));
            }
            return Ok(Next::Waiting);
        };
        let Some((tick, due_ns)) = timer.release(turn) else { return Ok(Next::Waiting) };
        let reading = self.readings.newest()?.if_new();
        let acquired_ns = reading.map_or(due_ns, |reading| reading.header.acquired_ns);
        if let Some(reading) = reading {
            turn.pick_up(reading.header.sent_ns);
        }
        let mut sample = self.core.update(tick, reading);
        self.output.send(turn, &mut sample, acquired_ns, due_ns)?;
        Ok(if turn.is_last(tick) { Next::Finished } else { Next::Worked })
    }

    fn lock_step(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        let readings = &mut self.readings;
        if !turn.wait_for(&Waiter::Yield, || Ok(readings.read()?.if_new().is_some()))? {
            return Ok(Next::Waiting);
        }
        let Some(reading) = self.readings.last() else { return Ok(Next::Waiting) };
        let header = reading.header;
        turn.pick_up(header.sent_ns);
        let mut sample = self.core.update(header.sequence, Some(reading));
        self.output.send(turn, &mut sample, header.acquired_ns, header.acquired_ns)?;
        Ok(if turn.is_last(header.sequence) { Next::Finished } else { Next::Worked })
    }
}

impl Stage for Live {
    fn turn(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        match turn.options.clock {
            Clock::RealTime => self.real_time(turn),
            Clock::LockStep => self.lock_step(turn),
        }
    }

    fn greet(&self) {
        self.output.samples.greet();
    }

    fn stop(&mut self) -> Result<(), StageError> {
        Ok(())
    }

    fn channels(&mut self, channels: &mut Channels<'_>) {
        channels.visit(&mut self.readings);
    }
}

/// Source `replay`: a recording in the place of encoders and controller.
struct Recorded {
    core: Replay,
    output: Output,
    commands: Publisher<ValveCommand>,
    /// Lock-step only: the next row goes out when the last has been learned from.
    snapshots: Option<Reader<CoefficientSnapshot>>,
    timer: Option<Timer>,
    period_ns: u64,
    next: u64,
}

impl Recorded {
    fn new(machine: &Machine, file: &Path, clock: Clock, first_tick: u64, group: &Group) -> Result<Self, StageError> {
        Ok(Self {
            core: Replay::new(machine, file).map_err(|error| StageError::Setup(error.to_string()))?,
            output: Output::new(group, clock)?,
            commands: group.publisher()?,
            snapshots: if clock == Clock::LockStep { Some(group.reader()?) } else { None },
            timer: None,
            period_ns: machine.timing.period.as_nanos() as u64,
            next: first_tick,
        })
    }

    /// Waits until the next row is due; `None` when it is not yet.
    fn release(&mut self, turn: &mut Turn) -> Result<Option<u64>, StageError> {
        match &mut self.snapshots {
            Some(snapshots) => {
                if let Some(last) = self.next.checked_sub(1)
                    && !turn.wait_for(&Waiter::Yield, || snapshots.reach(last))?
                {
                    return Ok(None);
                }
                turn.pick_up(snapshots.last().map_or_else(monotonic_ns, |snapshot| snapshot.header.sent_ns));
                Ok(Some(monotonic_ns()))
            }
            None => {
                let timer = self.timer.get_or_insert_with(|| Timer::new(self.period_ns, self.next));
                // A late row is sent late: a recording has no gaps of its own.
                let due_ns = timer.due_ns(self.next);
                if !turn.sleep_until(due_ns) {
                    return Ok(None);
                }
                turn.release(due_ns);
                Ok(Some(due_ns))
            }
        }
    }
}

impl Stage for Recorded {
    fn turn(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        let Some(due_ns) = self.release(turn)? else { return Ok(Next::Waiting) };
        let ended = self.next.checked_sub(1).is_some_and(|last| turn.is_last(last));
        let Some((mut sample, mut command)) = self.core.update(self.next).filter(|_| !ended) else {
            return Ok(Next::Finished);
        };
        let now = monotonic_ns();
        self.output.send(turn, &mut sample, now, due_ns)?;
        command.header.acquired_ns = now;
        command.header.sent_ns = monotonic_ns();
        self.commands.send(&command)?;
        self.next += 1;
        Ok(Next::Worked)
    }

    fn greet(&self) {
        self.output.samples.greet();
        self.commands.greet();
    }

    fn stop(&mut self) -> Result<(), StageError> {
        Ok(())
    }

    fn channels(&mut self, channels: &mut Channels<'_>) {
        self.snapshots.iter_mut().for_each(|snapshots| channels.visit(snapshots));
    }
}
