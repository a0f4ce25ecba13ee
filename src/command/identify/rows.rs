//! `--csv`: predictions, residuals and coefficients, row by row.
//!
//! | column | is |
//! |---|---|
//! | `recording` | number of the recording, from 1 |
//! | `t` | time since the first row of the recording, s |
//! | `input`, `output` | the row as it was read |
//! | `one_step`, `h_steps` | predictions of the output by the adaptive model |
//! | `residual` | the output minus its prediction one step ahead |
//! | `held_..` | the same of the classical model |
//! | `outlier` | 1 where the row was left out as an outlier |
//! | `a_1 .. drift` | coefficients of the adaptive model after the row |
//! | `forgetting_factor` | of the row |
//!
//! A field is empty where there is no value.

use std::io::{self, Write};

use pipeline::message::model_fault;

use super::{course::Moment, record::Record};
use crate::report::{
    figures::CoefficientLists,
    rows::{CsvRows, field},
};

/// Writes the rows of one record.
pub struct Rows<'a> {
    record: &'a Record,
    /// First row of each recording.
    first_rows: Vec<usize>,
    /// Number of columns.
    columns: usize,
    csv: CsvRows<'a>,
}

impl<'a> Rows<'a> {
    /// Begins with the header. `model` has the orders of the adaptive model.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn new(file: Box<dyn Write + 'a>, record: &'a Record, model: &CoefficientLists) -> io::Result<Self> {
        let mut csv = CsvRows::new(file);
        let fixed = [
            "recording",
            "t",
            "input",
            "output",
            "one_step",
            "h_steps",
            "residual",
            "held_one_step",
            "held_h_steps",
            "held_residual",
            "outlier",
        ];
        let names = |name: &str, first: usize, count: usize| {
            (first..first + count).map(|i| format!("{name}_{i}")).collect::<Vec<_>>()
        };
        let mut header: Vec<String> = fixed.map(str::to_owned).to_vec();
        header.extend(names("a", 1, model.a.len()));
        header.extend(names("b", 0, model.b.len()));
        header.extend(names("f", 1, model.f.len()));
        header.extend(names("g", 1, model.g.len()));
        header.extend(["drift".to_owned(), "forgetting_factor".to_owned()]);
        csv.write(&header)?;
        Ok(Self { record, first_rows: record.first_rows().collect(), columns: header.len(), csv })
    }

    /// Writes one row.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write(&mut self, moment: &Moment<'_>) -> io::Result<()> {
        let (k, course) = (moment.row, moment.course);
        let y = self.record.outputs[k];
        let recording = self.first_rows.partition_point(|first| *first <= k);
        let mut fields = vec![recording.to_string()];
        let [adaptive, held] = [&course.adaptive, &course.held].map(|of| {
            let (one_step, h_step) = (of.one_step[k], of.h_step[k]);
            [one_step, h_step, y - one_step]
        });
        let signals = [self.record.times[k], self.record.inputs[k], y];
        fields.extend(signals.into_iter().chain(adaptive).chain(held).map(field));
        let snapshot = moment.snapshot;
        fields.push(u8::from(snapshot.faults & model_fault::OUTLIER != 0).to_string());
        if moment.is_trained() {
            let CoefficientLists { a, b, f, g, drift } = CoefficientLists::new(&snapshot.adaptive);
            let lists = a.into_iter().chain(b).chain(f).chain(g);
            fields.extend(lists.chain([drift, snapshot.forgetting_factor]).map(field));
        }
        fields.resize(self.columns, String::new());
        self.csv.write(&fields)
    }

    /// Ends the file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn finish(mut self) -> io::Result<()> {
        self.csv.finish()
    }
}
