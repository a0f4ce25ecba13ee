//! The experiment with a simulated machine, one axis after the other, in one process and as fast as the computer
//! allows.

use control_proc::commission::{
    Abort, AnalysisError, Experiment, ExperimentOptions, ExperimentRecord, Outcome, Phase, analyse,
};
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
    /// The record has no model.
    #[error(transparent)]
    Analysis(#[from] AnalysisError),
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
    let mut command = ValveCommand::default();
    let mut positions = [f64::NAN; MAX_AXES];
    for tick in 0.. {
        let sample = acquisition.update(tick, Some(&plant.read()));
        positions = sample.axes.each_ref().map(|axis| axis.position);
        command.axes[axis].command = experiment.update(Some(&sample.axes[axis]));
        if experiment.outcome().is_some() {
            break;
        }
        plant.command(&command);
        plant.advance(machine.timing.period);
        show(experiment.phase(), experiment.progress());
    }
    match experiment.outcome() {
        Some(Outcome::Aborted(abort)) => Err(SimulatedError::Aborted(abort)),
        _ => {
            let mut record = experiment.record().clone();
            record.bear(machine, axis, &positions);
            Ok((analyse(&record)?, record))
        }
    }
}
