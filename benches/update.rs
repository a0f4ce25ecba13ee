//! What one update costs: the recursive estimator alone, a whole axis of ident-proc, and the controller.
//!
//! `cargo bench --bench update`; criterion prints the median between its bounds.

mod data;

use std::hint::black_box;

use control_proc::Controller;
use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use ident_proc::{Identifier, Identifiers, recursive::RecursiveLeastSquares, triangle::Triangle};
use pipeline::{
    machine::{Forgetting, Form, Machine},
    message::{CoefficientSnapshot, EncoderSample, ValveCommand},
};
use plant_sim::PlantSim;
use sensor_proc::source::Acquisition;

fn recursive(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("recursive least squares, one update");
    for n in [5, 15, 40] {
        let rows = data::rows(n);
        let mut data = Triangle::new(n);
        rows.iter().take(200).for_each(|(phi, y)| data.add(phi, *y));
        let mut estimator = RecursiveLeastSquares::new(n);
        estimator.start(&data, &vec![false; n]);
        let mut k = 0;
        group.bench_function(format!("n = {n}"), |bencher| {
            bencher.iter(|| {
                let (phi, y) = &rows[k % rows.len()];
                k += 1;
                estimator.update(black_box(phi), black_box(*y), 0.995)
            });
        });
    }
    group.finish();
}

/// The messages of a simulated run of the built-in machine, long enough to have trained.
struct Recording {
    machine: Machine,
    samples: Vec<EncoderSample>,
    commands: Vec<ValveCommand>,
    snapshots: Vec<CoefficientSnapshot>,
    controller: Controller,
}

fn recording() -> Recording {
    let machine = Machine::load(None, &[]).expect("the built-in machine");
    let mut plant = PlantSim::new(&machine, 1).expect("the built-in plant");
    let mut acquisition = Acquisition::new(&machine);
    let mut identifiers = Identifiers::new(&machine);
    let mut controller = Controller::new(&machine).expect("the built-in references");
    controller.arm();
    let (mut samples, mut commands, mut snapshots) = (Vec::new(), Vec::new(), Vec::new());
    for tick in 0..1200 {
        let sample = acquisition.update(tick, Some(&plant.read()));
        let mut snapshot = CoefficientSnapshot::default();
        identifiers.update(&sample, commands.last(), &mut snapshot);
        let command = controller.update(&sample, snapshots.last(), None);
        plant.command(&command);
        plant.advance(machine.timing.period);
        samples.push(sample);
        commands.push(command);
        snapshots.push(snapshot);
    }
    Recording { machine, samples, commands, snapshots, controller }
}

fn identifier(criterion: &mut Criterion) {
    let recording = recording();
    let mut group = criterion.benchmark_group("ident-proc, one axis, one sample, all errors and snapshot included");
    for (name, form) in [("n = 5 (linear form)", Form::Linear), ("n = 15 (full form)", Form::Full)] {
        let mut settings = recording.machine.axes[0].identification.clone();
        settings.form = form;
        settings.forgetting = Forgetting::Paper;
        let mut identifier = Identifier::new(&settings);
        let mut k = 0;
        let mut step = |identifier: &mut Identifier| {
            let sample = recording.samples[k % 1200].axes[0].position;
            // The record closes upon itself with one small jump, which the estimator has to take like any other.
            let applied = recording.commands[(k + 1199) % 1200].axes[0].command;
            k += 1;
            identifier.update(Some(black_box(sample)), Some(black_box(applied)));
            identifier.snapshot()
        };
        (0..1200).for_each(|_| {
            step(&mut identifier);
        });
        group.bench_function(name, |bencher| bencher.iter(|| step(&mut identifier)));
    }
    group.finish();
}

fn controller(criterion: &mut Criterion) {
    let recording = recording();
    let (sample, snapshot) = (recording.samples[1199], recording.snapshots[1198]);
    let mut next = sample;
    next.header.sequence += 1;
    next.axes.iter_mut().for_each(|axis| axis.position += 1e-4);
    let mut group = criterion.benchmark_group("control-proc, one sample");
    group.bench_function("four axes, predictive", |bencher| {
        bencher.iter_batched_ref(
            || recording.controller.clone(),
            |controller| controller.update(black_box(&next), Some(black_box(&snapshot)), None),
            BatchSize::SmallInput,
        );
    });
    group.bench_function("four axes, fallback", |bencher| {
        bencher.iter_batched_ref(
            || recording.controller.clone(),
            |controller| controller.update(black_box(&next), None, None),
            BatchSize::SmallInput,
        );
    });
    group.finish();
}

criterion_group!(benches, recursive, identifier, controller);
criterion_main!(benches);
