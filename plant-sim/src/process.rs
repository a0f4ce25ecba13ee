//! The stage: valve commands in, encoder readings out.
//!
//! In real time the stage has a timer of its own, as an encoder with a cyclic timer has. Every millisecond it takes the
//! newest command, advances the plant to the present and sends a reading. In lock-step the stage begins each round:
//! when the command and the snapshot that answer its last reading have arrived, it advances the plant by one period and
//! sends the next reading.

use std::time::Duration;

use pipeline::{
    channel::{Board, Group, Publisher, Reader},
    machine::Machine,
    message::{CoefficientSnapshot, EncoderReading, ValveCommand},
    stage::{
        Channels, Clock, Next, RecorderGate, Stage, StageError, StageKind, StageOptions, Turn, Waiter, monotonic_ns,
        run as run_stage,
    },
};

use crate::PlantSim;

/// Time between two readings in real time: that of a fast cable encoder.
const READING_PERIOD: Duration = Duration::from_millis(1);

/// Runs the stage until the last tick of `options` or a signal.
///
/// # Errors
/// The machine cannot be simulated ([`PlantError`](crate::PlantError)), or a channel cannot be used.
pub fn run(machine: &Machine, options: StageOptions) -> Result<(), StageError> {
    let setup = options.clone();
    run_stage(StageKind::PlantSim, machine, options, |group, board| Process::new(machine, &setup, group, board))
}

struct Process {
    plant: PlantSim,
    period: Duration,
    readings: Publisher<EncoderReading>,
    commands: Reader<ValveCommand>,
    /// In lock-step only.
    snapshots: Option<Reader<CoefficientSnapshot>>,
    /// The last reading sent. In lock-step its number is the tick whose command and snapshot the stage waits for.
    last: Option<EncoderReading>,
    recorder: RecorderGate,
    next_release_ns: u64,
}

impl Process {
    fn new(machine: &Machine, options: &StageOptions, group: &Group, board: Board) -> Result<Self, StageError> {
        let lock_step = options.clock == Clock::LockStep;
        Ok(Self {
            plant: PlantSim::new(machine, options.seed).map_err(StageError::setup)?,
            period: machine.timing.period,
            readings: group.publisher()?,
            commands: group.reader()?,
            snapshots: if lock_step { Some(group.reader()?) } else { None },
            last: None,
            recorder: RecorderGate::new(board, options),
            next_release_ns: monotonic_ns(),
        })
    }

    fn send_reading(&mut self, turn: &mut Turn, due_ns: u64) -> Result<(), StageError> {
        let mut reading = self.plant.read();
        let sequence = reading.header.sequence;
        turn.finish(&mut reading.header, sequence, monotonic_ns(), due_ns);
        self.readings.send(&reading)?;
        self.last = Some(reading);
        Ok(())
    }

    fn real_time(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        if !turn.sleep_until(self.next_release_ns) {
            return Ok(Next::Waiting);
        }
        let intended = self.next_release_ns;
        let now = turn.release(intended);
        // The plant's time must not fall behind, so a late release makes up for all periods that have passed.
        let mut due = 0;
        while self.next_release_ns <= now {
            self.next_release_ns += READING_PERIOD.as_nanos() as u64;
            due += 1;
        }
        if self.commands.newest()?.if_new().is_some()
            && let Some(command) = self.commands.last()
        {
            self.plant.command(command);
        }
        self.plant.advance(READING_PERIOD * due);
        self.send_reading(turn, intended)?;
        let ended = self.commands.last().is_some_and(|command| turn.is_last(command.header.sequence));
        Ok(if ended { Next::Finished } else { Next::Worked })
    }

    fn lock_step(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        let Some(last) = &self.last else {
            turn.pick_up(monotonic_ns());
            self.send_reading(turn, 0)?;
            return Ok(Next::Worked);
        };
        let (tick, sent_ns) = (last.header.sequence, last.header.sent_ns);
        let (commands, snapshots) = (&mut self.commands, &mut self.snapshots);
        let answered = turn.wait_for(&Waiter::Yield, || {
            let command = commands.reach(tick)?;
            Ok(command && snapshots.as_mut().map_or(Ok(true), |snapshots| snapshots.reach(tick))?)
        })?;
        if !answered || !self.recorder.admits(turn, tick + 1)? {
            return Ok(Next::Waiting);
        }
        turn.pick_up(self.commands.last().map_or(sent_ns, |command| command.header.sent_ns));
        if turn.is_last(tick) {
            return Ok(Next::Finished);
        }
        if let Some(command) = self.commands.last() {
            self.plant.command(command);
        }
        self.plant.advance(self.period);
        self.send_reading(turn, 0)?;
        Ok(Next::Worked)
    }
}

impl Stage for Process {
    fn turn(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        match turn.options.clock {
            Clock::RealTime => self.real_time(turn),
            Clock::LockStep => self.lock_step(turn),
        }
    }

    fn greet(&self) {
        self.readings.greet();
    }

    fn stop(&mut self) -> Result<(), StageError> {
        Ok(())
    }

    fn channels(&mut self, channels: &mut Channels<'_>) {
        channels.visit(&mut self.commands);
        self.snapshots.iter_mut().for_each(|snapshots| channels.visit(snapshots));
    }
}
