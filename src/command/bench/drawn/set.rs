//! The head of a report on drawn machines: how many there are, and how many were commissioned.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{Choice, Half, drive::Outcome};
use crate::report::table::{percent, table};

/// A set of machines and what commissioning made of it.
#[derive(Debug, Serialize)]
pub struct SetRow {
    seed: u64,
    /// Machines of the set before a half or single numbers were chosen.
    set: u64,
    half: Option<&'static str>,
    drawn: usize,
    commissioned: usize,
    /// Of these, machines that took two tries.
    second_try: usize,
    /// Machines whose model file lets the model control.
    chosen: usize,
    refusals: Vec<Refusals>,
}

/// Machines that commissioning refused for one reason.
#[derive(Debug, Serialize)]
struct Refusals {
    reason: &'static str,
    machines: Vec<u64>,
}

impl SetRow {
    /// Of these machines. `is_chosen`: whether the model file lets the model control.
    pub fn new<T>(choice: &Choice, outcomes: &[Outcome<T>], is_chosen: impl Fn(&T) -> bool) -> Self {
        let commissioned = || outcomes.iter().filter_map(|outcome| outcome.result.as_ref().ok());
        let is_second = |outcome: &&Outcome<T>| outcome.result.is_ok() && outcome.tries > 1;
        Self {
            seed: choice.seed,
            set: choice.count,
            half: choice.half.map(Half::name),
            drawn: outcomes.len(),
            commissioned: commissioned().count(),
            second_try: outcomes.iter().filter(is_second).count(),
            chosen: commissioned().filter(|driven| is_chosen(driven)).count(),
            refusals: refusals(outcomes),
        }
    }

    /// A sentence, and a table of what was refused.
    pub fn text(&self) -> String {
        let part = |count: usize| percent(100.0 * count as f64 / self.drawn.max(1) as f64);
        let mut text = format!(
            "{} machines of seed {}: {} commissioned ({}), {} of them at the second try, as the first refusal asks \
             for; {} are controlled by their models.\n",
            self.drawn,
            self.seed,
            self.commissioned,
            part(self.commissioned),
            self.second_try,
            self.chosen
        );
        if !self.refusals.is_empty() {
            let row = |refusals: &Refusals| {
                let numbers: Vec<String> = refusals.machines.iter().map(u64::to_string).collect();
                vec![refusals.reason.to_owned(), refusals.machines.len().to_string(), numbers.join(" ")]
            };
            let rows = self.refusals.iter().map(row).collect();
            text += &format!("\n{}\n", table(&["refused for", "machines", "numbers"], rows));
        }
        text
    }
}

/// The refused machines by reason, the most frequent reason first.
fn refusals<T>(outcomes: &[Outcome<T>]) -> Vec<Refusals> {
    let mut all: BTreeMap<&'static str, Vec<u64>> = BTreeMap::new();
    for outcome in outcomes {
        if let Err(refusal) = &outcome.result {
            all.entry(refusal.reason).or_default().push(outcome.rig.number);
        }
    }
    let mut all: Vec<_> = all.into_iter().map(|(reason, machines)| Refusals { reason, machines }).collect();
    all.sort_by_key(|refusals| std::cmp::Reverse(refusals.machines.len()));
    all
}
