//! Turns the text of a file into rows of numbers.

use pipeline::columns::{TableProblem, rows};

use super::{
    Found, FoundColumn, Wanted,
    header::{Column, Columns, Header},
    number::Decimal,
    stretches::{Rows, Timing},
    text::Text,
    time::{Form, Stamps},
    unit::Kind,
};
use crate::recording::PERIODS;

/// Most problems that are collected.
const MOST_PROBLEMS: usize = 20;
/// Hardly an axis has a period as long, s: the times may have another unit than seconds.
const DOUBTFUL_PERIOD: f64 = 1.0;
/// Part of the steps of time that may not rise. With more of them the times are too coarse to find gaps.
const MOST_NOT_RISING: f64 = 0.5;

/// Turns the rows of a file into numbers.
#[derive(Debug)]
pub(super) struct Reader {
    header: Header,
    columns: Columns,
    units_row: bool,
    decimal: Decimal,
    stamps: Stamps,
}

impl Reader {
    /// Finds the columns and their units.
    pub(super) fn new(text: &Text, wanted: &Wanted) -> Result<Self, TableProblem> {
        let mut head = rows(&text.text, text.separator.byte());
        let (line, first) = head.next().ok_or_else(|| problem(None, "an empty file".into(), "a header".into()))??;
        let header = Header::new(line, first.iter());
        let mut columns = header.columns(wanted)?;
        let mut units_row = false;
        if let (true, Some(Ok((line, second)))) = (header.present, head.next()) {
            let field = |column: &Column| second.get(column.place).unwrap_or_default().to_owned();
            let fields: Vec<String> = columns.all().map(|column| field(column)).collect();
            // A row of data has a number or a time in one of the columns, and an empty row has no unit. A 1 is a
            // number, and the sign for no unit.
            let parses = |text: &str| Stamps::default().parse(text, &mut Decimal::default()).is_ok();
            let is_one = |text: &str, column: &Column| text == "1" && column.kind == Kind::Signal;
            let is_unit = fields.iter().zip(columns.all()).any(|(text, column)| {
                !text.is_empty() && (column.kind.unit(text).is_some() || text.starts_with(['[', '(']))
            });
            let is_value = fields.iter().zip(columns.all()).any(|(text, column)| parses(text) && !is_one(text, column));
            units_row = is_unit && !is_value && !fields.iter().all(|text| parses(text));
            let below = head.next().and_then(Result::ok).map(|(_, third)| third);
            // Date-times and clock times have a unit of their own.
            let stamped = |column: &Column| {
                let text = below.as_ref().and_then(|third| third.get(column.place)).unwrap_or_default();
                column.kind == Kind::Time && Form::of(text).has_unit()
            };
            if units_row {
                for (text, column) in fields.iter().zip(columns.all()) {
                    let typed = wanted.units.iter().any(|(typed, _)| header.is(typed, column));
                    if !typed && !text.is_empty() && !stamped(column) {
                        column.unit = Some(column.kind.unit(text).ok_or_else(|| TableProblem {
                            field: Some((0, column.name.clone())),
                            ..problem(Some(line), format!("the unit \"{text}\""), unit_advice(column))
                        })?);
                    }
                }
            }
        }
        Ok(Self { header, columns, units_row, decimal: Decimal::default(), stamps: Stamps::default() })
    }

    /// All rows of data.
    pub(super) fn read(&mut self, text: &Text) -> Result<Rows, Vec<TableProblem>> {
        let mut read = Rows::default();
        let mut problems = Vec::new();
        let before = usize::from(self.header.present) + usize::from(self.units_row);
        let width = self.header.names.len();
        let mut left_out = false;
        for (row, record) in rows(&text.text, text.separator.byte()).skip(before).enumerate() {
            let (line, record) = match record {
                Ok(record) => record,
                Err(problem) => return Err(vec![problem]),
            };
            let fields = record.len();
            if record.iter().skip(width).any(|field| !field.is_empty()) {
                let hint = "a decimal comma needs another separator, or quotes";
                let allowed = format!("{width} fields, as in the first row ({hint})");
                problems.push(problem(Some(line), format!("{fields} fields"), allowed));
            } else if let Some(quoted) = record.iter().find(|field| field.contains(['\n', '\r'])) {
                let begin: String = quoted.chars().take_while(|sign| !sign.is_control()).take(20).collect();
                let allowed = "quotes that end on their line".to_owned();
                problems.push(problem(
                    Some(line),
                    format!("the quoted field \"{begin}..\" over several lines"),
                    allowed,
                ));
            } else {
                let field = |column: &Column| record.get(column.place).unwrap_or_default();
                left_out = !self.row(&field, (line, row + 1, left_out), &mut read, &mut problems);
            }
            if problems.len() >= MOST_PROBLEMS {
                break;
            }
        }
        if read.outputs.len() < 2 && problems.is_empty() {
            let found = format!("{} rows", read.outputs.len());
            let allowed = "at least 2 rows without an empty field, to tell anything".to_owned();
            problems.push(problem(None, found, allowed));
        }
        if problems.is_empty() { Ok(read) } else { Err(problems) }
    }

    /// One row; false where it is left out. `place` is its line, its number, and whether the row before was left out.
    fn row<'a>(
        &mut self,
        field: &impl Fn(&Column) -> &'a str,
        (line, row, left_out): (usize, usize, bool),
        read: &mut Rows,
        problems: &mut Vec<TableProblem>,
    ) -> bool {
        let Columns { time, input, output } = &self.columns;
        let size = |column: &Column| column.unit.as_ref().map_or(1.0, |unit| unit.size);
        let mut refuse = |column: &Column, (found, allowed): (String, &str)| {
            let field = Some((row, column.name.clone()));
            problems.push(TableProblem { line: Some(line), field, found, allowed: allowed.to_owned() });
        };
        let mut values = [0.0; 3];
        let mut empty = None;
        for (value, column) in values.iter_mut().zip(time.iter().chain([input, output])) {
            let text = field(column);
            let parsed = match (text, column.kind) {
                ("", _) => {
                    empty = empty.or(Some(column));
                    continue;
                }
                (_, Kind::Time) => self.stamps.parse(text, &mut self.decimal),
                (_, Kind::Signal) => self.decimal.parse(text),
            };
            let has_unit = column.kind == Kind::Time && self.stamps.form().has_unit();
            match parsed.map(|parsed| if has_unit { parsed } else { parsed * size(column) }) {
                Ok(parsed) => *value = parsed,
                Err(error) => refuse(column, error),
            }
        }
        if let Some(column) = empty {
            read.gaps.empty(line, &column.name);
            return false;
        }
        let signals = if time.is_some() { &values[1..] } else { &values[..2] };
        if time.is_some() {
            read.times.push(values[0]);
        }
        read.inputs.push(signals[0]);
        read.outputs.push(signals[1]);
        read.lines.push(line);
        read.after_empty.push(left_out);
        true
    }

    /// The period, s.
    pub(super) fn period(&self, wanted: &Wanted, read: &Rows, timing: &Timing) -> Result<f64, TableProblem> {
        let Some(column) = &self.columns.time else {
            let found = format!("no column with the time; the columns are: {}", self.header.names.join(", "));
            let allowed = "a column \"t\", or one that is chosen with --time (or give the sample period with --period)";
            let refused = || TableProblem { line: Some(self.header.line), ..problem(None, found, allowed.into()) };
            return wanted.period.ok_or_else(refused);
        };
        let about =
            |found: String, allowed: String| problem(None, format!("{found} in column \"{}\"", column.name), allowed);
        let steps = read.times.len() - 1;
        let not_rising = read.gaps.times_not_rising;
        if not_rising as f64 > MOST_NOT_RISING * steps as f64 {
            let found = format!("{not_rising} of {steps} steps that do not rise");
            return Err(about(
                found,
                "times that rise, or --time none with the sample period, such as --period 10ms".into(),
            ));
        }
        let own_unit = self.stamps.form().has_unit();
        if own_unit && wanted.units.iter().any(|(typed, _)| self.header.is(typed, column)) {
            return Err(about("--unit for date-times or clock times".into(), "no unit, because they have one".into()));
        }
        if let Some(period) = wanted.period {
            return Ok(period);
        }
        let Some(period) = timing.period() else {
            let allowed = "two rows one after the other without a gap, or --period".to_owned();
            return Err(about("a gap between all rows, so no period".into(), allowed));
        };
        if !PERIODS.contains(&period) {
            let allowed = format!("{:e} to {:e} s", PERIODS.start(), PERIODS.end());
            return Err(about(format!("a period of {period:e} s"), allowed));
        }
        Ok(period)
    }

    /// What the file was found to be; its period is `period`, s.
    pub(super) fn found(&self, text: &Text, period: f64) -> Found {
        let has_no_unit = |column: &Column| column.unit.is_none() && !self.stamps.form().has_unit();
        let column = |column: &Column| FoundColumn {
            name: column.name.clone(),
            unit: column.unit.as_ref().map(|unit| unit.symbol.clone()),
            becomes: column.unit.as_ref().map(|unit| unit.becomes),
        };
        let form = match self.stamps.form() {
            Form::Number => "numbers",
            Form::DateTime => "date-times",
            Form::Clock => "clock times",
        };
        Found {
            separator: text.separator.name(),
            decimal: self.decimal.name(),
            encoding: text.encoding,
            header: self.header.present,
            units_row: self.units_row,
            is_time_doubtful: period >= DOUBTFUL_PERIOD && self.columns.time.as_ref().is_some_and(has_no_unit),
            contradicting_period_s: None,
            time_form: self.columns.time.as_ref().map(|_| form),
            time: self.columns.time.as_ref().map(column),
            input: column(&self.columns.input),
            output: column(&self.columns.output),
        }
    }
}

fn problem(line: Option<usize>, found: String, allowed: String) -> TableProblem {
    TableProblem { line, field: None, found, allowed }
}

fn unit_advice(column: &Column) -> String {
    format!("{} (or state it: --unit \"{}=UNIT\")", column.kind.allowed(), column.name)
}
