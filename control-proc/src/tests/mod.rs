//! Tests of the whole core: closed loops with a small simulated axis, faults, poisoned models, bad references.

mod feedback;
mod gains;
mod handover;
mod hunting;
mod latches;
pub mod models;
mod modes;
mod motion;
pub mod plant;
mod poison;
mod references;
mod slowing;
mod snapshots;
mod supervision;
mod table_2;
mod teeth;

use std::path::Path;

use pipeline::{
    machine::Machine,
    message::{CoefficientSnapshot, EncoderSample, Reference, ValveCommand},
};

use crate::Controller;
use plant::Actuator;

/// `count` equal axes of 10 ms that follow a sine; nk 5, na 2, nb 0, order 3.
pub fn machine_text(count: usize) -> String {
    let mut text = "name = \"test\"\n[timing]\nperiod = \"10ms\"\n[source]\nkind = \"sim\"\n[fuzzy]\n\
                    error_universe = 0.004\nvariation_universe = 0.002\n"
        .to_owned();
    let built_in = |from: &str, to: &str| {
        let built_in = pipeline::machine::FOUR_AXES;
        let start = built_in.find(from).unwrap();
        let length = built_in[start..].find(to).unwrap();
        built_in[start..start + length].to_owned()
    };
    text += &built_in("[supply]", "# ---");
    let plant = built_in("[axis.boom.plant]", "# ---");
    for i in 0..count {
        text += &format!(
            "[axis.a{i}]\nstroke = 1.334\nmax_speed = 1.0\nsoft_limits = [0.05, 1.284]\n\
             [axis.a{i}.encoder]\nresolution = 1e-4\n\
             [axis.a{i}.identification]\nna = 2\nnb = 0\nnk = 5\norder = 3\ntraining = \"8s\"\nestimator = \"rules\"\n\
             [axis.a{i}.control]\nkp = 4.0\nki = 1.0\ndead_band_extend = 0.08\ndead_band_retract = 0.07\n\
             command_limit = 1.0\nfollowing_error = 0.5\ncommand_rate = 10.0\n\
             [axis.a{i}.reference]\nkind = \"sines\"\ncenter = 0.65\n\
             sines = [{{ amplitude = 0.12, frequency = 0.3, phase = 0.4 }}]\n"
        );
        text += &plant.replace("axis.boom", &format!("axis.a{i}"));
    }
    text
}

/// The machine of [`machine_text`].
pub fn machine(count: usize) -> Machine {
    Machine::parse(&machine_text(count), "test.toml", Path::new("."), &[]).unwrap()
}

/// A machine of one axis with a line of its text replaced.
fn machine_with(from: &str, to: &str) -> Machine {
    let text = machine_text(1);
    assert!(text.contains(from), "{from}");
    Machine::parse(&text.replace(from, to), "test.toml", Path::new("."), &[]).unwrap()
}

const SINES: &str = "kind = \"sines\"\ncenter = 0.65\nsines = [{ amplitude = 0.12, frequency = 0.3, phase = 0.4 }]\n";

fn sample(sequence: u64, positions: &[f64]) -> EncoderSample {
    let mut sample = EncoderSample::default();
    (sample.header.sequence, sample.header.axis_count) = (sequence, positions.len() as u32);
    for (axis, position) in sample.axes.iter_mut().zip(positions) {
        axis.position = *position;
    }
    sample
}

fn snapshot(sequence: u64, model: pipeline::hammerstein::Coefficients) -> CoefficientSnapshot {
    let mut snapshot = CoefficientSnapshot::default();
    (snapshot.header.sequence, snapshot.header.axis_count) = (sequence, 8);
    for axis in &mut snapshot.axes {
        (axis.adaptive, axis.classical) = (model, model);
        (axis.command_low, axis.command_high) = (-1.0, 1.0);
    }
    snapshot
}

/// One axis in a closed loop, whose inputs a test may change.
struct Loop {
    controller: Controller,
    plant: Actuator,
    sequence: u64,
}

impl Loop {
    fn new(machine: &Machine, dead_band: f64) -> Self {
        let mut controller = Controller::new(machine).unwrap();
        controller.arm();
        Self { controller, plant: Actuator::new(0.6, dead_band), sequence: 0 }
    }

    /// One tick; `change` may change the sample.
    fn tick_with(
        &mut self,
        snapshot: Option<&CoefficientSnapshot>,
        reference: Option<&Reference>,
        change: impl FnOnce(&mut EncoderSample),
    ) -> ValveCommand {
        // An encoder of 0.1 mm.
        let mut sample = sample(self.sequence, &[(self.plant.position * 1e4).round() / 1e4]);
        change(&mut sample);
        let command = self.controller.update(&sample, snapshot, reference);
        self.plant.step(command.axes[0].command);
        self.sequence += 1;
        command
    }

    fn tick(&mut self, snapshot: Option<&CoefficientSnapshot>) -> ValveCommand {
        self.tick_with(snapshot, None, |_| ())
    }

    /// Runs for so many ticks, with a new snapshot of the model at every tick.
    fn run(&mut self, ticks: usize, model: Option<pipeline::hammerstein::Coefficients>) -> Vec<ValveCommand> {
        (0..ticks)
            .map(|_| {
                let fresh = model.map(|model| snapshot(self.sequence.saturating_sub(1), model));
                self.tick(fresh.as_ref())
            })
            .collect()
    }
}
