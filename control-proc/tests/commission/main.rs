//! Commissioning of simulated axes: what is found, what ends the experiment, and the command as a user runs it.

mod accuracy;
mod bounds;

use control_proc::commission::{Experiment, ExperimentOptions, Outcome};
use pipeline::{machine::Machine, message::ValveCommand};
use plant_sim::PlantSim;
use sensor_proc::Acquisition;

/// The built-in machine under one of its scenarios.
fn under(scenario: &str) -> Machine {
    Machine::load(None, &[("scenario".to_owned(), scenario.to_owned())]).unwrap()
}

/// An experiment with one axis of a simulated machine, to its end.
struct Run {
    experiment: Experiment,
    /// How far the true position was outside the window, m.
    beyond: f64,
}

impl Run {
    fn of(machine: &Machine, axis: usize, options: &ExperimentOptions, seed: u64) -> Self {
        let mut plant = PlantSim::new(machine, seed).unwrap();
        let mut acquisition = Acquisition::new(machine);
        let mut experiment = Experiment::new(&machine.axes[axis], machine.timing.period, options);
        let (mut tick, mut beyond) = (0, f64::NEG_INFINITY);
        // A second more, to see what comes after the end.
        let mut rest = 100;
        while rest > 0 {
            let sample = acquisition.update(tick, Some(&plant.read()));
            let mut command = ValveCommand::default();
            command.axes[axis].command = experiment.update(Some(&sample.axes[axis]));
            plant.command(&command);
            plant.advance(machine.timing.period);
            let position = plant.axes()[axis].position;
            let ((low, high), _) = experiment.window();
            beyond = beyond.max(low - position).max(position - high);
            tick += 1;
            rest -= usize::from(experiment.outcome().is_some());
        }
        Self { experiment, beyond }
    }

    fn expect_finished(self) -> Self {
        assert_eq!(self.experiment.outcome(), Some(Outcome::Finished), "{}", self.reason());
        self
    }

    fn reason(&self) -> String {
        match self.experiment.outcome() {
            Some(Outcome::Aborted(abort)) => abort.to_string(),
            other => format!("{other:?}"),
        }
    }
}
