//! Identification and controller of today on the samples of a recording, beside what was predicted and commanded.
//!
//! The motion is that of the recording: it answered the recorded commands. So identification gets the recorded
//! commands, and the controller goes on at every tick from the command that was on the valve, not from its own. Its
//! command says what it would have done at this tick after the same past.
//!
//! Trap: the memory of a controller that is not its commands, such as the integral of the fallback, follows errors that
//! it could not correct.

use std::{collections::VecDeque, io};

use ident_proc::Identifiers;
use pipeline::message::{
    AxisMode, AxisSnapshot, CoefficientSnapshot, ControlMode, EncoderReading, EncoderSample, MachineState, Message,
    Reference, Request, ValveCommand, command_event,
};

use super::{
    ReplayArguments,
    controller::ReplayedController,
    feed::Feed,
    figures::{AxisWatch, ErrorWatch, Errors},
    machine::Recorded,
    report::CompareReport,
};
use crate::{
    failure::Failure,
    recording::reading::Reading,
    report::{
        output::{OutputError, create},
        rows::{CsvRows, field},
        table::progress,
    },
};

/// Snapshots that are kept for commands that were made with an older one.
const KEPT: usize = 64;
/// Columns of every axis in the table of `--csv`.
const COLUMNS: [&str; 10] = [
    "position",
    "reference",
    "command_was",
    "command_now",
    "mode_was",
    "mode_now",
    "one_step_was",
    "one_step_now",
    "h_step_was",
    "h_step_now",
];

/// One axis over the whole recording.
#[derive(Default)]
struct Axis {
    was: ErrorWatch,
    now: ErrorWatch,
    figures: AxisWatch,
}

/// Identification and controller of the replay.
struct Cores {
    identifiers: Identifiers,
    controller: ReplayedController,
    /// Numbers of the last recorded snapshots, with those of the replay after the same samples.
    recent: VecDeque<(u64, CoefficientSnapshot)>,
    /// The last snapshot of the replay.
    snapshot: Option<CoefficientSnapshot>,
    /// The recorded command of the sample before.
    command: Option<ValveCommand>,
    has_inputs: bool,
    has_begun: bool,
}

/// What was and what would have been at one tick.
struct Moment<'a> {
    sample: &'a EncoderSample,
    was: Option<&'a ValveCommand>,
    now: Option<&'a ValveCommand>,
}

/// Runs identification and controller on a recording.
///
/// # Errors
/// The file cannot be read, a value is refused, or the table cannot be written.
pub fn compare(recorded: &Recorded, arguments: &ReplayArguments) -> Result<CompareReport, Failure> {
    let machine = recorded.machine(arguments.model.as_deref(), &arguments.settings)?;
    let names: Vec<String> = machine.axes.iter().map(|axis| axis.name.clone()).collect();
    let period = machine.timing.period.as_secs_f64();
    let mut table = arguments.csv.as_deref().map(|path| create("--csv", path)).transpose()?.map(CsvRows::new);
    let refused = |source: io::Error| {
        let path = arguments.csv.clone().unwrap_or_default();
        Failure::from(OutputError::Write { option: "--csv", path, source })
    };
    if let Some(table) = &mut table {
        table.write(header(&names)).map_err(refused)?;
    }
    let mut feed = feed(recorded)?;
    let mut cores = Cores {
        identifiers: Identifiers::new(&machine),
        controller: ReplayedController::new(&machine, recorded.is_lock_step())?,
        recent: VecDeque::with_capacity(KEPT),
        snapshot: None,
        command: None,
        has_inputs: feed.commands.is_exact(),
        has_begun: false,
    };
    let mut axes: Vec<Axis> = names.iter().map(|_| Axis::default()).collect();
    let (bar, mut ticks, mut first) = (progress(0, "ticks"), 0u64, None);
    while let Some(sample) = feed.samples.pop() {
        let sample = sample.message;
        let tick = sample.header.sequence;
        let first = *first.get_or_insert(tick);
        let was = feed.snapshots.of_tick(tick).map(|typed| typed.message);
        let (before, now) = cores.step(&sample, was.as_ref(), &mut feed);
        let errors = errors(&mut axes, was.as_ref(), cores.snapshot.as_ref());
        let moment = Moment { sample: &sample, was: before.as_ref(), now: now.as_ref() };
        commands(&mut axes, &moment);
        if let Some(table) = &mut table {
            let row = row((tick - first) as f64 * period, &moment, &errors);
            table.write(row).map_err(refused)?;
        }
        ticks += 1;
        if ticks % 1024 == 0 {
            bar.set_position(ticks);
        }
        feed.fill()?;
    }
    bar.finish_and_clear();
    table.as_mut().map_or(Ok(()), CsvRows::finish).map_err(refused)?;
    if ticks == 0 {
        return Err(Failure::usage(format!("{}: found no sample", recorded.path.display())));
    }
    Ok(CompareReport {
        ticks,
        model_s: period * ticks as f64,
        begins_at_tick: first.unwrap_or_default(),
        axes: axes.iter().zip(&names).map(|(axis, name)| axis.figures.figures(name)).collect(),
        damage: feed.damage().map(|damage| format!("byte {}: {}", damage.byte, damage.what)),
    })
}

/// The messages of a recording, without the channels that no core takes.
fn feed(recorded: &Recorded) -> Result<Feed, Failure> {
    let mut feed = Feed::new(Reading::open(&recorded.path)?);
    feed.leave_out(&[EncoderReading::CHANNEL, MachineState::CHANNEL]);
    feed.fill()?;
    if !feed.commands.is_exact() {
        // Such commands do not name the references and requests that they were made with.
        feed.leave_out(&[Reference::CHANNEL, Request::CHANNEL]);
    }
    Ok(feed)
}

impl Cores {
    /// One tick: the recorded command, and the one of the replay.
    fn step(
        &mut self,
        sample: &EncoderSample,
        was: Option<&CoefficientSnapshot>,
        feed: &mut Feed,
    ) -> (Option<ValveCommand>, Option<ValveCommand>) {
        let tick = sample.header.sequence;
        let last = self.snapshot;
        let next = self.snapshot.get_or_insert_default();
        self.identifiers.update(sample, self.command.as_ref(), next);
        let number = was.map_or(self.recent.back().map_or(0, |(number, _)| number + 1), |was| was.header.number);
        next.header.number = number;
        let learned = *next;
        let recorded = self.recorded(sample, feed);
        let now = recorded.as_ref().map(|recorded| {
            self.begin(recorded);
            let now = if self.has_inputs {
                let used = recorded.inputs.snapshot.checked_sub(1);
                let kept = |number| self.recent.iter().rev().find(|(of, _)| *of == number).map(|(_, kept)| *kept);
                let snapshot = used.and_then(|number| kept(number).or(last));
                self.controller.update(sample, snapshot.as_ref(), recorded, feed)
            } else {
                self.controller.update_with_newest(sample, last.as_ref())
            };
            self.controller.apply(recorded);
            now
        });
        if self.recent.len() == KEPT {
            self.recent.pop_front();
        }
        self.recent.push_back((number, learned));
        self.command = recorded;
        debug_assert!(recorded.is_none_or(|command| command.header.sequence == tick));
        (recorded, now)
    }

    /// The recorded command of a sample. Commands without a sample, which come before it, are replayed on the way.
    fn recorded(&mut self, sample: &EncoderSample, feed: &mut Feed) -> Option<ValveCommand> {
        let tick = sample.header.sequence;
        while let Some(command) = feed.commands.peek().copied().filter(|command| command.header.sequence <= tick) {
            if command.header.sequence == tick && !ReplayedController::is_extra(&command) {
                feed.commands.pop();
                return Some(command);
            }
            if command.header.sequence == tick {
                // It follows the command of this tick, or there is none.
                let has_own =
                    feed.commands.waiting().iter().any(|next| {
                        next.message.header().sequence == tick && !ReplayedController::is_extra(&next.message)
                    });
                if !has_own {
                    return None;
                }
            }
            feed.commands.pop();
            if self.has_begun && ReplayedController::is_extra(&command) {
                self.controller.extra(&command.header, &command);
                self.controller.apply(&command);
            }
        }
        None
    }

    /// Arms the controller of a recording that begins with armed axes.
    fn begin(&mut self, first: &ValveCommand) {
        let is_armed = first.axes.iter().any(|axis| axis.operation != AxisMode::Off as u32);
        let arms_itself = first.inputs.events & command_event::ARMED != 0;
        if !std::mem::replace(&mut self.has_begun, true) && is_armed && !arms_itself {
            self.controller.arm();
        }
    }
}

/// Takes in the errors of a tick, of each axis, as recorded and now.
fn errors(
    axes: &mut [Axis],
    was: Option<&CoefficientSnapshot>,
    now: Option<&CoefficientSnapshot>,
) -> Vec<(Errors, Errors)> {
    let look = |watch: &mut ErrorWatch, snapshot: Option<&AxisSnapshot>| {
        snapshot.map_or(Errors::default(), |snapshot| watch.look(snapshot))
    };
    axes.iter_mut()
        .enumerate()
        .map(|(i, axis)| {
            let was = look(&mut axis.was, was.map(|was| &was.axes[i]));
            let now = look(&mut axis.now, now.map(|now| &now.axes[i]));
            axis.figures.errors(&was, &now);
            (was, now)
        })
        .collect()
}

/// Takes in the commands of a tick.
fn commands(axes: &mut [Axis], moment: &Moment<'_>) {
    let (Some(was), Some(now)) = (moment.was, moment.now) else { return };
    for (i, axis) in axes.iter_mut().enumerate() {
        let (was, now) = (&was.axes[i], &now.axes[i]);
        axis.figures.commands(moment.sample.header.sequence, (was.command, was.mode), (now.command, now.mode));
    }
}

fn header(names: &[String]) -> Vec<String> {
    let of_axis = |name: &String| COLUMNS.map(|column| format!("{name}.{column}"));
    ["t", "tick"].map(str::to_owned).into_iter().chain(names.iter().flat_map(of_axis)).collect()
}

fn row(t: f64, moment: &Moment<'_>, errors: &[(Errors, Errors)]) -> Vec<String> {
    let mut fields = vec![t.to_string(), moment.sample.header.sequence.to_string()];
    let optional = |value: Option<f64>| value.map_or(String::new(), field);
    for (i, (was, now)) in errors.iter().enumerate() {
        let [before, after] = [moment.was, moment.now].map(|command| command.map(|command| command.axes[i]));
        let mode = |command: Option<u32>| command.map_or("", ControlMode::name).to_owned();
        fields.extend([
            field(moment.sample.axes[i].position),
            optional(before.map(|command| command.reference)),
            optional(before.map(|command| command.command)),
            optional(after.map(|command| command.command)),
            mode(before.map(|command| command.mode)),
            mode(after.map(|command| command.mode)),
            optional(was.one_step),
            optional(now.one_step),
            optional(was.h_step),
            optional(now.h_step),
        ]);
    }
    fields
}
