//! One run of `hydraxis bench tip`.

use std::{ops::ControlFlow, time::Duration};

use control_proc::ReferenceError;
use mechanism::AXES;
use pipeline::{
    machine::{Machine, ReferenceSource, TipTask, samples_of},
    message::{AxisCommand, control_flag},
    statistics::ErrorStatistics,
};
use serde::Serialize;

use super::{super::super::simulate::closed_loop, BEFORE, PATIENCE, controller::Controller, drawn::toml};
use crate::{
    failure::Failure,
    group::operator,
    report::teeth::{AFTER, Stopped, Teeth, TracePoint},
};

/// Ticks between two places of the teeth that are kept for a picture.
const TRACED: u64 = 5;

/// One run.
pub struct Case<'m> {
    /// Name of the task.
    pub name: String,
    /// The task.
    pub task: TipTask,
    /// Mass in the bucket, kg.
    pub payload: f64,
    /// The machine under a scenario.
    pub machine: &'m Machine,
    /// What drives it.
    pub controller: Controller,
    /// Seed of the noise of the encoders.
    pub seed: u64,
}

/// The figures of one run; m, degrees, s.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Row {
    pub task: String,
    pub speed: f64,
    pub payload: f64,
    pub scenario: String,
    pub controller: &'static str,
    pub seed: u64,
    /// The task as a table of a machine file.
    pub way: String,
    /// Why the task was refused; then there are no figures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
    pub rms: Option<f64>,
    pub max: Option<f64>,
    pub max_at: Option<[f64; 2]>,
    pub pitch_rms: Option<f64>,
    /// Planned time of the motion.
    pub duration: Option<f64>,
    /// Time that the motion has taken; none where it has not come to its end.
    pub time: Option<f64>,
    /// Axis, causes, and time of every latch.
    pub latches: Vec<String>,
    /// The planned time has passed.
    pub is_done: bool,
    /// The virtual wall that has ended the task before its end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stopped: Option<Stopped>,
    /// Distance from the way, to be merged.
    #[serde(skip)]
    pub error: ErrorStatistics,
    /// Error of the pitch, to be merged.
    #[serde(skip)]
    pub pitch: ErrorStatistics,
    #[serde(skip)]
    pub trace: Vec<TracePoint>,
}

impl Case<'_> {
    /// The machine with task, payload and controller of this run.
    fn machine(&self) -> Machine {
        let mut machine = self.machine.clone();
        machine.tip = Some(self.task.clone());
        if let Some(mechanism) = &mut machine.mechanism {
            mechanism.masses.payload.mass = self.payload;
        }
        machine.axes.iter_mut().take(AXES).for_each(|axis| axis.reference = ReferenceSource::Tip);
        self.controller.apply(&mut machine);
        machine
    }

    /// Plans the task and drives it.
    ///
    /// # Errors
    /// The machine cannot be simulated.
    pub fn drive(&self) -> Result<Row, Failure> {
        let machine = self.machine();
        let mut row = Row::of(self, &machine);
        let mut teeth = match Teeth::of(&machine) {
            Ok(teeth) => teeth.ok_or_else(|| Failure::run("found no plan"))?,
            Err(ReferenceError::Tip(error)) => return Ok(Row { refused: Some(error.to_string()), ..row }),
            Err(error) => return Err(Failure::usage(error)),
        };
        let ticks = |seconds: f64| samples_of(Duration::from_secs_f64(seconds), machine.timing.period) as u64;
        let (most, mut after) = (ticks(BEFORE + PATIENCE * teeth.plan().duration()), ticks(AFTER));
        let mut latched = vec![0; machine.axes.len()];
        closed_loop::run(&machine, self.seed, most, |tick| {
            if let Some(plant) = tick.plant {
                teeth.observe(tick.way, plant, &tick.command.axes);
                row.trace.extend((tick.number % TRACED == 0).then(|| teeth.trace(tick.way, plant)).flatten());
            }
            row.tell_latches(&machine, tick.number, &tick.command.axes, &mut latched);
            after -= u64::from(teeth.is_done());
            Ok(if after == 0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
        })?;
        row.take(&teeth, machine.timing.period);
        Ok(row)
    }
}

impl Row {
    /// Of a run that has no figures yet.
    fn of(case: &Case<'_>, machine: &Machine) -> Self {
        Self {
            task: case.name.clone(),
            speed: case.task.speed,
            payload: case.payload,
            scenario: machine.scenario.name.clone(),
            controller: case.controller.name,
            seed: case.seed,
            way: machine.tip.as_ref().map(toml).unwrap_or_default(),
            ..Self::default()
        }
    }

    /// What the runs of all controllers have in common.
    pub fn run(&self) -> (&str, u64, u64, &str, u64) {
        (&self.task, self.speed.to_bits(), self.payload.to_bits(), &self.scenario, self.seed)
    }

    /// Takes the figures of the teeth.
    fn take(&mut self, teeth: &Teeth, period: Duration) {
        let figures = teeth.figures();
        (self.rms, self.max, self.max_at, self.pitch_rms) =
            (figures.rms, figures.max, figures.max_at, figures.pitch_rms);
        (self.duration, self.is_done) = (Some(figures.duration), figures.is_done);
        (self.error, self.pitch, self.stopped) = (figures.error, figures.pitch, figures.stopped);
        // The error is taken at every tick on the way.
        self.time = figures.is_done.then_some(figures.error.count as f64 * period.as_secs_f64());
    }

    /// Tells the axes that this tick latches; `before` are the flags of the tick before, and become those of this one.
    fn tell_latches(&mut self, machine: &Machine, tick: u64, axes: &[AxisCommand], before: &mut [u32]) {
        for ((before, axis), now) in before.iter_mut().zip(&machine.axes).zip(axes) {
            if now.flags & control_flag::LATCHED & !*before != 0 {
                let seconds = tick as f64 * machine.timing.period.as_secs_f64();
                self.latches.push(format!("{}, {seconds:.2} s", operator::state(&axis.name, now.flags, now.operation)));
            }
            *before = now.flags;
        }
    }
}
