//! One drawn machine: commissioned, then driven with every task, once by its fallback and once by its model.
//!
//! The machine is commissioned as `hydraxis commission FILE` does it, before anything changes. The text of the model
//! file that this would write is read as `--model` reads it. The tasks run under the scenario of the file. Errors are
//! reference minus true position.

use control_proc::{
    commission::{Abort, ExperimentOptions},
    trajectory_file::read_references,
};
use pipeline::{
    machine::{Commissioned, Machine, ModelChoice, model_settings_in},
    message::{ControlMode, control_flag},
    statistics::ErrorStatistics,
};

use super::{
    hold::Hold,
    machine_file::{AXIS, SCENARIO, machine},
    rig::Rig,
    task::{BEGIN, Task, WATCHED},
};
use crate::{
    command::{
        commission::{SimulatedError, commission_axis, is_poor, model_text, tuned},
        simulate::closed_loop,
    },
    failure::Failure,
    report::margins::LoopMargins,
};

/// Seed of the noise of the encoder while the tasks are driven. That of commissioning is the default of `commission`.
const DRIVING_SEED: u64 = 2;

/// What became of a machine.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The machine.
    pub rig: Rig,
    /// What it did, or why commissioning refused it.
    pub result: Result<Driven, Refusal>,
}

/// Why commissioning refused a machine.
#[derive(Debug, Clone)]
pub struct Refusal {
    /// In a word or two.
    pub reason: &'static str,
    /// As the user reads it.
    pub message: String,
}

/// A commissioned machine that was driven.
#[derive(Debug, Clone)]
pub struct Driven {
    /// What commissioning found.
    pub model: Commissioned,
    /// The loops of the controllers that commissioning chose, on that model.
    pub loops: Vec<LoopMargins>,
    /// Whether the model file lets the model control.
    pub is_chosen: bool,
    /// The tasks, in the order of [`Task::ALL`].
    pub tasks: Vec<Pair>,
}

/// The runs of one task.
#[derive(Debug, Clone)]
pub struct Pair {
    /// The task.
    pub task: Task,
    /// With `model = "none"`.
    pub fallback: Run,
    /// With `model = "adaptive"`, whatever the model file chooses.
    pub adaptive: Run,
}

/// One run.
#[derive(Debug, Clone, Default)]
pub struct Run {
    /// Reference minus true position, m, from [`BEGIN`] on.
    pub error: ErrorStatistics,
    /// Ticks from [`BEGIN`] on at which the model controlled.
    pub by_model: u64,
    /// The faults that latched the axis, [`control_flag`] bits.
    pub latched: u32,
    /// What the axis did while it held a set point; empty for other tasks.
    pub hold: Hold,
}

/// Commissions and drives a machine.
///
/// # Errors
/// The machine cannot be simulated or controlled: an error of this program.
pub fn drive(rig: &Rig) -> Result<Outcome, Failure> {
    Ok(Outcome { rig: rig.clone(), result: commissioned_and_driven(rig)? })
}

fn commissioned_and_driven(rig: &Rig) -> Result<Result<Driven, Refusal>, Failure> {
    let still = machine(rig, Task::Sines, &[])?;
    let model = match commission(&still) {
        Ok(model) => model,
        Err(refusal) => return Ok(Err(refusal)),
    };
    let control = tuned(&still, 0, &model);
    let settings = model_settings_in(&model_text(&still, std::iter::once((0, &model, control))), "model file")?;
    let is_chosen = match machine(rig, Task::Sines, &settings) {
        Ok(commissioned) => commissioned.axes[0].control.model == ModelChoice::Adaptive,
        Err(error) => return Ok(Err(Refusal { reason: "model file", message: error.to_string() })),
    };
    let tasks = Task::ALL.iter().map(|task| pair(rig, *task, &settings)).collect::<Result<_, _>>()?;
    let period = still.timing.period.as_secs_f64();
    let loops = control.map_or_else(Vec::new, |control| LoopMargins::of(AXIS, &control, &model, period));
    Ok(Ok(Driven { model, loops, is_chosen, tasks }))
}

fn commission(machine: &Machine) -> Result<Commissioned, Refusal> {
    let options = ExperimentOptions::default();
    let found = commission_axis(machine, 0, options.seed, &options, |_, _| ());
    let (model, _) = found.map_err(|error| Refusal { reason: reason(&error), message: error.to_string() })?;
    if is_poor(&model) {
        return Err(Refusal { reason: "poor fit", message: format!("fit of {:.1} %", model.fit_percent) });
    }
    Ok(model)
}

fn reason(error: &SimulatedError) -> &'static str {
    match error {
        SimulatedError::Plant(_) => "plant",
        SimulatedError::Analysis(_) => "analysis",
        SimulatedError::Aborted(abort) => match abort {
            Abort::Stopped => "stopped",
            Abort::Feedback { .. } => "feedback",
            Abort::Window { .. } => "window",
            Abort::Speed { .. } => "speed",
            Abort::Against { .. } => "direction",
            Abort::Stuck { .. } => "stuck",
            Abort::NoMotion { .. } => "no motion",
            Abort::TooSmall { .. } => "window too small",
            Abort::TooShort { .. } => "too short",
        },
    }
}

fn pair(rig: &Rig, task: Task, settings: &[(String, String)]) -> Result<Pair, Failure> {
    let with = |model: &str| {
        let more =
            [("scenario".to_owned(), SCENARIO.to_owned()), (format!("axis.{AXIS}.control.model"), model.to_owned())];
        // The model file may have the same key; a setting that comes first counts.
        let all: Vec<_> = settings.iter().filter(|(key, _)| *key != more[1].0).chain(&more).cloned().collect();
        run(&machine(rig, task, &all)?, task)
    };
    Ok(Pair { task, fallback: with("none")?, adaptive: with("adaptive")? })
}

fn run(machine: &Machine, task: Task) -> Result<Run, Failure> {
    let period = machine.timing.period.as_secs_f64();
    let generator = read_references(machine).map_err(Failure::usage)?;
    let mut run = Run { hold: Hold::new(machine.axes[0].encoder.resolution), ..Run::default() };
    // Tick at which the controller began to command the axis: the reference counts from there.
    let mut begin = None;
    closed_loop::run(machine, DRIVING_SEED, (task.end() / period).round() as u64, |tick| {
        let Some(plant) = tick.plant else { return Ok(()) };
        let (command, time) = (&tick.command.axes[0], tick.number as f64 * period);
        if command.mode != ControlMode::Neutral as u32 {
            begin.get_or_insert(tick.number);
        }
        run.latched |= command.flags & control_flag::LATCHED;
        if time < BEGIN {
            return Ok(());
        }
        let position = plant.axes()[0].position;
        let since = (tick.number - begin.unwrap_or(tick.number)) as f64 * period;
        let error = generator.position(0, since).unwrap_or(position) - position;
        run.error.push(error);
        run.by_model += u64::from(command.mode == ControlMode::Model as u32);
        if task == Task::Hold && time >= WATCHED.0 {
            run.hold.seen.push(error, command.command);
        }
        Ok(())
    })?;
    Ok(run)
}
