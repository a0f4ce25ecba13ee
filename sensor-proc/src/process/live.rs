//! The stage with the sources `sim`, `external` and `can`: readings come from plant-sim, or from whatever takes its
//! place.

use pipeline::{
    channel::{Board, Group, Reader},
    machine::{Machine, samples_of},
    message::EncoderReading,
    stage::{Channels, Clock, Next, Stage, StageError, Turn, Waiter, monotonic_ns},
};

use super::{
    output::Output,
    timer::{Phase, Timer},
};
use crate::acquisition::{Acquisition, Age};

/// Period at which the stage looks for the first reading, ns.
const FIRST_READING_POLL_NS: u64 = 1_000_000;

/// The stage with the sources `sim`, `external` and `can`.
pub struct Live {
    core: Acquisition,
    readings: Reader<EncoderReading>,
    board: Board,
    /// The newest reading says that the emergency stop is pressed.
    is_pressed: bool,
    output: Output,
    period_ns: u64,
    /// Readings that are older than this are all as old, ticks: nobody controls with them.
    most_age: f64,
    /// In real time only; set by the first reading.
    timer: Option<Timer>,
    phase: Phase,
}

impl Live {
    /// Joins the channels of `group`.
    ///
    /// # Errors
    /// A channel cannot be used.
    pub fn new(machine: &Machine, clock: Clock, group: &Group, board: Board) -> Result<Self, StageError> {
        Ok(Self {
            core: Acquisition::new(machine),
            readings: group.reader()?,
            board,
            is_pressed: false,
            output: Output::new(group, clock)?,
            period_ns: machine.timing.period.as_nanos() as u64,
            most_age: samples_of(machine.timing.feedback_timeout, machine.timing.period) as f64,
            timer: None,
            phase: Phase::default(),
        })
    }

    /// The newest reading, if one has come. An emergency stop in any of them goes onto the board, where it stays until
    /// control-proc has acted on it: a pulse between two ticks is not lost, and neither is one whose sample is.
    fn newest(&mut self) -> Result<bool, StageError> {
        let mut has_come = false;
        while let Some(reading) = self.readings.read()?.if_new() {
            has_come = true;
            let was_pressed = std::mem::replace(&mut self.is_pressed, reading.emergency_stop != 0);
            if self.is_pressed && !was_pressed {
                self.board.emergency_stop();
            }
        }
        Ok(has_come)
    }

    fn real_time(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        let Some(timer) = &mut self.timer else {
            // The first tick is released after the first reading.
            turn.sleep_until(monotonic_ns() + FIRST_READING_POLL_NS);
            if self.newest()? {
                self.timer = Some(Timer::new(self.period_ns, turn.options.first_tick));
            }
            return Ok(Next::Waiting);
        };
        let Some((tick, due_ns)) = timer.release(turn) else { return Ok(Next::Waiting) };
        let has_come = self.newest()?;
        let reading = self.readings.last().filter(|_| has_come);
        let acquired_ns = reading.map_or(due_ns, |reading| reading.header.acquired_ns);
        if let Some(reading) = reading {
            turn.pick_up(reading.header.sent_ns);
        }
        let age = |at: u64| (due_ns.saturating_sub(at) as f64 / self.period_ns as f64).min(self.most_age);
        let sent_ns = reading.map_or(acquired_ns, |reading| reading.header.sent_ns.max(acquired_ns));
        let age = Age { most: age(acquired_ns), least: age(sent_ns) };
        let mut sample = self.core.update_aged(tick, reading, age);
        self.output.send(turn, &mut sample, acquired_ns, due_ns)?;
        // Without a reading nothing has waited: it counts as sent when it was due.
        let waited_ns = due_ns.saturating_sub(sent_ns);
        if let (Some(by_ns), Some(timer)) = (self.phase.judge(waited_ns, self.period_ns), &mut self.timer) {
            timer.bring_forward(by_ns);
        }
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
        self.output.greet();
    }

    fn stop(&mut self) -> Result<(), StageError> {
        Ok(())
    }

    fn channels(&mut self, channels: &mut Channels<'_>) {
        channels.visit(&mut self.readings);
    }
}
