//! CSV files, row by row. A reader of standard output that closes its end, such as `head`, is no error.

use std::io::{self, Write};

/// A CSV file in the making.
pub struct CsvRows<'a> {
    csv: csv::Writer<Box<dyn Write + 'a>>,
}

impl<'a> CsvRows<'a> {
    /// An empty file.
    pub fn new(file: Box<dyn Write + 'a>) -> Self {
        Self { csv: csv::Writer::from_writer(file) }
    }

    /// Writes a row.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&mut self, fields: impl IntoIterator<Item = impl AsRef<[u8]>>) -> io::Result<()> {
        unless_closed(self.csv.write_record(fields).map_err(|error| match error.into_kind() {
            csv::ErrorKind::Io(error) => error,
            other => io::Error::other(format!("{other:?}")),
        }))
    }

    /// Ends the file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(&mut self) -> io::Result<()> {
        unless_closed(self.csv.flush())
    }
}

/// A number; nothing for NaN.
pub fn field(value: f64) -> String {
    if value.is_nan() { String::new() } else { value.to_string() }
}

/// The result of writing, without the error of a reader that has closed its end.
fn unless_closed(written: io::Result<()>) -> io::Result<()> {
    match written {
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Ok(()),
        other => other,
    }
}
