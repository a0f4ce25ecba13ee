//! What a table is, whatever the format of its file.

use crate::{
    failure::Failure,
    recording::{
        reading::Reading,
        schema::{Kind, Value},
    },
};

/// One column of a table.
#[derive(Debug, Clone)]
pub(super) struct Heading {
    pub(super) name: String,
    /// Empty for a number without one.
    pub(super) unit: &'static str,
    pub(super) kind: Kind,
}

impl Heading {
    pub(super) fn new(name: impl Into<String>, unit: &'static str, kind: Kind) -> Self {
        Self { name: name.into(), unit, kind }
    }

    /// The first column of every table.
    pub(super) fn time() -> Self {
        Self::new("t", "s", Kind::Float)
    }
}

/// A file in one of the formats.
pub(super) trait Table {
    /// Takes the columns, before the first row.
    fn headings(&mut self, headings: &[Heading]) -> Result<(), Failure>;
    /// Takes a row. `t` is its first value, s.
    fn row(&mut self, t: f64, values: &[Option<Value>]) -> Result<(), Failure>;
    /// Ends the file, which says where its rows come from.
    fn finish(&mut self, reading: &Reading) -> Result<(), Failure>;
}
