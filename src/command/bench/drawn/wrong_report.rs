//! The report on wrong models: what control by them costs, and how soon it ends.
//!
//! The ratios are those of [`super::report`], with the Smith predictor of the wrong model in the place of the model.
//! They are taken by the fallback with the wrong model, to which control is given back, and by the fallback with the
//! right model.

use serde::Serialize;

use super::{
    Choice,
    drive::Outcome,
    report::{Faults, Gain, LISTED, RunRow, ratios},
    rig::Rig,
    set::SetRow,
    wrong::{Kind, Misled, Triple, WrongModel},
};
use crate::report::table::{number, table};

/// Ratio of the rms errors from which on the wrong model must be noticed.
const POOR: f64 = 1.5;
/// Ratio of the largest errors that is too much.
const FAR: f64 = 2.0;
/// Time from the first tick by the model within which a poor model is to be noticed, s.
const SOON: f64 = 2.0;

/// All figures; SI units.
#[derive(Debug, Serialize)]
pub struct WrongReport {
    #[serde(flatten)]
    set: SetRow,
    /// Every kind, then all of them.
    kinds: Vec<KindRow>,
    runs: Vec<WrongRow>,
}

/// The runs with one kind of wrong model.
#[derive(Debug, Serialize)]
struct KindRow {
    kind: &'static str,
    runs: usize,
    /// Smith predictor with the wrong model by fallback with the wrong model.
    by_wrong: Comparison,
    /// Smith predictor with the wrong model by fallback with the right model.
    by_right: Comparison,
    /// Of the fallback with the right model.
    right: Faults,
    /// Of the fallback with the wrong model.
    fallback: Faults,
    smith: Faults,
    noticed: Noticed,
}

#[derive(Debug, Serialize)]
struct Comparison {
    #[serde(flatten)]
    gain: Gain,
    /// Runs with a ratio of the largest errors above 2.
    far: usize,
}

/// The runs with an rms error above 1.5 times that of the fallback with the wrong model, by when this was noticed.
#[derive(Debug, Default, Serialize)]
struct Noticed {
    soon: usize,
    later: usize,
    never: usize,
}

/// One task of one machine.
#[derive(Debug, Serialize)]
struct WrongRow {
    machine: u64,
    kind: &'static str,
    amount: String,
    change: &'static str,
    task: &'static str,
    /// Ratios of the rms errors and of the largest errors, by the fallback with the wrong model.
    by_wrong: (f64, f64),
    /// Ratios of the rms errors and of the largest errors, by the fallback with the right model.
    by_right: (f64, f64),
    /// Time from the first tick by the model to the first at which it was said to be worse than the fallback, s.
    noticed_s: Option<f64>,
    right: RunRow,
    fallback: RunRow,
    smith: RunRow,
}

/// A task of a machine, with its ratios.
struct Compared<'a> {
    rig: &'a Rig,
    wrong: &'a WrongModel,
    runs: &'a Triple,
    by_wrong: (f64, f64),
    by_right: (f64, f64),
}

impl WrongReport {
    /// The report on these machines.
    pub fn new(choice: &Choice, outcomes: &[Outcome<Option<Misled>>]) -> Self {
        let all: Vec<Compared<'_>> = outcomes.iter().flat_map(compared).collect();
        let of = |kind| KindRow::new(kind, all.iter().filter(|one| kind.is_none_or(|kind| one.wrong.kind == kind)));
        Self {
            set: SetRow::new(choice, outcomes, Option::is_some),
            kinds: Kind::ALL.into_iter().map(Some).chain([None]).map(of).collect(),
            runs: all.iter().map(WrongRow::new).collect(),
        }
    }

    /// The tables.
    pub fn tables(&self) -> String {
        self.set.text() + &self.gains() + &self.faults() + &self.worst()
    }

    fn gains(&self) -> String {
        let row = |kind: &KindRow| {
            let mut row = vec![kind.kind.to_owned(), kind.runs.to_string()];
            for Comparison { gain, far } in [&kind.by_wrong, &kind.by_right] {
                let figures = [gain.geometric_mean, gain.worst, gain.worst_max].map(number);
                row.extend(figures.into_iter().chain([far.to_string()]));
            }
            row
        };
        let header = ["wrong", "runs", "mean", "worst", "max", "above 2", "mean by right", "worst", "max", "above 2"];
        format!("\n{}\n", table(&header, self.kinds.iter().map(row).collect()))
    }

    fn faults(&self) -> String {
        let row = |kind: &KindRow| {
            let of = |count: fn(&Faults) -> usize| {
                [&kind.right, &kind.fallback, &kind.smith].map(|faults| count(faults).to_string()).join(" / ")
            };
            let Noticed { soon, later, never } = kind.noticed;
            let mut row = vec![kind.kind.to_owned(), of(|faults| faults.latched), of(|faults| faults.cycling)];
            row.extend([soon + later + never, soon, later, never].map(|count| count.to_string()));
            row
        };
        let header = ["right / fallback / Smith", "latched", "cycling", "rms above 1.5", "in 2 s", "later", "never"];
        format!("\n{}\n", table(&header, self.kinds.iter().map(row).collect()))
    }

    fn worst(&self) -> String {
        let mut runs: Vec<&WrongRow> = self.runs.iter().filter(|run| run.by_wrong.0 > POOR).collect();
        if runs.is_empty() {
            return String::new();
        }
        runs.sort_by(|a, b| b.by_wrong.0.total_cmp(&a.by_wrong.0));
        let row = |run: &&WrongRow| {
            vec![
                run.machine.to_string(),
                run.task.to_owned(),
                format!("{} {}", run.kind, run.amount),
                number(run.by_wrong.0),
                number(run.by_wrong.1),
                number(run.by_right.0),
                number(1e3 * run.smith.rms_m),
                run.noticed_s.map_or("never".to_owned(), |time| format!("{time:.1} s")),
                run.change.to_owned(),
            ]
        };
        let header = ["machine", "task", "wrong", "ratio", "max", "by right", "rms mm", "noticed", "change"];
        format!("\n{}\n", table(&header, runs.iter().take(LISTED).map(row).collect()))
    }
}

fn compared(outcome: &Outcome<Option<Misled>>) -> impl Iterator<Item = Compared<'_>> {
    let rig = &outcome.rig;
    let misled = outcome.result.as_ref().ok().and_then(Option::as_ref);
    misled.into_iter().flat_map(move |Misled { wrong, tasks }| {
        tasks.iter().map(move |runs| {
            let [by_wrong, by_right] = [&runs.fallback, &runs.right].map(|by| ratios(rig, &runs.smith, by));
            Compared { rig, wrong, runs, by_wrong, by_right }
        })
    })
}

impl KindRow {
    /// Of one kind, or of all.
    fn new<'a>(kind: Option<Kind>, runs: impl Iterator<Item = &'a Compared<'a>>) -> Self {
        let runs: Vec<&Compared<'_>> = runs.collect();
        Self {
            kind: kind.map_or("all", Kind::name),
            runs: runs.len(),
            by_wrong: Comparison::new(runs.iter().map(|one| one.by_wrong)),
            by_right: Comparison::new(runs.iter().map(|one| one.by_right)),
            right: Faults::of(runs.iter().map(|one| &one.runs.right)),
            fallback: Faults::of(runs.iter().map(|one| &one.runs.fallback)),
            smith: Faults::of(runs.iter().map(|one| &one.runs.smith)),
            noticed: Noticed::new(runs.iter().filter(|one| one.by_wrong.0 > POOR).map(|one| one.runs.smith.suspected)),
        }
    }
}

impl Comparison {
    fn new(ratios: impl Iterator<Item = (f64, f64)>) -> Self {
        let ratios: Vec<(f64, f64)> = ratios.collect();
        Self { gain: Gain::new(&ratios), far: ratios.iter().filter(|(_, max)| *max > FAR).count() }
    }
}

impl Noticed {
    fn new(times: impl Iterator<Item = Option<f64>>) -> Self {
        times.fold(Self::default(), |mut noticed, time| {
            *match time {
                Some(time) if time <= SOON => &mut noticed.soon,
                Some(_) => &mut noticed.later,
                None => &mut noticed.never,
            } += 1;
            noticed
        })
    }
}

impl WrongRow {
    fn new(one: &Compared<'_>) -> Self {
        let Compared { rig, wrong, runs, by_wrong, by_right } = one;
        Self {
            machine: rig.number,
            kind: wrong.kind.name(),
            amount: wrong.amount.clone(),
            change: rig.change.name,
            task: runs.task.name(),
            by_wrong: *by_wrong,
            by_right: *by_right,
            noticed_s: runs.smith.suspected,
            right: RunRow::new(&runs.right),
            fallback: RunRow::new(&runs.fallback),
            smith: RunRow::new(&runs.smith),
        }
    }
}
