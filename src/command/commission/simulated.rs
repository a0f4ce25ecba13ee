//! The experiment with a simulated machine, one axis after the other, in one process and as fast as the computer
//! allows.

use control_proc::{
    commission::{Abort, AnalysisError, Experiment, ExperimentOptions, ExperimentRecord, Outcome, Phase, analyse},
    protection::walls::{Walls, Wanted},
};
use mechanism::AXES;
use pipeline::{
    MAX_AXES,
    machine::{Commissioned, Machine},
    message::ValveCommand,
};
use plant_sim::{PlantError, PlantSim};
use sensor_proc::Acquisition;
use thiserror::Error;

use crate::failure::Failure;

/// Why an experiment with a simulated axis has no model.
#[derive(Debug, Error)]
pub enum SimulatedError {
    /// The machine cannot be simulated.
    #[error(transparent)]
    Plant(#[from] PlantError),
    /// A bound was met.
    #[error("ended, valve neutral: {0}")]
    Aborted(Abort),
    /// A bound was met after a virtual wall had acted.
    #[error("ended, valve neutral: {abort}; {}", walled(&format!("walls.{wall}")))]
    Walled {
        /// The bound.
        abort: Abort,
        /// The wall, as a key of `[walls]`.
        wall: &'static str,
    },
    /// The record has no model.
    #[error(transparent)]
    Analysis(#[from] AnalysisError),
}

/// What a person is told about a virtual wall that has kept the valve neutral.
pub(super) fn walled(wall: &str) -> String {
    format!(
        "{wall} has kept the valve neutral: no part of the machine may pass it. Move the machine away from it, or \
         commission with a smaller --travel or --speed"
    )
}

/// The virtual walls of a machine, and the one that has acted last.
struct Guard {
    walls: Walls,
    acted: Option<&'static str>,
}

impl Guard {
    fn of(machine: &Machine) -> Option<Self> {
        Some(Self { walls: Walls::of(machine)?, acted: None })
    }

    /// What the walls leave of the command of an axis, with the axes at these positions (m) and speeds (m/s).
    fn allowed(&mut self, axis: usize, command: f64, motion: &[(f64, f64); AXES]) -> f64 {
        let wanted = std::array::from_fn(|i| Wanted {
            command: if i == axis { command } else { 0.0 },
            motion: Some(motion[i]).filter(|(position, _)| position.is_finite()),
            is_manual: false,
        });
        let Some(allowed) = self.walls.update(&wanted).commands.get(axis).copied() else { return command };
        if allowed != command {
            self.acted = self.walls.least_distance(&motion.map(|(position, _)| position)).map(|(wall, _)| wall);
        }
        allowed
    }
}

/// Commissions the axes with these indices. Each experiment starts with the machine in its first state. `seed` is that
/// of the noise of the encoders; `show` gets axis, phase and progress at every tick. Returns models and records.
///
/// # Errors
/// The machine cannot be simulated, a bound was met, or a record has no model. The error names the axis.
pub fn commission_simulated(
    machine: &Machine,
    axes: &[usize],
    seed: u64,
    options: &ExperimentOptions,
    mut show: impl FnMut(usize, Phase, f64),
) -> Result<Vec<(Commissioned, ExperimentRecord)>, Failure> {
    let one = |axis: &usize| {
        commission_axis(machine, *axis, seed, options, |phase, part| show(*axis, phase, part)).map_err(|error| {
            let is_wrong = matches!(error, SimulatedError::Plant(_));
            let failure = if is_wrong { Failure::usage(error) } else { Failure::run(error) };
            failure.about(format!("axis.{}", machine.axes[*axis].name))
        })
    };
    axes.iter().map(one).collect()
}

/// Commissions the axis with this index, as [`commission_simulated`] does.
///
/// # Errors
/// The machine cannot be simulated, a bound was met, or the record has no model.
pub fn commission_axis(
    machine: &Machine,
    axis: usize,
    seed: u64,
    options: &ExperimentOptions,
    mut show: impl FnMut(Phase, f64),
) -> Result<(Commissioned, ExperimentRecord), SimulatedError> {
    let mut plant = PlantSim::new(machine, seed)?;
    let mut acquisition = Acquisition::new(machine);
    let mut experiment = Experiment::new(&machine.axes[axis], &machine.timing, options);
    let mut guard = Guard::of(machine);
    let mut command = ValveCommand::default();
    let mut positions = [f64::NAN; MAX_AXES];
    let mut applied = Vec::new();
    for tick in 0.. {
        let sample = acquisition.update(tick, Some(&plant.read()));
        positions = sample.axes.each_ref().map(|axis| axis.position);
        let wanted = experiment.update(Some(&sample.axes[axis]));
        if experiment.outcome().is_some() {
            break;
        }
        command.axes[axis].command = match &mut guard {
            Some(guard) => {
                let speeds = plant.axes();
                let motion = std::array::from_fn(|i| (positions[i], speeds[i].velocity));
                guard.allowed(axis, wanted, &motion)
            }
            None => wanted,
        };
        applied.push(command.axes[axis].command);
        plant.command(&command);
        plant.advance(machine.timing.period);
        show(experiment.phase(), experiment.progress());
    }
    match experiment.outcome() {
        Some(Outcome::Aborted(abort)) => match guard.and_then(|guard| guard.acted) {
            Some(wall) => Err(SimulatedError::Walled { abort, wall }),
            None => Err(SimulatedError::Aborted(abort)),
        },
        _ => {
            let mut record = experiment.record().clone();
            let count = applied.len().min(record.commands.len());
            record.commands[..count].copy_from_slice(&applied[..count]);
            record.bear(machine, axis, &positions);
            Ok((analyse(&record)?, record))
        }
    }
}
