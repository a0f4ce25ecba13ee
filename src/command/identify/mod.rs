//! `hydraxis identify`: identifies a model on a recording, with the core that also runs in ident-proc.
//!
//! Only [`mod@run`] is the work that ident-proc does in its loop. Search, comparison and validation run in no stage.

mod arguments;
mod compare;
mod grid;
mod held_out;
mod record;
mod report;
mod residuals;
mod run;
mod select;
mod settings;
mod structure;
mod verdict;

use pipeline::machine::Identification;

use crate::{
    failure::Failure,
    report::{output::Output, table::progress},
};
pub use arguments::IdentifyArguments;
use record::Record;
use report::IdentifyReport;
use residuals::Residuals;
use run::identify;
use select::{Selection, select};
use settings::{TypedStructure, check_estimator, settings};

/// Runs the command.
pub fn run(arguments: &IdentifyArguments) -> Result<(), Failure> {
    let typed = TypedStructure::new(arguments)?;
    let record = Record::read(arguments)?;
    let mut settings = settings(arguments, &typed, &record)?;
    let output = Output::open(arguments.json.as_deref())?;
    let selection = if arguments.select { Some(search(&settings, &typed, &record)?) } else { None };
    if let Some(selection) = &selection {
        settings.structure = selection.chosen.candidate.structure;
        check_estimator(&settings)?;
    }
    let progress = progress(record.outputs.len() as u64, "samples");
    let mut residuals = Residuals::default();
    let seen = |samples| progress.set_position(samples);
    let (identifier, ns_per_update) = identify(&settings, &record, seen, &mut residuals);
    progress.finish_and_clear();
    let comparison = arguments.compare.then(|| compare::compare(&settings, &record));
    let name = record.name();
    let mut report = IdentifyReport::new(&settings, record, &identifier, &residuals, ns_per_update);
    (report.selection, report.comparison) = (selection, comparison);
    Ok(output.write(|| report.tables(&name), &report)?)
}

fn search(settings: &Identification, typed: &TypedStructure, record: &Record) -> Result<Selection, Failure> {
    let progress = progress(0, "structures");
    let selection = select(settings, typed, record, &progress);
    progress.finish_and_clear();
    selection.ok_or_else(|| {
        let gaps = if record.stretches().nth(1).is_some() { ": the gaps leave too few rows for it" } else { "" };
        Failure::run(format!("--select: no structure could be fitted and judged{gaps}"))
    })
}
