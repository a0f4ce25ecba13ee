//! `hydraxis identify`: identifies a model on a recording, with the core that also runs in ident-proc.
//!
//! Only [`mod@run`] is the work that ident-proc does in its loop. Search, comparison and validation run in no stage.

mod arguments;
mod compare;
mod course;
mod dropout;
mod files;
mod grid;
mod held_out;
mod many;
mod model_out;
mod pictures;
mod record;
mod recorded;
mod report;
mod residuals;
mod rows;
mod run;
mod select;
mod settings;
mod standing;
mod structure;
mod verdict;
mod wild;

use indicatif::ProgressBar;
use pipeline::machine::Identification;

use crate::{
    failure::Failure,
    report::{
        output::{Output, expect_one_stdout, is_stdout},
        table::progress,
    },
};
pub use arguments::IdentifyArguments;
use files::Files;
pub use record::{ReadRecording, Record, text as recordings_text};
use report::IdentifyReport;
use residuals::Residuals;
use run::identify;
use select::{Selection, select};
use settings::{TypedStructure, check_estimator, settings};
pub use standing::LARGEST_STANDING;
pub use structure::description;
pub use verdict::{Reason, Verdict};

/// Runs the command.
pub fn run(arguments: &IdentifyArguments) -> Result<(), Failure> {
    if let Some(out) = &arguments.jsonl {
        return many::run(arguments, out);
    }
    if let Some(folder) = arguments.data.iter().find(|path| path.is_dir()) {
        let folder = folder.display();
        return Err(Failure::usage(format!("{folder}: found a folder; allowed: files, or a folder with --jsonl OUT")));
    }
    let typed = TypedStructure::new(arguments)?;
    let record = Record::read(&arguments.data, &arguments.test, &arguments.columns)?;
    let mut settings = settings(arguments, &typed, &record)?;
    let others = [("--csv", &arguments.csv), ("--report", &arguments.report)];
    expect_one_stdout(&[&[("--json", &arguments.json)], &others[..]].concat())?;
    let mut output = Output::open(arguments.json.as_deref())?;
    let files = Files::open(arguments)?;
    if others.iter().any(|(_, path)| path.as_deref().is_some_and(is_stdout)) {
        output = output.without_tables();
    }
    let structures = progress(0, "structures");
    let selection = arguments.select.then(|| search(&settings, &typed, &record, &structures)).transpose()?;
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
    let mut report = IdentifyReport::new(&settings, &record, &identifier, &residuals, ns_per_update);
    (report.selection, report.comparison) = (selection, comparison);
    let written = files.write(&settings, &record, &identifier, &report);
    output.write(|| report.tables(), &report)?;
    written
}

/// The best structure. `progress` shows how far the search is.
fn search(
    settings: &Identification,
    typed: &TypedStructure,
    record: &Record,
    progress: &ProgressBar,
) -> Result<Selection, Failure> {
    let selection = select(settings, typed, record, progress);
    progress.finish_and_clear();
    selection.ok_or_else(|| {
        let gaps = if record.stretches().nth(1).is_some() { ": the gaps leave too few rows for it" } else { "" };
        Failure::run(format!("--select: no structure could be fitted and judged{gaps}"))
    })
}
