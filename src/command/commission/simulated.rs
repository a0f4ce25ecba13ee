//! The experiment with a simulated machine, one axis after the other, in one process and as fast as the computer
//! allows.

use control_proc::commission::{Experiment, ExperimentOptions, Outcome, Phase, analyse};
use pipeline::{
    machine::{Commissioned, Machine},
    message::ValveCommand,
};
use plant_sim::PlantSim;
use sensor_proc::Acquisition;

use crate::failure::Failure;

/// Commissions the axes with these indices. Each experiment starts with the machine in its first state. `seed` is that
/// of the noise of the encoders; `show` gets axis, phase and progress at every tick.
///
/// # Errors
/// The machine cannot be simulated, a bound was met, or a record has no model. The error names the axis.
pub fn commission_simulated(
    machine: &Machine,
    axes: &[usize],
    seed: u64,
    options: &ExperimentOptions,
    mut show: impl FnMut(usize, Phase, f64),
) -> Result<Vec<Commissioned>, Failure> {
    let one = |axis: &usize| commission(machine, *axis, seed, options, |phase, part| show(*axis, phase, part));
    axes.iter().map(one).collect()
}

fn commission(
    machine: &Machine,
    axis: usize,
    seed: u64,
    options: &ExperimentOptions,
    mut show: impl FnMut(Phase, f64),
) -> Result<Commissioned, Failure> {
    let name = &machine.axes[axis].name;
    let mut plant = PlantSim::new(machine, seed).map_err(Failure::usage)?;
    let mut acquisition = Acquisition::new(machine);
    let mut experiment = Experiment::new(&machine.axes[axis], machine.timing.period, options);
    let mut command = ValveCommand::default();
    for tick in 0.. {
        let sample = acquisition.update(tick, Some(&plant.read()));
        command.axes[axis].command = experiment.update(Some(&sample.axes[axis]));
        if experiment.outcome().is_some() {
            break;
        }
        plant.command(&command);
        plant.advance(machine.timing.period);
        show(experiment.phase(), experiment.progress());
    }
    if let Some(Outcome::Aborted(abort)) = experiment.outcome() {
        return Err(Failure::run(format!("axis.{name}: ended, valve neutral: {abort}")));
    }
    analyse(experiment.record()).map_err(|error| Failure::run(error).about(format!("axis.{name}")))
}
