//! The stage in the place of `plant-sim`: valve commands to the plant on another computer, its readings to the group.
//!
//! It begins each round of the lock-step as `plant-sim` does: when the command and the snapshot that answer its last
//! reading have arrived, it asks the plant for the next one. Times and numbers of the message are given here.
//!
//! While no answer comes, the loop goes on turning, so that heartbeats and signals are not held up. The group waits,
//! and the time of the machine stands still.

use std::time::Duration;

use pipeline::{
    channel::{Board, Group, Publisher, Reader},
    machine::Machine,
    message::{CoefficientSnapshot, EncoderReading, ValveCommand},
    stage::{
        Channels, Next, RecorderGate, Stage, StageError, StageKind, StageOptions, Turn, Waiter, monotonic_ns,
        run as run_stage,
    },
};

use super::remote::Remote;

/// Longest wait for an answer before the loop looks at its heartbeat and its stop flag.
const SLICE: Duration = Duration::from_millis(10);
/// Name under which a recorder joins a group.
const RECORDER: &str = "record";

/// Runs the stage until the last tick of `options` or a signal. With `is_recorded` of the options it waits for the
/// recorder, if one is in the group.
///
/// # Errors
/// The plant refuses a request or answers no more, or a channel cannot be used.
pub fn run(remote: Remote, machine: &Machine, options: StageOptions) -> Result<(), StageError> {
    let setup = options.clone();
    run_stage(StageKind::PlantSim, machine, options, |group, board| Process::new(remote, setup, group, board))
}

struct Process {
    remote: Remote,
    readings: Publisher<EncoderReading>,
    commands: Reader<ValveCommand>,
    snapshots: Reader<CoefficientSnapshot>,
    /// The last reading sent: the tick whose command and snapshot the stage waits for.
    last: Option<EncoderReading>,
    recorder: RecorderGate,
}

impl Process {
    fn new(remote: Remote, mut options: StageOptions, group: &Group, board: Board) -> Result<Self, StageError> {
        options.is_recorded &= group.members().iter().any(|member| member.is_alive && member.name == RECORDER);
        Ok(Self {
            remote,
            readings: group.publisher()?,
            commands: group.reader()?,
            snapshots: group.reader()?,
            last: None,
            recorder: RecorderGate::new(board, &options),
        })
    }

    /// Asks for the next reading once the group has answered the last one.
    fn ask(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        let Some(last) = &self.last else {
            turn.pick_up(monotonic_ns());
            self.remote.ask(0, &ValveCommand::default());
            return Ok(Next::Worked);
        };
        let (tick, sent_ns) = (last.header.sequence, last.header.sent_ns);
        let (commands, snapshots) = (&mut self.commands, &mut self.snapshots);
        let answered = turn.wait_for(&Waiter::Yield, || Ok(commands.reach(tick)? && snapshots.reach(tick)?))?;
        if !answered || !self.recorder.admits(turn, tick + 1)? {
            return Ok(Next::Waiting);
        }
        turn.pick_up(self.commands.last().map_or(sent_ns, |command| command.header.sent_ns));
        if turn.is_last(tick) {
            return Ok(Next::Finished);
        }
        if let Some(command) = self.commands.last() {
            self.remote.ask(tick + 1, command);
        }
        Ok(Next::Worked)
    }
}

impl Stage for Process {
    fn turn(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        if !self.remote.is_asked() {
            return self.ask(turn);
        }
        let Some(mut reading) = self.remote.answer(SLICE).map_err(StageError::setup)? else {
            return Ok(Next::Waiting);
        };
        let sequence = reading.header.sequence;
        turn.finish(&mut reading.header, sequence, monotonic_ns(), 0);
        self.readings.send(&reading)?;
        self.last = Some(reading);
        Ok(Next::Worked)
    }

    fn greet(&self) {
        self.readings.greet();
    }

    fn stop(&mut self) -> Result<(), StageError> {
        let repeated = self.remote.end();
        if repeated > 0 {
            eprintln!("{repeated} requests to the plant were repeated");
        }
        Ok(())
    }

    fn channels(&mut self, channels: &mut Channels<'_>) {
        channels.visit(&mut self.commands);
        channels.visit(&mut self.snapshots);
    }
}
