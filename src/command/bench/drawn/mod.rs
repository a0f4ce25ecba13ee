//! `hydraxis bench control --machines N`: machines drawn at random, each commissioned and driven by its fallback and by
//! its model.
//!
//! | module | what it holds |
//! |---|---|
//! | [`choice`] | which machines of a set |
//! | [`rig`] | what is drawn, and from which ranges |
//! | [`machine_file`] | the machine file of a drawn machine |
//! | [`task`] | what the machine is driven with |
//! | [`mod@drive`] | commissioning and the runs of one machine |
//! | [`hold`] | what is counted while a reference stands |
//! | [`set`] | how many machines there are, and how many were commissioned |
//! | [`report`] | tables and JSON |
//! | [`wrong`] | wrong models, and the runs with them |
//! | [`wrong_report`] | tables and JSON of those runs |

mod choice;
mod drive;
mod hold;
mod machine_file;
mod report;
mod rig;
mod set;
mod task;
mod wrong;
mod wrong_report;

use std::{fs, path::Path};

use self::{
    drive::drive, machine_file::text, report::DrawnReport, rig::Rig, task::Task, wrong::mislead,
    wrong_report::WrongReport,
};
use super::parallel;
use crate::{failure::Failure, report::output::Output};
pub use choice::{Choice, Half};
pub use rig::Draw;

/// Runs `bench control --machines`.
///
/// # Errors
/// No machine is chosen, or an output cannot be written.
pub fn run(choice: &Choice, write_to: Option<&Path>, json: Option<&Path>, threads: usize) -> Result<(), Failure> {
    let rigs = chosen(choice)?;
    if let Some(folder) = write_to {
        return write(&rigs, folder);
    }
    let output = Output::open(json)?;
    let outcomes = parallel::map(threads, "machines", &rigs, drive)?;
    let report = DrawnReport::new(choice, &outcomes);
    Ok(output.write(|| report.tables(), &report)?)
}

/// Runs `bench control --machines --wrong-models`.
///
/// # Errors
/// No machine is chosen, or an output cannot be written.
pub fn run_wrong(choice: &Choice, json: Option<&Path>, threads: usize) -> Result<(), Failure> {
    let rigs = chosen(choice)?;
    let output = Output::open(json)?;
    let outcomes = parallel::map(threads, "machines", &rigs, |rig| mislead(rig, choice.seed))?;
    let report = WrongReport::new(choice, &outcomes);
    Ok(output.write(|| report.tables(), &report)?)
}

fn chosen(choice: &Choice) -> Result<Vec<Rig>, Failure> {
    if let Some(number) = choice.only.iter().find(|number| **number >= choice.count) {
        return Err(Failure::usage(format!("--only: found {number}; allowed: 0 to {}", choice.count - 1)));
    }
    let rigs = choice.rigs();
    if rigs.is_empty() {
        return Err(Failure::usage("--only, --half: found no machine; allowed: numbers of the half that was chosen"));
    }
    Ok(rigs)
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
