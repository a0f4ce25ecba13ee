//! `hydraxis identify`: identifies a model on a recording, with the core that also runs in ident-proc.
//!
//! Only [`mod@run`] is the work that ident-proc does in its loop. Search, comparison and validation run in no stage.

mod arguments;
mod compare;
mod course;
mod grid;
mod held_out;
mod model_out;
mod pictures;
mod record;
mod report;
mod residuals;
mod rows;
mod run;
mod select;
mod settings;
mod structure;
mod verdict;

use std::io::Write;

use ident_proc::Identifier;
use pipeline::machine::{Identification, IdentifiedOutput};

use crate::{
    failure::Failure,
    model::{IdentifiedModel, Origin},
    report::{
        figures::CoefficientLists,
        output::{Output, OutputError, create, is_stdout},
        table::progress,
    },
};
pub use arguments::IdentifyArguments;
use course::Course;
pub use record::{ReadRecording, Record, text as recordings_text};
use report::IdentifyReport;
use residuals::Residuals;
use rows::Rows;
pub use rows::field;
use run::identify;
use select::{Selection, select};
use settings::{TypedStructure, check_estimator, settings};
pub use structure::description;
pub use verdict::{Reason, Verdict};

/// Runs the command.
pub fn run(arguments: &IdentifyArguments) -> Result<(), Failure> {
    let typed = TypedStructure::new(arguments)?;
    let record = Record::read(&arguments.data, &arguments.test, &arguments.columns)?;
    let mut settings = settings(arguments, &typed, &record)?;
    let mut output = Output::open(arguments.json.as_deref())?;
    let files = Files::open(arguments)?;
    if arguments.csv.as_deref().is_some_and(is_stdout) {
        output = output.without_tables();
    }
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
    let mut report = IdentifyReport::new(&settings, &record, &identifier, &residuals, ns_per_update);
    (report.selection, report.comparison) = (selection, comparison);
    files.write(&settings, &record, &identifier, &report)?;
    Ok(output.write(|| report.tables(), &report)?)
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

/// The files that the user asked for beside `--json`. They are opened before the work begins.
struct Files<'a> {
    arguments: &'a IdentifyArguments,
    report: Option<Box<dyn Write>>,
    model: Option<model_out::OpenModelOut<'a>>,
    csv: Option<Box<dyn Write>>,
}

impl<'a> Files<'a> {
    fn open(arguments: &'a IdentifyArguments) -> Result<Self, OutputError> {
        Ok(Self {
            arguments,
            report: arguments.report.as_deref().map(|path| create("--report", path)).transpose()?,
            model: arguments.model_out.as_ref().map(model_out::ModelOut::open).transpose()?,
            csv: arguments.csv.as_deref().map(|path| create("--csv", path)).transpose()?,
        })
    }

    /// Writes all of them.
    fn write(
        self,
        settings: &Identification,
        record: &Record,
        identifier: &Identifier,
        report: &IdentifyReport<'_>,
    ) -> Result<(), Failure> {
        if let Some(out) = self.model {
            out.write(&model(settings, record, identifier, report))?;
        }
        if self.csv.is_none() && self.report.is_none() {
            return Ok(());
        }
        let lists = CoefficientLists::new(&identifier.snapshot().adaptive);
        let refused = |source| {
            let path = self.arguments.csv.clone().unwrap_or_default();
            Failure::from(OutputError::Write { option: "--csv", path, source })
        };
        let mut rows = self.csv.map(|file| Rows::new(file, record, &lists)).transpose().map_err(refused)?;
        let mut history = pictures::History::new(record.outputs.len());
        let course = Course::follow(settings, record, |moment| {
            history.see(moment);
            rows.as_mut().map_or(Ok(()), |rows| rows.write(moment))
        });
        let course = course.map_err(refused)?;
        rows.map_or(Ok(()), Rows::finish).map_err(refused)?;
        match self.report {
            Some(mut file) => pictures::write(&mut file, (settings, record, identifier), report, (&course, &history)),
            None => Ok(()),
        }
    }
}

/// The adaptive model as it is in the end.
fn model(
    settings: &Identification,
    record: &Record,
    identifier: &Identifier,
    report: &IdentifyReport<'_>,
) -> IdentifiedModel {
    let snapshot = identifier.snapshot();
    let (word, why) = report.verdict();
    IdentifiedModel {
        coefficients: snapshot.adaptive,
        period: record.period,
        horizon: settings.horizon,
        unit: record.unit(IdentifiedOutput::Position),
        commands: [snapshot.command_low, snapshot.command_high],
        origin: Origin {
            recordings: record.name(),
            estimator: settings.estimator.to_string(),
            verdict: format!("{word}: {why}"),
        },
    }
}
