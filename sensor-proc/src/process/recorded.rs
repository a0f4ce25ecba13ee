//! The stage with the source `replay`: a recording takes the place of encoders and controller.

use pipeline::{
    channel::{Board, Group, Publisher, Reader},
    machine::Machine,
    message::{CoefficientSnapshot, ValveCommand},
    stage::{Channels, Clock, Next, RecorderGate, Stage, StageError, StageOptions, Turn, Waiter, monotonic_ns},
};

use super::{output::Output, timer::Timer};
use crate::replay::Replay;

/// The stage with the source `replay`.
pub struct Recorded {
    core: Replay,
    output: Output,
    commands: Publisher<ValveCommand>,
    /// In lock-step only: the next row is sent after ident-proc has answered the last one.
    snapshots: Option<Reader<CoefficientSnapshot>>,
    recorder: RecorderGate,
    timer: Option<Timer>,
    period_ns: u64,
    next: u64,
}

impl Recorded {
    /// Joins the channels of `group`. The first row sent is that with the number of the first tick of `options`.
    ///
    /// # Errors
    /// A channel cannot be used.
    pub fn new(
        core: Replay,
        machine: &Machine,
        options: &StageOptions,
        group: &Group,
        board: Board,
    ) -> Result<Self, StageError> {
        let clock = options.clock;
        Ok(Self {
            core,
            output: Output::new(group, clock)?,
            commands: group.publisher()?,
            snapshots: if clock == Clock::LockStep { Some(group.reader()?) } else { None },
            recorder: RecorderGate::new(board, options),
            timer: None,
            period_ns: machine.timing.period.as_nanos() as u64,
            next: options.first_tick,
        })
    }

    /// Waits until the next row is due and returns the time at which it was due; `None` while it is not due.
    fn release(&mut self, turn: &mut Turn) -> Result<Option<u64>, StageError> {
        match &mut self.snapshots {
            Some(snapshots) => {
                if let Some(last) = self.next.checked_sub(1)
                    && !turn.wait_for(&Waiter::Yield, || snapshots.reach(last))?
                {
                    return Ok(None);
                }
                if !self.recorder.admits(turn, self.next)? {
                    return Ok(None);
                }
                turn.pick_up(snapshots.last().map_or_else(monotonic_ns, |snapshot| snapshot.header.sent_ns));
                Ok(Some(monotonic_ns()))
            }
            None => {
                let timer = self.timer.get_or_insert_with(|| Timer::new(self.period_ns, self.next));
                // A late row is sent late and never left out, because a recording has no gaps.
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
        self.output.greet();
        self.commands.greet();
    }

    fn stop(&mut self) -> Result<(), StageError> {
        Ok(())
    }

    fn channels(&mut self, channels: &mut Channels<'_>) {
        self.snapshots.iter_mut().for_each(|snapshots| channels.visit(snapshots));
    }
}
