//! The files beside the figures: the report with pictures, the model, and the rows.

use std::io::Write;

use ident_proc::Identifier;
use pipeline::machine::{Identification, IdentifiedOutput};

use super::{
    arguments::IdentifyArguments,
    course::Course,
    model_out::{ModelOut, OpenModelOut},
    pictures::{self, History},
    record::Record,
    report::IdentifyReport,
    rows::Rows,
};
use crate::{
    failure::Failure,
    model::{IdentifiedModel, Origin},
    report::{
        figures::CoefficientLists,
        output::{OutputError, create},
    },
};

/// The files that the user asked for beside `--json`. They are opened before the work begins.
pub struct Files<'a> {
    arguments: &'a IdentifyArguments,
    report: Option<Box<dyn Write>>,
    model: Option<OpenModelOut<'a>>,
    csv: Option<Box<dyn Write>>,
}

impl<'a> Files<'a> {
    /// Opens them.
    ///
    /// # Errors
    /// One of them cannot be created.
    pub fn open(arguments: &'a IdentifyArguments) -> Result<Self, OutputError> {
        Ok(Self {
            arguments,
            report: arguments.report.as_deref().map(|path| create("--report", path)).transpose()?,
            model: arguments.model_out.as_ref().map(ModelOut::open).transpose()?,
            csv: arguments.csv.as_deref().map(|path| create("--csv", path)).transpose()?,
        })
    }

    /// Writes all of them; a model that cannot be handed over keeps back no other.
    ///
    /// # Errors
    /// One of them cannot be written, or the model has a coefficient that is not finite.
    pub fn write(
        self,
        settings: &Identification,
        record: &Record,
        identifier: &Identifier,
        report: &IdentifyReport<'_>,
    ) -> Result<(), Failure> {
        let out = self.model.map(|out| out.write(&model(settings, record, identifier, report)));
        let handed_over = out.unwrap_or(Ok(()));
        if self.csv.is_none() && self.report.is_none() {
            return handed_over;
        }
        let lists = CoefficientLists::new(&identifier.snapshot().adaptive);
        let refused = |source| {
            let path = self.arguments.csv.clone().unwrap_or_default();
            Failure::from(OutputError::Write { option: "--csv", path, source })
        };
        let mut rows = self.csv.map(|file| Rows::new(file, record, &lists)).transpose().map_err(refused)?;
        let mut history = History::new(record.outputs.len());
        let course = Course::follow(settings, record, |moment| {
            history.see(moment);
            rows.as_mut().map_or(Ok(()), |rows| rows.write(moment))
        });
        let course = course.map_err(refused)?;
        rows.map_or(Ok(()), Rows::finish).map_err(refused)?;
        if let Some(mut file) = self.report {
            pictures::write(&mut file, (settings, record, identifier), report, (&course, &history))?;
        }
        handed_over
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
