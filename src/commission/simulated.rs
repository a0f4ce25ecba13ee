//! The experiment with a simulated machine, axis by axis, in one process and as fast as it goes.

use control_proc::commission::{Experiment, Options, Outcome, Phase, analyse};
use pipeline::{
    machine::{Commissioned, Machine},
    message::ValveCommand,
};
use plant_sim::PlantSim;
use sensor_proc::source::Acquisition;

use crate::failure::Failure;

/// What commissioning finds of every axis, in the machine's order. `seed` makes the encoders' noise.
///
/// # Errors
/// The machine cannot be simulated, a bound was met, or a record has no model; with the name of the axis.
pub fn commission_simulated(machine: &Machine, seed: u64, options: &Options) -> Result<Vec<Commissioned>, Failure> {
    (0..machine.axes.len()).map(|axis| commission_axis(machine, axis, seed, options, |_, _| ())).collect()
}

/// The same of one axis, from the machine's begin; `show` gets phase and progress at every tick.
pub fn commission_axis(
    machine: &Machine,
    axis: usize,
    seed: u64,
    options: &Options,
    mut show: impl FnMut(Phase, f64),
) -> Result<Commissioned, Failure> {
    let name = &machine.axes[axis].name;
    let failed = |error: &dyn std::fmt::Display| Failure::Run(format!("axis.{name}: {error}"));
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
    match experiment.outcome() {
        Some(Outcome::Aborted(abort)) => {
            return Err(Failure::Run(format!("axis.{name}: ended, valve neutral: {abort}")));
        }
        Some(Outcome::Finished) | None => {}
    }
    analyse(experiment.record()).map_err(|error| failed(&error))
}
