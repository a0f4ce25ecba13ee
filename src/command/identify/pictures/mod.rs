//! The report of `--report`: one HTML file that needs nothing else.

use std::io::Write;

use ident_proc::Identifier;
use pipeline::machine::Identification;

use super::{
    course::{Course, Moment},
    record::Record,
    report::IdentifyReport,
};
use crate::failure::Failure;

pub struct History;
impl History {
    pub fn new(_rows: usize) -> Self {
        Self
    }
    pub fn see(&mut self, _moment: &Moment<'_>) {}
}
pub fn write(
    _file: &mut dyn Write,
    (_settings, _record, _identifier): (&Identification, &Record, &Identifier),
    _report: &IdentifyReport<'_>,
    (_course, _history): (&Course, &History),
) -> Result<(), Failure> {
    Ok(())
}
