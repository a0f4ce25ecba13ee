//! The readings of a recording, with the requests, references and stops of its commands, in the place of the plant.
//!
//! ```text
//! requests, references, stops that a command was made with --> reading of its sample --> the living stages
//! ```
//!
//! What came before a command is sent before the reading of its sample. In lock-step each reading that a sample was
//! made of is a tick; in real time all readings come at the times that they were acquired at, and those of a run in
//! lock-step one period after the other. Everything is read from the file before the first tick.
//!
//! Trap: ticks are numbered from 0 again, as the stages begin anew.

use std::{
    collections::{HashMap, VecDeque},
    path::Path,
};

use pipeline::{
    MAX_AXES,
    channel::{Board, Group, Publisher, Reader},
    machine::Machine,
    message::{
        AxisMode, CoefficientSnapshot, EncoderReading, EncoderSample, Message, Reference, Request, ValveCommand,
        command_event,
    },
    stage::{
        Channels, Clock, Next, RecorderGate, Stage, StageError, StageKind, StageOptions, Turn, Waiter, monotonic_ns,
        run as run_stage,
    },
};

use super::feed::Queue;
use crate::{
    failure::Failure,
    recording::{lock_step_period, reading::Reading},
};

/// Most readings of a recording: all of them are in memory. An hour of encoders with 1 kHz.
const MOST: usize = 4_000_000;

/// A reading, and what comes before it.
#[derive(Debug, Default)]
struct Step {
    reading: EncoderReading,
    /// Time since the first reading, ns.
    at_ns: u64,
    requests: Vec<Request>,
    references: Vec<Reference>,
    /// Axes that were stopped, the first one lowest.
    stopped: u32,
    emergency: bool,
}

/// All that a recording gives to living stages.
pub struct Script {
    steps: VecDeque<Step>,
    /// Axes were armed at the first command.
    pub is_armed: bool,
}

/// Time between two looks for the end once all readings were sent, ns.
const REST_NS: u64 = 1_000_000;

impl Script {
    /// Reads a whole recording. `lock_step`: only the readings of samples.
    ///
    /// # Errors
    /// The file cannot be read, has no reading, or more than there is room for.
    pub fn read(file: &Path, lock_step: bool) -> Result<Self, Failure> {
        let mut reading = Reading::open(file)?;
        let mut all = Messages::default();
        while let Some(message) = reading.next()? {
            match message.channel.name.as_str() {
                EncoderReading::CHANNEL => all.readings.push(message, MOST)?,
                EncoderSample::CHANNEL => all.samples.push(message, MOST)?,
                ValveCommand::CHANNEL => all.commands.push(message, MOST)?,
                Reference::CHANNEL => all.references.push(message, MOST)?,
                Request::CHANNEL => all.requests.push(message, MOST)?,
                _ => {}
            }
        }
        if let Some(damage) = reading.damage() {
            eprintln!("warning: {}: read as far as it goes: byte {}: {}", file.display(), damage.byte, damage.what);
        }
        let script = all.script(lock_step, lock_step_period(reading.facts()));
        if script.steps.is_empty() {
            return Err(Failure::usage(format!("{}: found no reading of encoders", file.display())));
        }
        Ok(script)
    }

    /// Number of readings.
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// Time from the first reading to the last one, ns.
    pub fn span_ns(&self) -> u64 {
        self.steps.back().map_or(0, |step| step.at_ns)
    }
}

/// The messages of a recording that a script is made of.
#[derive(Default)]
struct Messages {
    readings: Queue<EncoderReading>,
    samples: Queue<EncoderSample>,
    commands: Queue<ValveCommand>,
    references: Queue<Reference>,
    requests: Queue<Request>,
}

impl Messages {
    /// `period`: that of a run in lock-step, whose readings were acquired as fast as they could be, s.
    fn script(mut self, lock_step: bool, period: Option<f64>) -> Script {
        let acquired = |header: &pipeline::message::Header| header.acquired_ns;
        let of_samples: HashMap<u64, u64> = self
            .samples
            .waiting()
            .iter()
            .map(|typed| &typed.message.header)
            .map(|header| (acquired(header), header.sequence))
            .collect();
        let is_used = |reading: &EncoderReading| !lock_step || of_samples.contains_key(&reading.header.acquired_ns);
        let mut steps: VecDeque<Step> = VecDeque::new();
        let mut first_ns = None;
        while let Some(typed) = self.readings.pop() {
            let reading = typed.message;
            if is_used(&reading) {
                let since =
                    reading.header.acquired_ns.saturating_sub(*first_ns.get_or_insert(reading.header.acquired_ns));
                let at_ns = period.map_or(since, |period| (period * 1e9 * steps.len() as f64) as u64);
                steps.push_back(Step { reading, at_ns, ..Step::default() });
            }
        }
        let is_armed = self
            .commands
            .peek()
            .is_some_and(|command| command.axes.iter().any(|axis| axis.operation != AxisMode::Off as u32));
        self.assign(&mut steps);
        Script { steps, is_armed }
    }

    /// Gives what each command was made with to the reading of its sample, or of the next one that there is.
    fn assign(&mut self, steps: &mut VecDeque<Step>) {
        let first = self.samples.peek().map_or(0, |sample| sample.header.sequence);
        let mut at = 0;
        let mut taken = self.commands.peek().map_or(0, |command| command.inputs.requests.saturating_sub(1));
        while let Some(command) = self.commands.pop() {
            let command = command.message;
            let time = command.header.acquired_ns;
            while at + 1 < steps.len() && steps[at].reading.header.acquired_ns < time {
                at += 1;
            }
            let Some(step) = steps.get_mut(at) else { return };
            let inputs = &command.inputs;
            while taken < inputs.requests {
                taken += 1;
                if let Some(mut request) = self.requests.pop() {
                    request.message.header.sequence = request.message.header.sequence.saturating_sub(first);
                    step.requests.push(request.message);
                }
            }
            let is_it = |reference: &Reference| {
                (reference.header.session, reference.header.number)
                    == (inputs.reference_session, inputs.reference_number)
            };
            if self.references.waiting().iter().any(|typed| is_it(&typed.message)) {
                while let Some(mut reference) = self.references.pop() {
                    let is_last = is_it(&reference.message);
                    reference.message.header.sequence = reference.message.header.sequence.saturating_sub(first);
                    step.references.push(reference.message);
                    if is_last {
                        break;
                    }
                }
            }
            step.stopped |= inputs.events & command_event::STOPPED;
            step.emergency |= inputs.events & command_event::EMERGENCY_STOP != 0;
        }
    }
}

/// Runs the stage: the script of `file` in the place of plant-sim.
///
/// # Errors
/// The recording cannot be read, or a channel cannot be used.
pub fn run(machine: &Machine, file: &Path, options: StageOptions) -> Result<(), StageError> {
    let setup = options.clone();
    let lock_step = options.clock == Clock::LockStep;
    run_stage(StageKind::PlantSim, machine, options, |group, board| {
        let script = Script::read(file, lock_step).map_err(|failure| StageError::Setup(failure.to_string().into()))?;
        Recorded::new(script, &setup, group, board)
    })
}

struct Recorded {
    steps: VecDeque<Step>,
    /// Number of the next reading.
    next: u64,
    readings: Publisher<EncoderReading>,
    requests: Publisher<Request>,
    references: Publisher<Reference>,
    commands: Reader<ValveCommand>,
    /// In lock-step only.
    snapshots: Option<Reader<CoefficientSnapshot>>,
    board: Board,
    recorder: RecorderGate,
    /// When the first reading was due, ns; none before it.
    begin_ns: Option<u64>,
}

impl Recorded {
    fn new(script: Script, options: &StageOptions, group: &Group, board: Board) -> Result<Self, StageError> {
        let lock_step = options.clock == Clock::LockStep;
        // The other one is for the recorder.
        let own = Board::find(&options.prefix)?.ok_or_else(|| StageError::Setup("the group has no board".into()))?;
        Ok(Self {
            steps: script.steps,
            next: 0,
            readings: group.publisher()?,
            requests: group.publisher()?,
            references: group.publisher()?,
            commands: group.reader()?,
            snapshots: if lock_step { Some(group.reader()?) } else { None },
            recorder: RecorderGate::new(board, options),
            board: own,
            begin_ns: None,
        })
    }

    /// Sends the next reading, and what comes before it.
    fn send(&mut self, turn: &mut Turn, due_ns: u64) -> Result<(), StageError> {
        let Some(step) = self.steps.pop_front() else { return Ok(()) };
        for mut request in step.requests {
            request.header.sent_ns = monotonic_ns();
            self.requests.send(&request)?;
        }
        for mut reference in step.references {
            reference.header.sent_ns = monotonic_ns();
            self.references.send(&reference)?;
        }
        if step.stopped != 0 {
            self.board.stop((0..MAX_AXES).filter(|axis| step.stopped & (1 << axis) != 0));
        }
        if step.emergency {
            self.board.emergency_stop();
        }
        let mut reading = step.reading;
        turn.finish(&mut reading.header, self.next, monotonic_ns(), due_ns);
        self.readings.send(&reading)?;
        self.next += 1;
        Ok(())
    }

    /// Waits until the last reading has been answered, in lock-step. False while it has not.
    fn is_answered(&mut self, turn: &mut Turn) -> Result<bool, StageError> {
        let Some(last) = self.next.checked_sub(1) else { return Ok(true) };
        let (commands, snapshots) = (&mut self.commands, &mut self.snapshots);
        let answered = turn.wait_for(&Waiter::Yield, || {
            let command = commands.reach(last)?;
            Ok(command && snapshots.as_mut().map_or(Ok(true), |snapshots| snapshots.reach(last))?)
        })?;
        Ok(answered && self.recorder.admits(turn, self.next)?)
    }

    /// Waits until the next reading is due, in real time. When it was due, ns; none while it is not.
    fn due(&mut self, turn: &mut Turn) -> Option<u64> {
        let at_ns = self.steps.front()?.at_ns;
        let due_ns = self.begin_ns.get_or_insert_with(monotonic_ns).saturating_add(at_ns);
        turn.sleep_until(due_ns).then(|| turn.release(due_ns)).map(|_| due_ns)
    }
}

impl Stage for Recorded {
    fn turn(&mut self, turn: &mut Turn) -> Result<Next, StageError> {
        if self.snapshots.is_some() {
            if !self.is_answered(turn)? {
                return Ok(Next::Waiting);
            }
            turn.pick_up(self.commands.last().map_or_else(monotonic_ns, |command| command.header.sent_ns));
            if self.steps.is_empty() || self.next.checked_sub(1).is_some_and(|last| turn.is_last(last)) {
                return Ok(Next::Finished);
            }
            self.send(turn, 0)?;
            return Ok(Next::Worked);
        }
        self.commands.newest()?;
        let is_over = self.commands.last().is_some_and(|command| turn.is_last(command.header.sequence));
        if is_over {
            return Ok(Next::Finished);
        }
        if self.steps.is_empty() {
            // The others have their last tick only some periods later, and the supervisor ends them.
            turn.sleep_until(monotonic_ns().saturating_add(REST_NS));
            return Ok(Next::Waiting);
        }
        let Some(due_ns) = self.due(turn) else { return Ok(Next::Waiting) };
        self.send(turn, due_ns)?;
        Ok(Next::Worked)
    }

    fn greet(&self) {
        self.readings.greet();
        self.requests.greet();
        self.references.greet();
    }

    fn stop(&mut self) -> Result<(), StageError> {
        Ok(())
    }

    fn channels(&mut self, channels: &mut Channels<'_>) {
        channels.visit(&mut self.commands);
        self.snapshots.iter_mut().for_each(|snapshots| channels.visit(snapshots));
    }
}
