//! What one sample of one axis costs: everything between a measured position and a model with its errors.
//!
//! Each sample is timed by itself, since not all do the same work, and the clock's own time is in it. The identifiers
//! take turns of some samples, so that a busy machine disturbs all alike.

use std::{hint::black_box, time::Instant};

use ident_proc::Identifier;
use pipeline::{
    hammerstein::Structure,
    machine::{Estimator, Form},
};
use serde_json::{Value, json};

use crate::{
    data,
    figures::{Figures, head},
};

const TRAINING: usize = 2400;
const HORIZON: usize = 25;
/// Samples that one identifier takes in before it is the turn of the next.
const TURN: usize = 64;
/// The automatic estimator, which the aim is for.
pub const AUTO: &str = "auto";

struct Contestant {
    name: &'static str,
    identifier: Identifier,
    times: Vec<f64>,
}

/// Times `samples` samples after the training; prints the table and returns it.
pub fn compare(samples: usize) -> Vec<Value> {
    let (machine, record) = data::record(TRAINING + samples);
    let contestant = |(name, estimator, form)| {
        let mut settings = machine.axes[0].identification.clone();
        (settings.structure, settings.training, settings.horizon) = (Structure::PAPER, TRAINING, HORIZON);
        (settings.estimator, settings.form) = (estimator, form);
        let mut identifier = Identifier::new(&settings);
        record[..TRAINING].iter().for_each(|&(y, applied)| identifier.update(Some(y), applied));
        Contestant { name, identifier, times: Vec::with_capacity(samples) }
    };
    let mut contestants = [
        (AUTO, Estimator::Auto, Form::Linear),
        ("paper, linear", Estimator::Paper, Form::Linear),
        ("paper, full", Estimator::Paper, Form::Full),
    ]
    .map(contestant);
    let mut clock = Vec::with_capacity(samples);
    for (round, turn) in record[TRAINING..].chunks(TURN).enumerate() {
        for k in 0..contestants.len() {
            let Contestant { identifier, times, .. } = &mut contestants[(round + k) % 3];
            for &(y, applied) in turn {
                let start = Instant::now();
                identifier.update(black_box(Some(y)), black_box(applied));
                times.push(start.elapsed().as_nanos() as f64);
            }
        }
        for _ in turn {
            let start = Instant::now();
            clock.push(start.elapsed().as_nanos() as f64);
        }
    }
    for Contestant { name, identifier, .. } in &contestants {
        let snapshot = identifier.snapshot();
        assert_eq!(snapshot.updates, samples as u64, "{name} did not learn from every sample");
        assert!(snapshot.adaptive.is_finite(), "{name} learned nothing of use");
    }
    table(contestants, clock)
}

fn table(contestants: [Contestant; 3], clock: Vec<f64>) -> Vec<Value> {
    head("one axis, one sample", "       mean / linear");
    let all: Vec<_> =
        contestants.into_iter().map(|Contestant { name, times, .. }| (name, Figures::new(times))).collect();
    let linear = all[1].1.p50;
    let figures = all.iter().map(|(name, figures)| {
        let to_linear = figures.p50 / linear;
        figures.print(name);
        println!(" {:>10.1} {to_linear:>8.2}", figures.mean);
        let mut json = figures.json(name);
        json["to_paper_linear"] = json!(to_linear);
        json
    });
    let mut figures: Vec<Value> = figures.collect();
    let clock = Figures::new(clock);
    clock.print("the clock alone");
    println!(" {:>10.1}", clock.mean);
    figures.push(clock.json("the clock alone"));
    figures
}
