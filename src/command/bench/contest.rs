//! The comparison: its controllers, dead times, scenarios and seeds, and one run of it.

use std::{ops::ControlFlow, time::Duration};

use clap::ValueEnum;
use control_proc::{
    commission::ExperimentOptions,
    trajectory_file::read_references,
    tuning::{
        Baseline,
        course::{END, TRAINING, course},
        smith,
    },
};
use pipeline::{
    machine::{
        Axis, Control, Estimator, Law, Machine, ModelChoice, ReferenceSource, SMITH_MEMORY, Scenario, samples_of,
    },
    message::{ControlMode, control_flag},
    statistics::ErrorStatistics,
};

use super::{
    super::{commission::commission_simulated, simulate::closed_loop},
    parallel,
};
use crate::failure::Failure;

/// Seed of the noise of the encoders during commissioning. The seeds of the runs count from 1.
const COMMISSIONING_SEED: u64 = 0;

/// A controller of the comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ControllerKind {
    /// PI
    Pi,
    /// PI with dead-band compensation
    PiDeadband,
    /// PI with dead-band compensation and velocity feed-forward, ahead by dead time and lag
    PiFeedforward,
    /// predictive controller on the classical model, which is identified offline and held
    MpcHeld,
    /// predictive controller on the adaptive model, which is updated online
    MpcAdaptive,
    /// Smith predictor on the commissioned model, with the curve of the adaptive model
    SmithAdaptive,
}

impl ControllerKind {
    /// All controllers, in the order of the report.
    pub const ALL: [Self; 6] =
        [Self::Pi, Self::PiDeadband, Self::PiFeedforward, Self::MpcHeld, Self::MpcAdaptive, Self::SmithAdaptive];

    /// The name as a user types it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pi => "pi",
            Self::PiDeadband => "pi-deadband",
            Self::PiFeedforward => "pi-feedforward",
            Self::MpcHeld => "mpc-held",
            Self::MpcAdaptive => "mpc-adaptive",
            Self::SmithAdaptive => "smith-adaptive",
        }
    }

    /// The baseline that it is, or that controls while there is no model; and the model that it uses.
    fn parts(self) -> (Baseline, ModelChoice) {
        match self {
            Self::Pi => (Baseline::Pi, ModelChoice::None),
            Self::PiDeadband => (Baseline::DeadBand, ModelChoice::None),
            Self::PiFeedforward => (Baseline::Feedforward, ModelChoice::None),
            Self::MpcHeld => (Baseline::Feedforward, ModelChoice::Classical),
            Self::MpcAdaptive | Self::SmithAdaptive => (Baseline::Feedforward, ModelChoice::Adaptive),
        }
    }
}

/// All controllers with their tuned gains, and all scenarios.
pub struct Contest {
    /// The machine under each scenario.
    pub scenarios: Vec<Machine>,
    /// Every controller at every dead time.
    pub entries: Vec<Entry>,
}

/// A controller at a dead time.
pub struct Entry {
    /// Which controller.
    pub kind: ControllerKind,
    /// Dead time of all valves.
    pub dead_time: Duration,
    /// The axes with their course and the settings of this controller.
    pub axes: Vec<Axis>,
}

/// One run: a controller, a scenario and a seed.
pub struct Case {
    /// Index into [`Contest::entries`].
    pub entry: usize,
    /// Index into [`Contest::scenarios`].
    pub scenario: usize,
    /// Seed of the noise of the encoders.
    pub seed: u64,
}

/// The result of one run for one axis.
#[derive(Debug, Clone, Copy, Default)]
pub struct AxisResult {
    /// Reference minus true position, m.
    pub error: ErrorStatistics,
    /// Ticks that a model controlled.
    pub by_model: u64,
    /// The last fault that latched the axis, if it was still latched at the end.
    pub latched: Option<Latch>,
}

/// A fault that latched an axis.
#[derive(Debug, Clone, Copy)]
pub struct Latch {
    /// Time since the start of the course, s.
    pub time: f64,
    /// What the fault was, [`control_flag`] bits.
    pub causes: u32,
}

impl Contest {
    /// Tunes the baselines for every dead time. `scenarios` holds one machine under each scenario.
    ///
    /// # Errors
    /// The machine cannot be simulated, or an axis cannot be commissioned.
    pub fn new(
        scenarios: Vec<Machine>,
        dead_times: &[Duration],
        kinds: Vec<ControllerKind>,
        threads: usize,
    ) -> Result<Self, Failure> {
        let machine = &scenarios[0];
        let period = machine.timing.period.as_secs_f64();
        let mut entries = Vec::new();
        for dead_time in dead_times {
            let axes = at_dead_time(machine, *dead_time)?;
            for kind in &kinds {
                let mut axes = axes.clone();
                if matches!(kind, ControllerKind::MpcAdaptive | ControllerKind::SmithAdaptive) {
                    axes.iter_mut().for_each(|axis| axis.identification.estimator = Estimator::GreyBox);
                }
                if *kind == ControllerKind::SmithAdaptive {
                    for axis in &mut axes {
                        axis.identification.memory = SMITH_MEMORY;
                        axis.identification.hysteresis =
                            axis.commissioned.as_ref().map_or(0.0, |model| model.hysteresis);
                    }
                }
                entries.push(Entry { kind: *kind, dead_time: *dead_time, axes });
            }
        }
        let places: Vec<(usize, usize)> =
            (0..entries.len()).flat_map(|entry| (0..machine.axes.len()).map(move |axis| (entry, axis))).collect();
        let controls = parallel::map(threads, "tunings", &places, |(entry, index)| {
            let (baseline, model) = entries[*entry].kind.parts();
            let axis = &entries[*entry].axes[*index];
            let control = baseline.tuned(*index, axis, period).ok_or_else(|| not_commissioned(axis))?;
            if entries[*entry].kind != ControllerKind::SmithAdaptive {
                // A baseline is as it would be elsewhere: nobody lowers its gains when it swings.
                return Ok(Control { model, caution: model != ModelChoice::None, ..control });
            }
            // Where the predictor is not worth it, the fallback controls, as the model file would say.
            Ok(match smith(*index, axis, &control, period) {
                Some(settings) => Control { model, law: Law::Smith(settings), ..control },
                None => Control { model: ModelChoice::None, ..control },
            })
        })?;
        for ((entry, axis), control) in places.into_iter().zip(controls) {
            entries[entry].axes[axis].control = control;
        }
        Ok(Self { scenarios, entries })
    }

    /// Every entry under every scenario with every seed.
    pub fn cases(&self, seeds: u64) -> Vec<Case> {
        let mut cases = Vec::new();
        for entry in 0..self.entries.len() {
            for scenario in 0..self.scenarios.len() {
                cases.extend((1..=seeds).map(|seed| Case { entry, scenario, seed }));
            }
        }
        cases
    }

    /// Drives the course. Returns one result per axis.
    ///
    /// # Errors
    /// The machine cannot be simulated or controlled.
    pub fn run(&self, case: &Case) -> Result<Vec<AxisResult>, Failure> {
        let axes = self.entries[case.entry].axes.clone();
        let machine = Machine { axes, ..self.scenarios[case.scenario].clone() };
        let period = machine.timing.period.as_secs_f64();
        let generator = read_references(&machine).map_err(Failure::usage)?;
        let mut results = vec![AxisResult::default(); machine.axes.len()];
        // Ticks at which the controller began to command the axes.
        let mut begins = vec![None; machine.axes.len()];
        closed_loop::run(&machine, case.seed, (END / period).round() as u64, |tick| {
            let Some(plant) = tick.plant else { return Ok(ControlFlow::Continue(())) };
            for (index, (result, begin)) in results.iter_mut().zip(&mut begins).enumerate() {
                let command = &tick.command.axes[index];
                if command.mode != ControlMode::Neutral as u32 {
                    begin.get_or_insert(tick.number);
                }
                if (tick.number as f64) * period < TRAINING {
                    continue;
                }
                let t = (tick.number - begin.unwrap_or(tick.number)) as f64 * period;
                let position = plant.axes()[index].position;
                result.error.push(generator.position(index, t).unwrap_or(position) - position);
                result.by_model += u64::from(command.mode == ControlMode::Model as u32);
                let is_latched = command.flags & control_flag::LATCHED != 0;
                let latch = Latch { time: command.latched_at as f64 * period, causes: command.latched_by };
                result.latched = is_latched.then_some(latch);
            }
            Ok(ControlFlow::Continue(()))
        })?;
        Ok(results)
    }
}

/// The axes with a dead time, the commissioned models for it, and their course.
fn at_dead_time(machine: &Machine, dead_time: Duration) -> Result<Vec<Axis>, Failure> {
    let mut machine = machine.clone();
    for axis in &mut machine.axes {
        let Some(plant) = &mut axis.plant else { continue };
        let more = dead_time.as_secs_f64() - plant.dead_time;
        plant.dead_time = dead_time.as_secs_f64();
        // A model file was found at the dead time of the machine file.
        if let Some(commissioned) = &mut axis.commissioned {
            commissioned.dead_time = (commissioned.dead_time + more).max(0.0);
        }
    }
    let period = machine.timing.period;
    // The machine is commissioned in its nominal state.
    machine.scenario = Scenario::default();
    let unknown: Vec<usize> =
        (0..machine.axes.len()).filter(|axis| machine.axes[*axis].commissioned.is_none()).collect();
    let found =
        commission_simulated(&machine, &unknown, COMMISSIONING_SEED, &ExperimentOptions::default(), |_, _, _| ())?;
    for (index, (model, _)) in unknown.into_iter().zip(found) {
        machine.axes[index].commissioned = Some(model);
    }
    for (index, axis) in machine.axes.iter_mut().enumerate() {
        let model = axis.commissioned.as_ref().ok_or_else(|| not_commissioned(axis))?;
        axis.identification.structure = model.structure(axis.identification.structure, period);
        axis.identification.training = samples_of(Duration::from_secs_f64(TRAINING), period);
        let points = course(index, axis.soft_limits, model.reached(axis.control.command_limit));
        axis.reference = ReferenceSource::Ramps(points);
    }
    Ok(machine.axes)
}

fn not_commissioned(axis: &Axis) -> Failure {
    let name = &axis.name;
    Failure::usage(format!(
        "axis.{name}: found no commissioned model; allowed: a simulated axis, or --model MODEL.toml"
    ))
}
