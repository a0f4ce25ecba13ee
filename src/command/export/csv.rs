//! A table as CSV.

use std::{
    io,
    path::{Path, PathBuf},
};

use crate::{
    failure::Failure,
    recording::{reading::Reading, schema::Value},
    report::{
        output::{OutputError, create},
        rows::CsvRows,
    },
};

use super::table::{Heading, Table};

/// A file, or standard output.
pub(super) struct CsvTable {
    path: PathBuf,
    rows: CsvRows<'static>,
    has_units: bool,
}

impl CsvTable {
    /// `has_units`: the second row has the units.
    pub(super) fn create(path: &Path, has_units: bool) -> Result<Self, Failure> {
        let file = create("--csv", path)?;
        Ok(Self { path: path.to_owned(), rows: CsvRows::new(file), has_units })
    }

    fn written(&self, result: io::Result<()>) -> Result<(), Failure> {
        Ok(result.map_err(|source| OutputError::Write { option: "--csv", path: self.path.clone(), source })?)
    }
}

impl Table for CsvTable {
    fn headings(&mut self, headings: &[Heading]) -> Result<(), Failure> {
        let names = self.rows.write(headings.iter().map(|heading| &heading.name));
        self.written(names)?;
        if self.has_units {
            let units = self.rows.write(headings.iter().map(|heading| heading.unit));
            self.written(units)?;
        }
        Ok(())
    }

    fn row(&mut self, t: f64, values: &[Option<Value>]) -> Result<(), Failure> {
        let texts = values.iter().map(|value| value.map_or(String::new(), |value| value.to_string()));
        let row = self.rows.write([format!("{t:.9}")].into_iter().chain(texts));
        self.written(row)
    }

    fn finish(&mut self, _: &Reading) -> Result<(), Failure> {
        let ended = self.rows.finish();
        self.written(ended)
    }
}
