//! Commissioning of simulated axes: the accuracy of the model, and the bounds of the experiment.

mod accuracy;
mod bounds;

use std::time::Duration;

use control_proc::commission::{Experiment, ExperimentOptions, Outcome};
use pipeline::{machine::Machine, message::ValveCommand};
use plant_sim::PlantSim;
use sensor_proc::Acquisition;

/// The built-in machine under one of its scenarios.
fn under(scenario: &str) -> Machine {
    Machine::four_axes(&[("scenario".to_owned(), scenario.to_owned())]).unwrap()
}

/// An experiment of half the usual time: what is found from it is found from a longer one.
fn minute() -> ExperimentOptions {
    ExperimentOptions { duration: Duration::from_secs(60), ..ExperimentOptions::default() }
}

/// What `run` returns for every case, in their order. The cases are spread over the computer's cores.
fn in_parallel<T: Sync, R: Send>(cases: &[T], run: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let run = &run;
    std::thread::scope(|scope| {
        let parts = cases.chunks(cases.len().div_ceil(cores));
        let threads: Vec<_> = parts.map(|part| scope.spawn(move || part.iter().map(run).collect::<Vec<R>>())).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    })
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
        let mut experiment = Experiment::new(&machine.axes[axis], &machine.timing, options);
        let (mut tick, mut beyond) = (0, f64::NEG_INFINITY);
        // The loop goes on for a second after the end.
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
