//! Columns of numbers from a CSV file: recordings for a replay, and trajectories.
//!
//! A field that is not a finite number is refused with file, line, row and column; no row is ever skipped. All problems
//! are collected, so that one message is enough to correct the file. An empty field is a gap for those who allow gaps.
//! Nothing here runs in a stage's loop.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use crate::{
    bounded,
    nearest::{did_you_mean, did_you_mean_file},
};

/// Number of problems that are kept; a file that is no CSV file has one in every row.
const MAX_PROBLEMS: usize = 20;

/// A CSV file that has been read; its fields are still text.
#[derive(Debug)]
pub struct Table {
    file: PathBuf,
    text: String,
    header: Vec<String>,
}

/// Numbers of some columns of a [`Table`].
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    /// One list per column that was asked for.
    pub values: Vec<Vec<f64>>,
    /// Line of the file that each row stands on, from 1.
    pub lines: Vec<usize>,
}

/// One problem of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TableProblem {
    /// Line of the file, from 1.
    pub line: Option<usize>,
    /// Row of data, from 1, and the name of its column.
    pub field: Option<(usize, String)>,
    /// What was found.
    pub found: String,
    /// What is allowed.
    pub allowed: String,
}

/// All problems of a file, up to a bound.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TableError {
    /// The file.
    pub file: PathBuf,
    /// At least one problem.
    pub problems: Vec<TableProblem>,
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, problem) in self.problems.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{}:", self.file.display())?;
            if let Some(line) = problem.line {
                write!(f, "{line}:")?;
            }
            if let Some((row, column)) = &problem.field {
                write!(f, " row {row}, column \"{column}\":")?;
            }
            write!(f, " found {}; allowed: {}", problem.found, problem.allowed)?;
        }
        Ok(())
    }
}

impl std::error::Error for TableError {}

impl Table {
    /// Reads the file and its header.
    ///
    /// # Errors
    /// The file cannot be read, or has no header.
    pub fn read(file: &Path) -> Result<Self, TableError> {
        let allowed = "a CSV file with a header, then one row per sample";
        let refuse = |found: String| TableError {
            file: file.to_owned(),
            problems: vec![TableProblem { line: None, field: None, found, allowed: allowed.to_owned() }],
        };
        let text = bounded::read_text(file, bounded::TABLE).map_err(|error| {
            let mut refused = refuse(format!("a file that cannot be read ({error})"));
            refused.problems[0].allowed += &did_you_mean_file(file);
            refused
        })?;
        let header = match rows(&text, b',').next() {
            Some(Ok((_, header))) => header,
            Some(Err(problem)) => return Err(refuse(problem.found)),
            None => return Err(refuse("an empty file".to_owned())),
        };
        if header.iter().all(str::is_empty) {
            return Err(refuse("an empty file".to_owned()));
        }
        Ok(Self { file: file.to_owned(), header: header.iter().map(str::to_owned).collect(), text })
    }

    /// Whether the header has this column.
    pub fn has(&self, column: &str) -> bool {
        self.header.iter().any(|name| name == column)
    }

    /// Names of all columns, in the order of the file.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.header.iter().map(String::as_str)
    }

    /// An error about this file; only the first of many problems are kept.
    pub fn error(&self, mut problems: Vec<TableProblem>) -> TableError {
        problems.truncate(MAX_PROBLEMS);
        TableError { file: self.file.clone(), problems }
    }

    /// The numbers of the columns `names`. The numbers of the column `rising`, if it is among them, must rise from row
    /// to row.
    ///
    /// # Errors
    /// A column is missing or occurs twice, fields are not finite numbers, or a row has more fields than the header.
    pub fn numbers(&self, names: &[&str], rising: &str) -> Result<Columns, TableError> {
        self.read_numbers(names, rising, false)
    }

    /// Like [`Table::numbers`], with NaN where a field of another column than `rising` is empty.
    ///
    /// # Errors
    /// As [`Table::numbers`].
    pub fn numbers_with_gaps(&self, names: &[&str], rising: &str) -> Result<Columns, TableError> {
        self.read_numbers(names, rising, true)
    }

    fn read_numbers(&self, names: &[&str], rising: &str, has_gaps: bool) -> Result<Columns, TableError> {
        let places: Result<Vec<usize>, TableProblem> = names.iter().map(|name| self.place(name)).collect();
        let places = places.map_err(|problem| self.error(vec![problem]))?;
        let mut columns = Columns { values: vec![Vec::new(); names.len()], lines: Vec::new() };
        let mut problems = Vec::new();
        for (row, record) in rows(&self.text, b',').skip(1).enumerate() {
            let (line, record) = match record {
                Ok(record) => record,
                Err(problem) => {
                    problems.push(problem);
                    break;
                }
            };
            if record.iter().skip(self.header.len()).any(|field| !field.is_empty()) {
                let found = format!("{} fields in row {}", record.len(), row + 1);
                let allowed = format!("{}, as in the header; numbers with decimal points", self.header.len());
                problems.push(TableProblem { line: Some(line), field: None, found, allowed });
            }
            columns.lines.push(line);
            for ((name, place), values) in names.iter().zip(&places).zip(&mut columns.values) {
                let before = if *name == rising { values.last().copied() } else { None };
                let text = record.get(*place).unwrap_or_default();
                if has_gaps && *name != rising && text.is_empty() {
                    values.push(f64::NAN);
                    continue;
                }
                match parse(text, before) {
                    Ok(value) => values.push(value),
                    Err((found, allowed)) => {
                        let field = Some((row + 1, (*name).to_owned()));
                        problems.push(TableProblem { line: Some(line), field, found, allowed: allowed.to_owned() });
                        // The values that follow are compared with the last good one.
                        values.push(before.unwrap_or(0.0));
                    }
                }
            }
            if problems.len() >= MAX_PROBLEMS {
                break;
            }
        }
        if problems.is_empty() { Ok(columns) } else { Err(self.error(problems)) }
    }

    fn place(&self, column: &str) -> Result<usize, TableProblem> {
        let mut places = self.header.iter().enumerate().filter(|(_, name)| *name == column).map(|(place, _)| place);
        let problem = |found: String, allowed: String| TableProblem { line: Some(1), field: None, found, allowed };
        match (places.next(), places.next()) {
            (Some(place), None) => Ok(place),
            (Some(_), Some(_)) => Err(problem(format!("column \"{column}\" twice"), "each name once".to_owned())),
            (None, _) => {
                let found = format!("no column \"{column}\"; the columns are: {}", self.header.join(", "));
                let separated = self.header.len() == 1 && self.header[0].contains([';', '\t']);
                let hint = match separated {
                    true => ", separated by commas".to_owned(),
                    false => did_you_mean(column, self.names()),
                };
                Err(problem(found, format!("a header with \"{column}\"{hint}")))
            }
        }
    }
}

/// Counts lines while the rows are read; the CSV reader's own count leaves out empty lines.
struct Lines<'a> {
    text: &'a [u8],
    byte: usize,
    line: usize,
}

impl Lines<'_> {
    /// The line of the row that begins at or after a byte; the bytes must rise from call to call.
    fn at(&mut self, byte: usize) -> usize {
        let rest = self.text.get(byte..).unwrap_or_default();
        let begin = byte + rest.iter().take_while(|c| matches!(c, b'\r' | b'\n')).count();
        let passed = self.text.get(self.byte..begin).unwrap_or_default();
        self.line += passed.iter().filter(|c| **c == b'\n').count();
        self.byte = self.byte.max(begin);
        self.line
    }
}

/// All rows of a text with this separator, the header as well, each with its line from 1. Fields have no blanks around
/// them. A row may be shorter or longer than the header.
pub fn rows(text: &str, separator: u8) -> impl Iterator<Item = Result<(usize, csv::StringRecord), TableProblem>> + '_ {
    let mut builder = csv::ReaderBuilder::new();
    builder.has_headers(false).delimiter(separator).trim(csv::Trim::All).flexible(true);
    let mut lines = Lines { text: text.as_bytes(), byte: 0, line: 1 };
    builder.from_reader(text.as_bytes()).into_records().map(move |record| {
        let problem = |found| TableProblem { line: None, field: None, found, allowed: "CSV".to_owned() };
        let record = record.map_err(|error| problem(error.to_string()))?;
        Ok((lines.at(record.position().map_or(0, |position| position.byte() as usize)), record))
    })
}

fn parse(text: &str, before: Option<f64>) -> Result<f64, (String, &'static str)> {
    let finite = "a finite number";
    match text.parse::<f64>() {
        Ok(value) if !value.is_finite() => Err((format!("\"{text}\""), finite)),
        Ok(value) => match before {
            Some(before) if value <= before => {
                Err((format!("{value} after {before}"), "a time later than the row before"))
            }
            _ => Ok(value),
        },
        Err(_) if text.is_empty() => Err(("an empty field".to_owned(), finite)),
        Err(_) => Err((format!("\"{text}\""), finite)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, names: &[&str]) -> Result<Columns, TableError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        Table::read(file.path())?.numbers(names, "t")
    }

    #[test]
    fn an_empty_field_is_a_gap_where_gaps_are_allowed_and_never_in_the_time() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "t,u\n0,\n1,2\n").unwrap();
        let table = Table::read(file.path()).unwrap();
        let values = table.numbers_with_gaps(&["t", "u"], "t").unwrap().values;
        assert!(values[1][0].is_nan() && values[1][1] == 2.0 && values[0] == [0.0, 1.0]);
        assert!(table.numbers(&["t", "u"], "t").unwrap_err().to_string().contains("an empty field"));
        assert!(table.numbers_with_gaps(&["u", "t"], "u").unwrap_err().to_string().contains("an empty field"));
        std::fs::write(file.path(), "t,u\n0,nonsense\n").unwrap();
        assert!(Table::read(file.path()).unwrap().numbers_with_gaps(&["t", "u"], "t").is_err());
    }

    #[test]
    fn columns_are_found_by_name() {
        let columns = read("k, y ,t,u\n7,1.5,0.00,-0.25\n8,1.75,0.02,5e-1\n", &["u", "t"]).unwrap();
        assert_eq!(columns.values, [[-0.25, 0.5], [0.0, 0.02]]);
        assert_eq!(columns.lines, [2, 3]);
        // Some programs end each row with a separator.
        assert_eq!(read("u,t\n1,2,\n3,4,\n", &["u", "t"]).unwrap().values, [[1.0, 3.0], [2.0, 4.0]]);
    }

    #[test]
    fn lines_are_those_of_the_file_whatever_ends_them() {
        assert_eq!(read("u\n\n\n1\n\n2\n", &["u"]).unwrap().lines, [4, 6]);
        assert_eq!(read("u\r\n1\r\n\r\n2\r\n", &["u"]).unwrap().lines, [2, 4]);
        assert_eq!(read("u\n1\n2", &["u"]).unwrap().lines, [2, 3]);
    }

    #[test]
    fn a_problem_is_named_by_line_row_and_column() {
        for (text, expected) in [
            ("t,u\n0,1\n1,\n", ":3: row 2, column \"u\": found an empty field; allowed: a finite number"),
            ("t,u\n0,1\n\n1\n", ":4: row 2, column \"u\": found an empty field"),
            ("t,u\n0,1\n1,nan\n", ":3: row 2, column \"u\": found \"nan\""),
            ("t,u\n0,1\n1,-inf\n", ":3: row 2, column \"u\": found \"-inf\""),
            ("t,u\n0,1\n1,four\n", ":3: row 2, column \"u\": found \"four\""),
            ("t,u\n0,1\n2,3\n0.5,3\n", ":4: row 3, column \"t\": found 0.5 after 2; allowed: a time later"),
            ("t,v\n0,1\n", ":1: found no column \"u\"; the columns are: t, v; allowed: a header with \"u\""),
            ("t;u\n0;1\n", "a header with \"t\", separated by commas"),
            ("t,u\n0,1\n0,5,2,0\n", ":3: found 4 fields in row 2; allowed: 2, as in the header; numbers with decimal"),
            ("t,u,u\n0,1,2\n", ":1: found column \"u\" twice"),
            ("", "found an empty file; allowed: a CSV file with a header"),
        ] {
            let error = read(text, &["t", "u"]).expect_err(text).to_string();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }

    #[test]
    fn all_problems_are_named_up_to_a_bound() {
        let error = read("u\nx\n1\ny\n", &["u"]).unwrap_err();
        assert_eq!(error.problems.len(), 2);
        let many = format!("u\n{}", "x\n".repeat(1000));
        assert_eq!(read(&many, &["u"]).unwrap_err().problems.len(), MAX_PROBLEMS);
    }
}
