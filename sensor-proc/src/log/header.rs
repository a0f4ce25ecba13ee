//! Finds the columns of a recording: by name, by name without its unit, or by number from 1.

use pipeline::{columns::TableProblem, nearest::did_you_mean};

use super::{
    Wanted,
    number::Decimal,
    time::{Form, Stamps},
    unit::{Kind, Unit},
};

/// Names that a column with the time may have, in any capitals. `t` comes before all of them, in small letters only:
/// `T` is a temperature as well.
const TIME_NAMES: [&str; 9] =
    ["time", "timestamp", "time stamp", "time_stamp", "datetime", "date time", "date/time", "zeit", "zeitstempel"];

/// Names of the columns, from the first row.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) names: Vec<String>,
    pub(super) line: usize,
    /// False where the first row is data already.
    pub(super) present: bool,
    /// Whether the first field of the first row is a date-time or a clock time.
    stamped: bool,
}

/// A column that is read.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column {
    /// Place in a row, from 0.
    pub(super) place: usize,
    pub(super) kind: Kind,
    pub(super) name: String,
    /// The stated unit.
    pub(super) unit: Option<Unit>,
}

/// The columns that are read.
#[derive(Debug)]
pub(super) struct Columns {
    pub(super) time: Option<Column>,
    pub(super) input: Column,
    pub(super) output: Column,
}

impl Header {
    /// The header from the fields of the first row. A row of numbers and times is none.
    pub(super) fn new<'a>(line: usize, fields: impl Iterator<Item = &'a str>) -> Self {
        let names: Vec<String> = fields.map(str::to_owned).collect();
        let is_value = |text: &str| Stamps::default().parse(text, &mut Decimal::default()).is_ok();
        let mut filled = names.iter().filter(|name| !name.is_empty()).peekable();
        let present = filled.peek().is_none() || !filled.all(|name| is_value(name));
        let stamped = names.first().is_some_and(|name| !present && Form::of(name).has_unit());
        Self { names, line, present, stamped }
    }

    /// The columns with their units, as far as header and options state them.
    pub(super) fn columns(&self, wanted: &Wanted) -> Result<Columns, TableProblem> {
        let choose = "choose with --input and --output, by name or by number";
        let input = self.column(&wanted.input, Kind::Signal, choose)?;
        let output = self.column(&wanted.output, Kind::Signal, choose)?;
        let time = match wanted.time.as_deref() {
            Some("none") => None,
            Some(typed) => Some(self.column(typed, Kind::Time, "choose with --time, by name or by number")?),
            None => self.time(&[input.place, output.place]),
        };
        let mut columns = Columns { time, input, output };
        let mut stated = Vec::new();
        for (typed, unit) in &wanted.units {
            let place = self.state_unit(&mut columns, typed, unit)?;
            if stated.contains(&place) {
                let found = format!("--unit twice for one column, the second time as \"{typed}={unit}\"");
                return Err(TableProblem {
                    line: None,
                    field: None,
                    found,
                    allowed: "one unit for each column".into(),
                });
            }
            stated.push(place);
        }
        Ok(columns)
    }

    fn column(&self, typed: &str, kind: Kind, advice: &str) -> Result<Column, TableProblem> {
        Ok(self.at(self.place(typed, kind, advice)?, kind))
    }

    fn at(&self, place: usize, kind: Kind) -> Column {
        if !self.present {
            return Column { place, kind, name: (place + 1).to_string(), unit: None };
        }
        let name = &self.names[place];
        Column { place, kind, name: name.clone(), unit: kind.split(name).1 }
    }

    /// The column with the time where none was typed: one with a known name, or the first one of a file without a
    /// header if it has date-times or clock times.
    fn time(&self, taken: &[usize]) -> Option<Column> {
        if !self.present {
            return (self.stamped && !taken.contains(&0)).then(|| self.at(0, Kind::Time));
        }
        let free = || (0..self.names.len()).filter(|place| !taken.contains(place));
        let name = |place: &usize| Kind::Time.split(&self.names[*place]).0;
        let known = |known: &&str| free().find(|place| name(place).eq_ignore_ascii_case(known));
        let place = free().find(|place| name(place) == "t").or_else(|| TIME_NAMES.iter().find_map(known));
        place.map(|place| self.at(place, Kind::Time))
    }

    fn place(&self, typed: &str, kind: Kind, advice: &str) -> Result<usize, TableProblem> {
        let problem =
            |found: String, allowed: String| TableProblem { line: Some(self.line), field: None, found, allowed };
        let number =
            || typed.parse().ok().filter(|number| (1..=self.names.len()).contains(number)).map(|n: usize| n - 1);
        if self.present {
            let named = |test: &dyn Fn(&str) -> bool| -> Vec<usize> {
                self.names.iter().enumerate().filter(|(_, name)| test(name)).map(|(place, _)| place).collect()
            };
            for places in [named(&|name| name == typed), named(&|name| kind.split(name).0 == typed)] {
                match places[..] {
                    [] => {}
                    [place] => return Ok(place),
                    _ => {
                        let allowed = format!("each name once, or the number of the column ({advice})");
                        return Err(problem(format!("column \"{typed}\" twice"), allowed));
                    }
                }
            }
        }
        number().ok_or_else(|| {
            let last = self.names.len();
            if !self.present {
                let found = format!("no header, and no column \"{typed}\"");
                return problem(found, format!("a header, or numbers of columns from 1 to {last} ({advice})"));
            }
            let found = format!("no column \"{typed}\"; the columns are: {}", self.names.join(", "));
            let meant = did_you_mean(typed, self.names.iter().map(String::as_str));
            problem(found, format!("a header with \"{typed}\"{meant}, or a number from 1 to {last} ({advice})"))
        })
    }

    /// Whether a typed name or number is this column.
    pub(super) fn is(&self, typed: &str, column: &Column) -> bool {
        self.place(typed, column.kind, "").is_ok_and(|place| place == column.place)
    }

    /// `--unit COLUMN=UNIT`. Returns the place of the column.
    fn state_unit(&self, columns: &mut Columns, typed: &str, symbol: &str) -> Result<usize, TableProblem> {
        let problem = |found: String, allowed: String| TableProblem { line: None, field: None, found, allowed };
        let all = [Some(&mut columns.input), Some(&mut columns.output), columns.time.as_mut()];
        let mut all: Vec<&mut Column> = all.into_iter().flatten().collect();
        match all.iter_mut().find(|column| self.is(typed, column)) {
            None => {
                let names: Vec<String> = all.iter().map(|column| format!("\"{}\"", column.name)).collect();
                let found = format!("--unit with the column \"{typed}\"");
                Err(problem(found, format!("one of the columns that are read: {}", names.join(", "))))
            }
            Some(column) => {
                let found = || format!("--unit with the unit \"{symbol}\" for column \"{}\"", column.name);
                column.unit = Some(column.kind.unit(symbol).ok_or_else(|| problem(found(), column.kind.allowed()))?);
                Ok(column.place)
            }
        }
    }
}

impl Columns {
    /// All columns; the time first, because the others need none.
    pub(super) fn all(&mut self) -> impl Iterator<Item = &mut Column> {
        self.time.as_mut().into_iter().chain([&mut self.input, &mut self.output])
    }
}
