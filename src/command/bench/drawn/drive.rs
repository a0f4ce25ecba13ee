//! One drawn machine: commissioned, then driven with every task, once by its fallback and once by its model.
//!
//! The machine is commissioned as `hydraxis commission FILE` does it, before anything changes. Where that is refused, a
//! second time with the option that the refusal asks for. The text of the model file that this would write is read as
//! `--model` reads it. The tasks run under the scenario of the file. Errors are reference minus true position.

use std::ops::ControlFlow;

use control_proc::{
    commission::{Abort, ExperimentOptions},
    trajectory_file::read_references,
    tuning::is_poor,
};
use pipeline::{
    machine::{Commissioned, Control, Machine, ModelChoice, model_settings_in},
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
        commission::{SimulatedError, commission_axis, model_text, tuned},
        simulate::closed_loop,
    },
    failure::Failure,
    report::margins::LoopMargins,
};

/// Seed of the noise of the encoder while the tasks are driven. That of commissioning is the default of `commission`.
const DRIVING_SEED: u64 = 2;

/// Travel of the second try, in parts of what the first one has found too little.
const WIDER: f64 = 1.1;

/// What became of a machine.
#[derive(Debug, Clone)]
pub struct Outcome<T> {
    /// The machine.
    pub rig: Rig,
    /// How often it was commissioned, 1 or 2.
    pub tries: usize,
    /// What it did, or why commissioning refused it.
    pub result: Result<T, Refusal>,
}

/// Why commissioning refused a machine.
#[derive(Debug, Clone)]
pub struct Refusal {
    /// In a word or two.
    pub reason: &'static str,
    /// As the user reads it.
    pub message: String,
    /// What it asks for: other options of `commission`.
    next: Option<ExperimentOptions>,
}

/// Flags of a model that has lost control to the fallback.
const OUSTED: u32 = control_flag::MODEL_TRIAL | control_flag::MODEL_WORSE | control_flag::CAUTION;

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
    /// Time from the first tick by the model to the first tick at which it had lost control to the fallback, s: by a
    /// trial, for being worse, or for a swing.
    pub suspected: Option<f64>,
    /// What the axis did while it held a set point; empty for other tasks.
    pub hold: Hold,
}

/// A machine that was commissioned and is ready to be driven.
pub struct Ready<'a> {
    /// The machine.
    pub rig: &'a Rig,
    /// As its file describes it, without a model.
    still: Machine,
    /// What commissioning found.
    pub model: Commissioned,
    /// The gains and the law that commissioning chose.
    control: Option<Control>,
    /// The model file.
    pub settings: Settings,
    /// Whether the model file lets the model control.
    pub is_chosen: bool,
}

/// Keys and values of a model file.
pub type Settings = Vec<(String, String)>;

/// Commissions and drives a machine.
///
/// # Errors
/// The machine cannot be simulated or controlled: an error of this program.
pub fn drive(rig: &Rig) -> Result<Outcome<Driven>, Failure> {
    let (tries, ready) = Ready::new(rig)?;
    let result = match ready {
        Ok(ready) => Ok(ready.drive()?),
        Err(refusal) => Err(refusal),
    };
    Ok(Outcome { rig: rig.clone(), tries, result })
}

impl<'a> Ready<'a> {
    /// Commissions a machine; also says how many tries that took.
    ///
    /// # Errors
    /// The machine cannot be simulated: an error of this program.
    pub fn new(rig: &'a Rig) -> Result<(usize, Result<Self, Refusal>), Failure> {
        let still = machine(rig, Task::Sines, &[])?;
        let first = commission(&still, &ExperimentOptions::default());
        let next = first.as_ref().err().and_then(|refusal| refusal.next);
        let (tries, found) = next.map_or((1, first), |options| (2, commission(&still, &options)));
        let ready = match found {
            Ok(model) => Self::tuned(rig, still, model)?,
            Err(refusal) => Err(refusal),
        };
        Ok((tries, ready))
    }

    fn tuned(rig: &'a Rig, still: Machine, model: Commissioned) -> Result<Result<Self, Refusal>, Failure> {
        let control = tuned(&still, 0, &model);
        let settings = model_file(&still, &model, control)?;
        Ok(match machine(rig, Task::Sines, &settings) {
            Ok(commissioned) => {
                let is_chosen = commissioned.axes[0].control.model == ModelChoice::Adaptive;
                Ok(Self { rig, still, model, control, settings, is_chosen })
            }
            Err(error) => Err(Refusal { reason: "model file", message: error.to_string(), next: None }),
        })
    }

    /// The model file with another model in place of the one that was found. Gains and law stay.
    ///
    /// # Errors
    /// The text is no model file: an error of this program.
    pub fn settings_with(&self, model: &Commissioned) -> Result<Settings, Failure> {
        model_file(&self.still, model, self.control)
    }

    fn drive(self) -> Result<Driven, Failure> {
        let of = |control| LoopMargins::of(&self.still.axes[0], &control, &self.model, self.still.timing.period);
        let loops = self.control.map_or_else(Vec::new, of);
        let pair = |task: &Task| {
            let with = |model| run(self.rig, *task, &self.settings, model);
            Ok(Pair { task: *task, fallback: with("none")?, adaptive: with("adaptive")? })
        };
        let tasks = Task::ALL.iter().map(pair).collect::<Result<_, Failure>>()?;
        Ok(Driven { model: self.model, loops, is_chosen: self.is_chosen, tasks })
    }
}

/// What a model file with this model and these gains says.
///
/// # Errors
/// The text is no model file: an error of this program.
pub fn model_file(still: &Machine, model: &Commissioned, control: Option<Control>) -> Result<Settings, Failure> {
    Ok(model_settings_in(&model_text(still, std::iter::once((0, model, control))), "model file")?)
}

fn commission(machine: &Machine, options: &ExperimentOptions) -> Result<Commissioned, Refusal> {
    let longer = Some(ExperimentOptions { duration: 2 * options.duration, ..*options });
    let found = commission_axis(machine, 0, options.seed, options, |_, _| ());
    let (model, _) = found.map_err(|error| {
        let next = match &error {
            SimulatedError::Aborted(Abort::TooSmall { needed, .. }) => {
                let (low, high) = machine.axes[0].soft_limits;
                let travel = Some(WIDER * needed).filter(|travel| *travel < high - low);
                travel.map(|travel| ExperimentOptions { travel: Some(travel), ..*options })
            }
            SimulatedError::Aborted(Abort::TooShort { .. }) => longer,
            _ => None,
        };
        Refusal { reason: reason(&error), message: error.to_string(), next }
    })?;
    if is_poor(&model) {
        let message = format!("fit of {:.1} %", model.fit_percent);
        return Err(Refusal { reason: "poor fit", message, next: longer });
    }
    Ok(model)
}

fn reason(error: &SimulatedError) -> &'static str {
    match error {
        SimulatedError::Plant(_) => "plant",
        SimulatedError::Analysis(_) => "analysis",
        SimulatedError::Aborted(abort) | SimulatedError::Walled { abort, .. } => match abort {
            Abort::Stopped => "stopped",
            Abort::Feedback { .. } => "feedback",
            Abort::Start { .. } => "start",
            Abort::Window { .. } => "window",
            Abort::Creep { .. } => "creep",
            Abort::Speed { .. } => "speed",
            Abort::Against { .. } => "direction",
            Abort::Stuck { .. } => "stuck",
            Abort::NoMotion { .. } => "no motion",
            Abort::TooSmall { .. } => "window too small",
            Abort::TooShort { .. } => "too short",
        },
    }
}

/// Drives a machine that has this model file. `model`: the value of `control.model`, whatever the file says.
///
/// # Errors
/// The machine cannot be simulated or controlled: an error of this program.
pub fn run(rig: &Rig, task: Task, settings: &[(String, String)], model: &str) -> Result<Run, Failure> {
    let more = [("scenario".to_owned(), SCENARIO.to_owned()), (format!("axis.{AXIS}.control.model"), model.to_owned())];
    // The model file may have the same key; a setting that comes first counts.
    let all: Vec<_> = settings.iter().filter(|(key, _)| *key != more[1].0).chain(&more).cloned().collect();
    watched(&machine(rig, task, &all)?, task)
}

fn watched(machine: &Machine, task: Task) -> Result<Run, Failure> {
    let period = machine.timing.period.as_secs_f64();
    let generator = read_references(machine).map_err(Failure::usage)?;
    let mut run = Run { hold: Hold::new(machine.axes[0].encoder.resolution), ..Run::default() };
    // Tick at which the controller began to command the axis: the reference counts from there.
    let mut begin = None;
    let mut first_by_model = None;
    closed_loop::run(machine, DRIVING_SEED, (task.end() / period).round() as u64, |tick| {
        let Some(plant) = tick.plant else { return Ok(ControlFlow::Continue(())) };
        let (command, time) = (&tick.command.axes[0], tick.number as f64 * period);
        if command.mode != ControlMode::Neutral as u32 {
            begin.get_or_insert(tick.number);
        }
        run.latched |= command.flags & control_flag::LATCHED;
        let is_by_model = command.mode == ControlMode::Model as u32;
        if is_by_model {
            first_by_model.get_or_insert(time);
        }
        if let Some(first) = first_by_model.filter(|_| command.flags & OUSTED != 0) {
            run.suspected.get_or_insert(time - first);
        }
        if time < BEGIN {
            return Ok(ControlFlow::Continue(()));
        }
        let position = plant.axes()[0].position;
        let since = (tick.number - begin.unwrap_or(tick.number)) as f64 * period;
        let error = generator.position(0, since).unwrap_or(position) - position;
        run.error.push(error);
        run.by_model += u64::from(is_by_model);
        if task == Task::Hold && time >= WATCHED.0 {
            run.hold.seen.push(error, command.command);
        }
        Ok(ControlFlow::Continue(()))
    })?;
    Ok(run)
}
