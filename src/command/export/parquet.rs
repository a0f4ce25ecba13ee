//! A table as Parquet: a column for each number, compressed by zstd, with an empty place where a row has no value.
//!
//! The metadata of the file have the units, as JSON by the names of the columns, and the facts of the recording.

use std::{
    collections::BTreeMap,
    fs::File,
    path::{Path, PathBuf},
    sync::Arc,
};

use parquet::{
    basic::{Compression, LogicalType, Repetition, Type as Physical, ZstdLevel},
    column::writer::ColumnWriter,
    errors::ParquetError,
    file::{metadata::KeyValue, properties::WriterProperties, writer::SerializedFileWriter},
    schema::types::Type,
};

use crate::{
    failure::Failure,
    recording::{
        reading::Reading,
        schema::{Kind, Value},
    },
    report::output::{OutputError, is_stdout},
};

use super::table::{Heading, Table};

/// Name of the units among the metadata.
const UNITS: &str = "hydraxis.units";
/// Beginning of the names of the facts among the metadata.
const FACT: &str = "hydraxis.fact.";
/// Values that are in memory at once. A table of ten columns has groups of a hundred thousand rows.
const MOST_VALUES: usize = 1_000_000;

/// Values of one column that wait for being written.
enum Values {
    Float(Vec<f64>),
    Long(Vec<i64>),
    Short(Vec<i32>),
}

impl Values {
    fn new(kind: Kind) -> Self {
        match kind {
            Kind::Float => Self::Float(Vec::new()),
            Kind::Unsigned(8) | Kind::Signed => Self::Long(Vec::new()),
            Kind::Unsigned(_) => Self::Short(Vec::new()),
        }
    }

    /// Adds a value. Parquet keeps unsigned numbers as the bits of signed ones.
    fn push(&mut self, value: Value) {
        let bits = match value {
            Value::Unsigned(bits) => bits as i64,
            Value::Signed(value) => value,
            Value::Float(value) => value as i64,
        };
        match self {
            Self::Float(values) => values.push(if let Value::Float(value) = value { value } else { bits as f64 }),
            Self::Long(values) => values.push(bits),
            Self::Short(values) => values.push(bits as i32),
        }
    }

    /// Writes all values, and forgets them. `present`: 1 for each row that has one, else 0.
    fn write(&mut self, column: &mut ColumnWriter<'_>, present: &[i16]) -> Result<(), ParquetError> {
        match (self, column) {
            (Self::Float(values), ColumnWriter::DoubleColumnWriter(writer)) => {
                writer.write_batch(values, Some(present), None)?;
                values.clear();
            }
            (Self::Long(values), ColumnWriter::Int64ColumnWriter(writer)) => {
                writer.write_batch(values, Some(present), None)?;
                values.clear();
            }
            (Self::Short(values), ColumnWriter::Int32ColumnWriter(writer)) => {
                writer.write_batch(values, Some(present), None)?;
                values.clear();
            }
            // The schema is made of the same kinds.
            _ => return Err(ParquetError::General("a column has another type than its values".to_owned())),
        }
        Ok(())
    }
}

/// A column of the rows that are not written yet.
struct WaitingColumn {
    values: Values,
    /// 1 for each row that has a value, else 0.
    present: Vec<i16>,
}

/// A file that is being written.
pub(super) struct ParquetTable {
    path: PathBuf,
    /// None before the headings are known, and after the end.
    writer: Option<SerializedFileWriter<File>>,
    /// The file, until the headings are known.
    file: Option<File>,
    columns: Vec<WaitingColumn>,
    rows: usize,
    units: BTreeMap<String, &'static str>,
}

impl ParquetTable {
    pub(super) fn create(path: &Path) -> Result<Self, Failure> {
        if is_stdout(path) {
            return Err(Failure::usage("--parquet: found -; allowed: a file"));
        }
        // It keeps what it had until there is a row.
        let created = File::options().write(true).create(true).truncate(false).open(path);
        let file =
            created.map_err(|source| OutputError::Create { option: "--parquet", path: path.to_owned(), source })?;
        let path = path.to_owned();
        Ok(Self { path, writer: None, file: Some(file), columns: Vec::new(), rows: 0, units: BTreeMap::new() })
    }

    /// Writes the rows that wait as one group.
    fn write_group(&mut self) -> Result<(), ParquetError> {
        let Some(writer) = self.writer.as_mut().filter(|_| self.rows > 0) else { return Ok(()) };
        let mut group = writer.next_row_group()?;
        for column in &mut self.columns {
            let Some(mut place) = group.next_column()? else { break };
            column.values.write(place.untyped(), &column.present)?;
            column.present.clear();
            place.close()?;
        }
        group.close()?;
        self.rows = 0;
        Ok(())
    }

    fn begin(&mut self, headings: &[Heading]) -> Result<(), ParquetError> {
        let Some(file) = self.file.take() else { return Ok(()) };
        // A device has nothing to empty.
        if file.metadata()?.is_file() {
            file.set_len(0)?;
        }
        let fields = headings.iter().map(|heading| field(heading).map(Arc::new)).collect::<Result<_, _>>()?;
        let schema = Arc::new(Type::group_type_builder("hydraxis").with_fields(fields).build()?);
        let compression = Compression::ZSTD(ZstdLevel::default());
        let properties = WriterProperties::builder().set_compression(compression).build();
        self.writer = Some(SerializedFileWriter::new(file, schema, Arc::new(properties))?);
        let waiting = |heading: &Heading| WaitingColumn { values: Values::new(heading.kind), present: Vec::new() };
        self.columns = headings.iter().map(waiting).collect();
        let units = headings.iter().filter(|heading| !heading.unit.is_empty());
        self.units = units.map(|heading| (heading.name.clone(), heading.unit)).collect();
        Ok(())
    }

    fn end(&mut self, reading: &Reading) -> Result<(), ParquetError> {
        self.write_group()?;
        let Some(mut writer) = self.writer.take() else { return Ok(()) };
        let units = serde_json::to_string(&self.units).map_err(|error| ParquetError::External(Box::new(error)))?;
        writer.append_key_value_metadata(KeyValue::new(UNITS.to_owned(), units));
        for (name, fact) in reading.facts() {
            writer.append_key_value_metadata(KeyValue::new(format!("{FACT}{name}"), fact.clone()));
        }
        writer.close().map(|_| ())
    }

    fn written(&self, result: Result<(), ParquetError>) -> Result<(), Failure> {
        result.map_err(|error| Failure::run(error).about(format!("--parquet: {}", self.path.display())))
    }
}

impl Table for ParquetTable {
    fn headings(&mut self, headings: &[Heading]) -> Result<(), Failure> {
        let begun = self.begin(headings);
        self.written(begun)
    }

    fn row(&mut self, t: f64, values: &[Option<Value>]) -> Result<(), Failure> {
        let all = [Some(Value::Float(t))].into_iter().chain(values.iter().copied());
        for (column, value) in self.columns.iter_mut().zip(all) {
            column.present.push(i16::from(value.is_some()));
            value.into_iter().for_each(|value| column.values.push(value));
        }
        self.rows += 1;
        if self.rows * self.columns.len() < MOST_VALUES {
            return Ok(());
        }
        let written = self.write_group();
        self.written(written)
    }

    fn finish(&mut self, reading: &Reading) -> Result<(), Failure> {
        let ended = self.end(reading);
        self.written(ended)
    }
}

/// A column in the schema of the file.
fn field(heading: &Heading) -> Result<Type, ParquetError> {
    let (physical, bits, is_signed) = match heading.kind {
        Kind::Float => (Physical::DOUBLE, None, true),
        Kind::Signed => (Physical::INT64, Some(64), true),
        Kind::Unsigned(8) => (Physical::INT64, Some(64), false),
        Kind::Unsigned(1) => (Physical::INT32, Some(8), false),
        Kind::Unsigned(_) => (Physical::INT32, Some(32), false),
    };
    let logical = bits.map(|bits| LogicalType::integer(bits, is_signed));
    let builder = Type::primitive_type_builder(&heading.name, physical).with_repetition(Repetition::OPTIONAL);
    builder.with_logical_type(logical).build()
}
