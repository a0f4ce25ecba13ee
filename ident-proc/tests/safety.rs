//! Events that must not harm the estimate: rest, one direction only, an outlier, a gap, an encoder with a new zero.

use ident_proc::Identifier;
use pipeline::{
    hammerstein::{Coefficients, Structure},
    machine::{Estimator, Form, Identification, Machine},
    message::{AxisSnapshot, model_fault},
};

const TRAINING: usize = 2000;
const HORIZON: usize = 25;
/// One count of the encoder, m.
const COUNT: f64 = 1e-4;

/// A fixed pseudo-random sequence between -1 and 1.
fn noise(i: usize) -> f64 {
    let x = (i as f64 * 12.9898).sin() * 43758.5453;
    2.0 * (x - x.floor()) - 1.0
}

fn settings(estimator: Estimator) -> Identification {
    let built_in = Machine::four_axes(&[]).unwrap().axes[0].identification.clone();
    let structure = Structure::PAPER;
    Identification { structure, training: TRAINING, horizon: HORIZON, estimator, form: Form::Linear, ..built_in }
}

/// A position that integrates the flow of a valve, measured by an encoder.
struct Plant {
    gains: [f64; 2],
    position: f64,
    speed: f64,
    before: f64,
    samples: usize,
}

impl Plant {
    fn new() -> Self {
        Self { gains: [0.002, 0.003], position: 0.5, speed: 0.0, before: 0.0, samples: 0 }
    }

    /// One sample. The command reaches the position two samples later. Returns the measured position.
    fn step(&mut self, command: f64) -> f64 {
        let x = self.before + 0.3 * self.before.abs() * self.before;
        self.before = command;
        self.speed = 0.7 * self.speed + 0.3 * x * self.gains[usize::from(x < 0.0)];
        self.position += self.speed;
        self.samples += 1;
        ((self.position + 0.3 * COUNT * noise(self.samples)) / COUNT).round() * COUNT
    }
}

/// A command that keeps the position near its middle and excites everything.
fn exciting(k: usize, position: f64) -> f64 {
    let target = 0.5 + 0.2 * (k as f64 * 0.013).sin() + 0.1 * (k as f64 * 0.041).sin() + 0.05 * (k as f64 * 0.11).sin();
    (10.0 * (target - position) + 0.1 * noise(k / 7)).clamp(-1.0, 1.0)
}

struct Run {
    identifier: Identifier,
    plant: Plant,
    output: f64,
    /// Samples of full excitation so far. Whatever happens between them, their excitation is the same.
    k: usize,
}

impl Run {
    /// Trained, and adapted for a while.
    fn new(estimator: Estimator) -> Self {
        let mut run =
            Self { identifier: Identifier::new(&settings(estimator)), plant: Plant::new(), output: 0.5, k: 0 };
        run.excite(TRAINING + 1000);
        run
    }

    fn sample(&mut self, command: f64) {
        self.output = self.plant.step(command);
        self.identifier.update(Some(self.output), Some(command));
    }

    fn excite(&mut self, samples: usize) {
        for _ in 0..samples {
            self.sample(exciting(self.k, self.output));
            self.k += 1;
        }
    }

    fn snapshot(&self) -> AxisSnapshot {
        self.identifier.snapshot()
    }

    /// Root mean square of the h-step errors over the next samples of full excitation.
    fn h_step(&mut self, samples: usize) -> f64 {
        let before = self.snapshot().adaptive_errors.h_step;
        self.excite(samples);
        let after = self.snapshot().adaptive_errors.h_step;
        let sum = |s: pipeline::statistics::ErrorStatistics| s.m2 + s.count as f64 * s.mean * s.mean;
        ((sum(after) - sum(before)) / (after.count - before.count) as f64).sqrt()
    }
}

/// The h-step errors over the first 1000 samples of full excitation after `disturb`, and over the 20 000 after those,
/// in parts of the errors without `disturb`.
fn harm(estimator: Estimator, disturb: impl Fn(&mut Run)) -> [f64; 2] {
    let (mut with, mut without) = (Run::new(estimator), Run::new(estimator));
    disturb(&mut with);
    [1000, 20_000].map(|samples| {
        let (with, without) = (with.h_step(samples), without.h_step(samples));
        println!("{estimator}: h-step error {with:.3e} after it, {without:.3e} without");
        with / without
    })
}

#[test]
fn ten_million_samples_at_rest_do_no_harm() {
    let rest = |run: &mut Run| {
        for _ in 0..10_000_000 {
            run.sample(0.0);
        }
        assert_ne!(run.snapshot().faults & model_fault::RESTING, 0);
        assert!(run.snapshot().since_update > 9_000_000);
    };
    let [first, later] = harm(Estimator::Auto, rest);
    assert!(first < 1.25 && later < 1.01, "{first} {later}");
}

#[test]
fn a_million_samples_in_one_direction_do_no_harm() {
    // All commands extend the axis. From time to time it is moved back during a gap.
    let one_direction = |run: &mut Run| {
        for k in 0..1_000_000 {
            let command = 0.4 + 0.3 * (k as f64 * 0.013).sin() + 0.15 * (k as f64 * 0.11).sin() + 0.1 * noise(k / 7);
            run.sample(command.max(0.0));
            if run.plant.position > 1.0 {
                run.plant.position = 0.1;
                run.identifier.update(None, None);
            }
        }
        assert_ne!(run.snapshot().faults & model_fault::ONE_SIDED, 0);
        run.plant.position = 0.5;
        run.output = 0.5;
        run.identifier.update(None, None);
    };
    let [first, later] = harm(Estimator::Auto, one_direction);
    // What is known of the other direction is a million samples old, and belongs to a model that has changed since.
    assert!(first < 2.5 && later < 1.02, "{first} {later}");
}

#[test]
fn one_outlier_changes_the_errors_by_less_than_one_percent() {
    let run = |outlier: Option<f64>| {
        let mut run = Run::new(Estimator::Auto);
        let sigma = run.snapshot().adaptive_errors.one_step.sigma();
        let before = run.snapshot();
        if let Some(size) = outlier {
            let command = exciting(run.k, run.output);
            let sound = run.plant.step(command);
            run.identifier.update(Some(sound + size * sigma), Some(command));
            (run.k, run.output) = (run.k + 1, sound);
            let after = run.snapshot();
            assert_ne!(after.faults & model_fault::OUTLIER, 0);
            assert_eq!((after.outliers, after.skipped), (before.outliers + 1, before.skipped + 1));
        } else {
            run.excite(1);
        }
        run.excite(3000);
        run.snapshot().adaptive_errors.h_step.sigma()
    };
    let without = run(None);
    for size in [1000.0, -1000.0, 1e9] {
        let with = run(Some(size));
        println!("{size} sigma: {with} against {without}");
        assert!((with / without - 1.0).abs() < 0.01, "{size}: {with} {without}");
    }
}

/// The snapshot after a training and 1000 more samples. The axis rests for the first 200 samples. One sample in the
/// place of each of `outliers` lies 0.3 m off.
fn trained_with(outliers: &[usize]) -> AxisSnapshot {
    let mut identifier = Identifier::new(&settings(Estimator::Auto));
    let (mut plant, mut output) = (Plant::new(), 0.5);
    for k in 0..TRAINING + 1000 {
        let command = if k < 200 { 0.0 } else { exciting(k, output) };
        output = plant.step(command);
        let measured = if outliers.contains(&k) { output + 0.3 } else { output };
        identifier.update(Some(measured), Some(command));
    }
    identifier.snapshot()
}

#[test]
fn an_outlier_in_the_training_does_not_spoil_the_classical_model() {
    let (with, without) = (trained_with(&[700]), trained_with(&[]));
    assert_eq!((with.outliers, without.outliers), (1, 0));
    let ratio = with.classical_errors.h_step.sigma() / without.classical_errors.h_step.sigma();
    assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
}

/// Before an axis has moved for a while, nothing tells an outlier from motion.
#[test]
fn an_outlier_among_the_first_samples_is_found_once_the_usual_errors_are_known() {
    let without = trained_with(&[]);
    for outliers in [&[0][..], &[1], &[2], &[3], &[0, 1], &[120], &[230], &[50, 250]] {
        let with = trained_with(outliers);
        assert!(with.outliers >= 1 && with.skipped > without.skipped, "{outliers:?}");
        let ratio = |errors: fn(&AxisSnapshot) -> f64| errors(&with) / errors(&without);
        let classical = ratio(|snapshot| snapshot.classical_errors.h_step.sigma());
        let adaptive = ratio(|snapshot| snapshot.adaptive_errors.h_step.sigma());
        assert!(classical < 1.1 && adaptive < 1.02, "{outliers:?}: {classical} {adaptive}");
    }
}

#[test]
fn an_encoder_with_a_new_zero_is_believed_after_a_few_samples() {
    let mut run = Run::new(Estimator::Auto);
    let before = run.snapshot();
    for _ in 0..200 {
        let command = exciting(run.k, run.output);
        run.output = run.plant.step(command);
        run.k += 1;
        run.identifier.update(Some(run.output + 0.3), Some(command));
    }
    let after = run.snapshot();
    assert_eq!(after.outliers - before.outliers, 5);
    assert!(after.updates - before.updates > 180);
    assert!(after.adaptive_errors.h_step.max < 0.05, "{}", after.adaptive_errors.h_step.max);
}

#[test]
fn the_gain_ratio_of_each_direction_is_found() {
    let mut run = Run::new(Estimator::Auto);
    run.plant.gains = [0.001, 0.003];
    run.excite(3000);
    let [extend, retract] = run.snapshot().gain_ratio;
    assert!((extend - 0.5).abs() < 0.1 && (retract - 1.0).abs() < 0.15, "{extend} {retract}");
    assert_eq!(run.snapshot().faults, 0);
    run.plant.gains = [0.0002, 0.003];
    run.excite(3000);
    assert_ne!(run.snapshot().faults & model_fault::GAIN, 0, "{:?}", run.snapshot().gain_ratio);
}

#[test]
fn every_estimator_stays_finite_at_rest_and_in_one_direction() {
    for text in
        ["paper", "rules", "constant:0.75", "fuzzy:0.75", "fortescue:50", "directional:0.9", "window:100", "auto"]
    {
        let mut run = Run::new(text.parse().unwrap());
        (0..100_000).for_each(|_| run.sample(0.0));
        (0..500).for_each(|k| run.sample(0.05 + 0.04 * noise(k)));
        run.excite(1000);
        let snapshot = run.snapshot();
        assert!(snapshot.adaptive.is_finite(), "{text}: {:?}", snapshot.adaptive);
        assert_eq!(snapshot.faults & model_fault::NOT_FINITE, 0, "{text}");
        assert!(Coefficients::is_finite(&snapshot.classical));
    }
}
