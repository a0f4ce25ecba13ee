//! `hydraxis identify`: a recording through the same core that runs in ident-proc.

mod compare;
mod grid;
mod report;
mod run;
mod select;
mod settings;
mod structure;
mod validation;

use sensor_proc::record::Record;

use crate::{cli, failure::Failure, output::Output, table::progress};
use report::Report;
use run::identify;
use settings::{Typed, settings};

/// Runs the command.
pub fn run(arguments: &cli::Identify) -> Result<(), Failure> {
    let typed = Typed::new(arguments)?;
    let period = arguments.period.map(|period| period.as_secs_f64());
    let record = Record::read(&arguments.data, &arguments.input, &arguments.output, period).map_err(Failure::usage)?;
    let mut settings = settings(arguments, &typed, &record)?;
    let output = Output::open(arguments.json.as_deref())?;
    let mut selection = None;
    if arguments.select {
        let progress = progress(0, "structures");
        selection = select::select(&settings, &typed, &record, &progress);
        progress.finish_and_clear();
        settings.structure = selection.as_ref().map_or(settings.structure, |found| found.chosen.candidate.structure);
    }
    let progress = progress(record.outputs.len() as u64, "samples");
    let (mut identifier, ns_per_update) = identify(&settings, &record, |samples| progress.set_position(samples));
    progress.finish_and_clear();
    let mut report = Report::new(&settings, &record, &mut identifier, ns_per_update);
    report.selection = selection;
    report.comparison = arguments.compare.then(|| compare::compare(&settings, &record));
    output.write(|| report.tables(&arguments.data), &report)
}
