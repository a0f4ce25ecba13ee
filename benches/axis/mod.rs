//! Time of one sample of one axis: everything between a measured position and a model with its errors.
//!
//! Each sample is timed alone, because not all samples do the same work. The times include the time of reading the
//! clock. The identifiers take turns of some samples each, so that a busy computer disturbs all of them equally.

use std::hint::black_box;

use ident_proc::Identifier;
use pipeline::{
    hammerstein::Structure,
    machine::{Estimator, Form},
};
use serde_json::{Value, json};

use crate::{
    contest::{Contestant, head},
    data,
};

const TRAINING: usize = 2400;
const HORIZON: usize = 25;
/// Samples that one identifier learns from before the next one takes its turn.
const TURN: usize = 64;
/// The automatic estimator, whose time has an aim.
pub const AUTO: &str = "auto";

/// Times `samples` samples after the training; prints the table and returns it.
pub fn compare(samples: usize) -> Vec<Value> {
    let (machine, record) = data::record(TRAINING + samples);
    let contestant = |(name, estimator, form)| {
        let mut settings = machine.axes[0].identification.clone();
        (settings.structure, settings.training, settings.horizon) = (Structure::PAPER, TRAINING, HORIZON);
        (settings.estimator, settings.form) = (estimator, form);
        let mut identifier = Identifier::new(&settings);
        record[..TRAINING].iter().for_each(|&(y, applied)| identifier.update(Some(y), applied));
        Contestant::new(name, identifier)
    };
    let mut contestants = [
        (AUTO, Estimator::Auto, Form::Linear),
        ("rules, linear", Estimator::Rules, Form::Linear),
        ("rules, full", Estimator::Rules, Form::Full),
    ]
    .map(contestant);
    let mut clock = Contestant::new("the clock alone", ());
    for (round, turn) in record[TRAINING..].chunks(TURN).enumerate() {
        for k in 0..contestants.len() {
            let contestant = &mut contestants[(round + k) % 3];
            for &(y, applied) in turn {
                contestant.time(1, |identifier| identifier.update(black_box(Some(y)), black_box(applied)));
            }
        }
        turn.iter().for_each(|_| clock.time(1, |()| ()));
    }
    for Contestant { name, subject, .. } in &contestants {
        let snapshot = subject.snapshot();
        assert_eq!(snapshot.updates, samples as u64, "{name} did not learn from every sample");
        assert!(snapshot.adaptive.is_finite(), "{name} has coefficients that are not finite");
    }
    table(contestants, clock)
}

fn table(contestants: [Contestant<Identifier>; 3], clock: Contestant<()>) -> Vec<Value> {
    head("one axis, one sample", "       mean / linear");
    let all = contestants.map(Contestant::figures);
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
    let (name, clock) = clock.figures();
    clock.print(&name);
    println!(" {:>10.1}", clock.mean);
    figures.push(clock.json(&name));
    figures
}
