//! Data of the benchmarks: regressors and outputs, which `peers.py` computes as well, and a simulated run.

use control_proc::Controller;
use ident_proc::Identifiers;
use pipeline::{
    machine::Machine,
    message::{CoefficientSnapshot, EncoderSample, ValveCommand},
};
use plant_sim::PlantSim;
use sensor_proc::Acquisition;

/// A bounded sequence that looks random.
fn noise(i: usize) -> f64 {
    let x = (i as f64 * 12.9898).sin() * 43758.5453;
    2.0 * (x - x.floor()) - 1.0
}

/// 1024 rows of a regression with `n` coefficients.
pub fn rows(n: usize) -> Vec<(Vec<f64>, f64)> {
    (0..1024)
        .map(|k| {
            let phi: Vec<f64> = (0..n).map(|j| noise(k * n + j)).collect();
            let y = phi.iter().enumerate().map(|(j, p)| p / (j + 1) as f64).sum::<f64>() + 0.01 * noise(k + 7);
            (phi, y)
        })
        .collect()
}

/// Runs the built-in machine under control for `samples` samples and shows sample, command and snapshot of each to
/// `see`. Returns the machine and the controller in its state after the last sample.
pub fn run(
    samples: u64,
    mut see: impl FnMut(&EncoderSample, &ValveCommand, &CoefficientSnapshot),
) -> (Machine, Controller) {
    let machine = Machine::four_axes(&[]).expect("the built-in machine");
    let mut plant = PlantSim::new(&machine, 1).expect("the built-in plant");
    let mut acquisition = Acquisition::new(&machine);
    let mut identifiers = Identifiers::new(&machine);
    let mut controller = Controller::new(&machine).expect("the built-in references");
    controller.arm();
    let (mut command, mut snapshot) = (None, None);
    for tick in 0..samples {
        let sample = acquisition.update(tick, Some(&plant.read()));
        let mut next = CoefficientSnapshot::default();
        identifiers.update(&sample, command.as_ref(), &mut next);
        let applied = controller.update(&sample, snapshot.as_ref(), None);
        plant.command(&applied);
        plant.advance(machine.timing.period);
        see(&sample, &applied, &next);
        (command, snapshot) = (Some(applied), Some(next));
    }
    (machine, controller)
}

/// y(k) and u(k-1) of the first axis of such a run; the first sample has no u(k-1). The references repeat every 10 000
/// samples.
pub fn record(samples: usize) -> (Machine, Vec<(f64, Option<f64>)>) {
    let (mut record, mut applied) = (Vec::with_capacity(samples), None);
    let (machine, _) = run(samples as u64, |sample, command, _| {
        record.push((sample.axes[0].position, applied));
        applied = Some(command.axes[0].command);
    });
    (machine, record)
}
