//! The closed loop on the simulated machine, with all cores in one process, observed at the plant.

mod end_stops;
mod faults;
mod hold;
mod joint_sensors;

use std::sync::OnceLock;

use control_proc::Controller;
use ident_proc::Identifiers;
use pipeline::{
    machine::{GREY_BOX_MEMORY, Law, Machine, ModelChoice, ReferenceSource, Scenario, model_settings},
    message::{CoefficientSnapshot, EncoderReading, EncoderSample, Reference, ValveCommand},
};
use plant_sim::PlantSim;
use sensor_proc::Acquisition;

use crate::harness::{FOUR_AXES, cli};

/// The scenarios of the closed loop.
fn scenarios() -> Vec<Scenario> {
    Scenario::built_in().into_iter().filter(|scenario| scenario.commands.is_empty()).collect()
}

/// Settings that commissioning finds for the four axes. It is run once for all tests.
fn commissioned() -> &'static [(String, String)] {
    static FOUND: OnceLock<Vec<(String, String)>> = OnceLock::new();
    FOUND.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let output = cli::run(folder.path(), &["commission", FOUR_AXES, "--scenario", "nominal", "--duration", "120s"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        model_settings(&folder.path().join("model.toml")).unwrap()
    })
}

/// The four axes in a scenario, commissioned, with feed-forward, this choice of model under predictive control, and
/// references of the test.
fn machine(scenario: &str, model: ModelChoice, reference: impl Fn((f64, f64)) -> ReferenceSource) -> Machine {
    let mut machine = machine_as_chosen(scenario, reference);
    for axis in &mut machine.axes {
        (axis.control.model, axis.control.law) = (model, Law::Predictive);
        (axis.identification.memory, axis.identification.hysteresis) = (GREY_BOX_MEMORY, 0.0);
    }
    machine
}

/// The four axes in a scenario, commissioned, with feed-forward, model and law that commissioning has chosen, and
/// references of the test.
fn machine_as_chosen(scenario: &str, reference: impl Fn((f64, f64)) -> ReferenceSource) -> Machine {
    let scenario = ("scenario".to_owned(), scenario.to_owned());
    let mut machine = Machine::four_axes(&[commissioned(), &[scenario]].concat()).unwrap();
    for axis in &mut machine.axes {
        axis.control.feedforward = true;
        axis.reference = reference(axis.soft_limits);
    }
    machine
}

/// The closed loop: plant, acquisition, identification, control.
#[derive(Clone)]
struct ClosedLoop {
    machine: Machine,
    plant: PlantSim,
    acquisition: Acquisition,
    identifiers: Identifiers,
    controller: Controller,
    /// Sample of the last tick.
    sample: EncoderSample,
    command: Option<ValveCommand>,
    snapshot: Option<CoefficientSnapshot>,
    tick: u64,
}

impl ClosedLoop {
    fn new(machine: Machine, seed: u64) -> Self {
        let mut controller = Controller::new(&machine).unwrap();
        controller.arm();
        Self {
            plant: PlantSim::new(&machine, seed).unwrap(),
            acquisition: Acquisition::new(&machine),
            identifiers: Identifiers::new(&machine),
            controller,
            machine,
            sample: EncoderSample::default(),
            command: None,
            snapshot: None,
            tick: 0,
        }
    }

    /// Works one tick in the order of the pipeline. A command is made with the model of the tick before.
    fn tick(&mut self, reference: Option<&Reference>) -> ValveCommand {
        self.tick_with(reference, |_| ())
    }

    /// Works one tick with a reading that `change` may spoil.
    fn tick_with(&mut self, reference: Option<&Reference>, change: impl FnOnce(&mut EncoderReading)) -> ValveCommand {
        if let Some(command) = &self.command {
            self.plant.command(command);
            self.plant.advance(self.machine.timing.period);
        }
        let mut reading = self.plant.read();
        change(&mut reading);
        let sample = self.acquisition.update(self.tick, Some(&reading));
        self.sample = sample;
        let before = self.snapshot;
        self.identifiers.update(&sample, self.command.as_ref(), self.snapshot.get_or_insert_default());
        let command = self.controller.update(&sample, before.as_ref(), reference);
        self.command = Some(command);
        self.tick += 1;
        command
    }
}
