//! The report of `--report`: one HTML file that needs nothing else. The verdict and the figures come first, then what
//! was predicted, the residuals, the models, and the models over time.
//!
//! The pictures show the models as they are published, with the predictions of [`super::course`].

mod axis;
mod history;
mod model;
mod predictions;
mod residuals;
mod style;

use std::{error::Error, io::Write};

use ident_proc::Identifier;
use pipeline::machine::{Identification, IdentifiedOutput};

use self::axis::Axis;
use super::{course::Course, record::Record, report::IdentifyReport};
use crate::{
    failure::Failure,
    report::page::{Figure as Picture, Page},
};

pub use history::History;

/// What is shown.
struct Shown<'a> {
    settings: &'a Identification,
    record: &'a Record,
    identifier: &'a Identifier,
    course: &'a Course,
    axis: Axis,
    /// The horizon in words.
    ahead: String,
    /// The output and its unit, as beside an axis.
    output: String,
    /// The error and its unit.
    error: String,
}

/// Writes the report.
///
/// # Errors
/// The file cannot be written, or a picture cannot be drawn.
pub fn write(
    file: &mut dyn Write,
    (settings, record, identifier): (&Identification, &Record, &Identifier),
    report: &IdentifyReport<'_>,
    (course, history): (&Course, &History),
) -> Result<(), Failure> {
    let unit = record.unit(IdentifiedOutput::Position);
    let beside = |name: &str| unit.as_ref().map_or_else(|| name.to_owned(), |unit| format!("{name}, {unit}"));
    let shown = Shown {
        settings,
        record,
        identifier,
        course,
        axis: Axis::new(record),
        ahead: report.ahead(),
        output: beside("output"),
        error: beside("error"),
    };
    let text = html(&shown, report, history).map_err(|error| Failure::run(error).about("--report"))?;
    let refused = |error: std::io::Error| Failure::usage(error).about("--report: the file cannot be written");
    file.write_all(text.as_bytes()).and_then(|()| file.flush()).map_err(refused)
}

fn html(
    shown: &Shown<'_>,
    report: &IdentifyReport<'_>,
    history: &History,
) -> Result<String, Box<dyn Error + Send + Sync>> {
    let mut page = Page::new(&format!("Identification of {}", shown.record.name()));
    let (word, why) = report.verdict();
    page.verdict(report.is_usable(), word, &why);
    let (header, rows) = report.error_rows();
    page.table(&header, &rows);
    page.paragraph(&format!(
        "The classical model was identified on the first {} rows and is held from there on. The adaptive model is \
         updated at each row. All errors are those of the rows after the training.",
        shown.settings.training
    ));
    page.section("Predictions");
    if shown.settings.output == IdentifiedOutput::Velocity {
        page.paragraph(
            "The velocity was identified, and the table above has its errors. The pictures show the position, which \
             the models predict as well.",
        );
    }
    page.pictures(&predictions::all(shown))?;
    page.section("Residuals");
    page.pictures(&residuals::all(shown))?;
    page.section("Models");
    page.pictures(&model::all(shown))?;
    page.section("The adaptive model over time");
    page.pictures(&history.pictures(shown))?;
    page.section("What was identified");
    page.facts(&report.facts());
    let (header, rows) = report.coefficient_rows();
    page.table(&header, &rows);
    Ok(page.finish())
}
