//! `hydraxis bench control --machines N`: machines drawn at random, each commissioned and driven by its fallback and by
//! its model.
//!
//! | module | what it holds |
//! |---|---|
//! | [`rig`] | what is drawn, and from which ranges |
//! | [`machine_file`] | the machine file of a drawn machine |
//! | [`task`] | what the machine is driven with |
//! | [`drive`] | commissioning and the runs of one machine |
//! | [`hold`] | what is counted while a reference stands |
//! | [`report`] | tables and JSON |
//!
//! The machines with even numbers are for design: whoever changes a controller may look at them. Those with odd numbers
//! are for judging it. Trap: a machine that was looked at judges nothing any more.

mod drive;
mod hold;
mod machine_file;
mod report;
mod rig;
mod task;

use std::{fs, path::Path};

use clap::ValueEnum;

use self::{
    drive::{Outcome, drive},
    machine_file::text,
    report::DrawnReport,
    rig::Rig,
    task::Task,
};
use super::{arguments::BenchControlArguments, parallel};
use crate::{failure::Failure, report::output::Output};

/// A half of the drawn machines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Half {
    /// machines with even numbers, which may be looked at while a controller is designed
    Design,
    /// machines with odd numbers, which judge it
    Judge,
}

impl Half {
    fn has(self, number: u64) -> bool {
        number.is_multiple_of(2) == (self == Self::Design)
    }
}

/// Which machines.
pub struct Choice {
    /// Machines 0 to this number less one.
    pub count: u64,
    /// Seed of the set.
    pub seed: u64,
    /// Only one half.
    pub half: Option<Half>,
    /// Only the machines with these numbers; all when there are none.
    pub only: Vec<u64>,
}

impl Choice {
    /// The machines.
    fn rigs(&self) -> Vec<Rig> {
        let is_chosen = |number: &u64| {
            self.half.is_none_or(|half| half.has(*number)) && (self.only.is_empty() || self.only.contains(number))
        };
        (0..self.count).filter(is_chosen).map(|number| Rig::draw(self.seed, number)).collect()
    }
}

/// Runs `bench control --machines`.
pub fn run(arguments: &BenchControlArguments, count: u64, threads: usize) -> Result<(), Failure> {
    if let Some(number) = arguments.only.iter().find(|number| **number >= count) {
        return Err(Failure::usage(format!("--only: found {number}; allowed: 0 to {}", count - 1)));
    }
    let choice = Choice { count, seed: arguments.seed, half: arguments.half, only: arguments.only.clone() };
    let rigs = choice.rigs();
    if rigs.is_empty() {
        return Err(Failure::usage("--only, --half: found no machine; allowed: numbers of the half that was chosen"));
    }
    if let Some(folder) = &arguments.write {
        return write(&rigs, folder);
    }
    let output = Output::open(arguments.json.as_deref())?;
    let outcomes: Vec<Outcome> = parallel::map(threads, "machines", &rigs, drive)?;
    let report = DrawnReport::new(&choice, &outcomes);
    Ok(output.write(|| report.tables(), &report)?)
}

/// Writes the machine files, one for each task.
fn write(rigs: &[Rig], folder: &Path) -> Result<(), Failure> {
    let refused = |error| Failure::usage(error).about(format!("--write: {} cannot be written", folder.display()));
    fs::create_dir_all(folder).map_err(refused)?;
    for rig in rigs {
        for task in Task::ALL {
            let file = folder.join(format!("{}-{}.toml", rig.number, task.name()));
            fs::write(file, text(rig, task)).map_err(refused)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
