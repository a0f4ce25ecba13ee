//! Time of one update: the recursive estimator alone, a whole axis of ident-proc, and the controller.
//!
//! `cargo bench --bench update`; criterion prints the median between its bounds.
//!
//! To compare two builds side by side, keep the figures of the first one under a name and compare the second one with
//! them. Both commands need one folder for the figures:
//!
//! ```sh
//! export CRITERION_HOME=/tmp/update-figures
//! cargo bench --bench update -- --save-baseline before      # in the folder of the one build
//! cargo bench --bench update -- --baseline before           # in the folder of the other build
//! ```
//!
//! The names of groups and benchmarks are what criterion compares by. They must therefore not change.

mod data;

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use ident_proc::{Identifier, least_squares::Triangle, recursive::RecursiveLeastSquares};
use pipeline::machine::{Estimator, Form};

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

/// Samples of the training and of one round of the references.
const RECORD: usize = 800 + 10_000;

fn identifier(criterion: &mut Criterion) {
    let (machine, record) = data::record(RECORD);
    let mut group = criterion.benchmark_group("ident-proc, one axis, one sample, all errors and snapshot included");
    let cases = [
        ("rules, n = 5 (linear form)", Estimator::Rules, Form::Linear),
        ("rules, n = 15 (full form)", Estimator::Rules, Form::Full),
        ("auto", Estimator::Auto, Form::Linear),
    ];
    for (name, estimator, form) in cases {
        let mut settings = machine.axes[0].identification.clone();
        (settings.estimator, settings.form) = (estimator, form);
        let training = settings.training;
        let mut identifier = Identifier::new(&settings);
        let mut k = 0;
        let mut step = |identifier: &mut Identifier| {
            let (position, applied) = record[k];
            k = if k + 1 == RECORD { training } else { k + 1 };
            identifier.update(Some(black_box(position)), black_box(applied));
            identifier.snapshot()
        };
        (0..training + 400).for_each(|_| {
            step(&mut identifier);
        });
        group.bench_function(name, |bencher| bencher.iter(|| step(&mut identifier)));
    }
    group.finish();
}

fn controller(criterion: &mut Criterion) {
    // The last sample of a run that is longer than the training, and the snapshot that the controller had for it.
    let (mut last, mut before) = (Default::default(), Default::default());
    let (_, trained) = data::run(1200, |sample, _, snapshot| {
        before = std::mem::replace(&mut last, (*sample, *snapshot));
    });
    let (sample, snapshot) = (last.0, before.1);
    let mut next = sample;
    next.header.sequence += 1;
    next.axes.iter_mut().for_each(|axis| axis.position += 1e-4);
    let mut group = criterion.benchmark_group("control-proc, one sample");
    group.bench_function("four axes, predictive", |bencher| {
        bencher.iter_batched_ref(
            || trained.clone(),
            |controller| controller.update(black_box(&next), Some(black_box(&snapshot)), None),
            BatchSize::SmallInput,
        );
    });
    group.bench_function("four axes, fallback", |bencher| {
        bencher.iter_batched_ref(
            || trained.clone(),
            |controller| controller.update(black_box(&next), None, None),
            BatchSize::SmallInput,
        );
    });
    group.finish();
}

criterion_group!(benches, recursive, identifier, controller);
criterion_main!(benches);
