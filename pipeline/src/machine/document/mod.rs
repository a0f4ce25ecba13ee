//! Reads a TOML document key by key and collects every problem, instead of stopping at the first.
//!
//! Each key is asked for once, with what is allowed; what was never asked for is an unknown key. Values given on
//! the command line (`--set a.b=c`) take the place of those in the file.

mod section;
mod value;

use std::{cell::RefCell, collections::BTreeSet};

use toml::de::DeTable;

pub(super) use section::Section;
pub use value::samples_of;

use super::error::{MachineError, Problem};
use value::show;

/// A value from the command line that takes the place of one in the file.
struct Setting {
    path: String,
    text: String,
    used: bool,
}

/// A parsed document with its settings and the problems found so far.
pub(super) struct Document<'i> {
    root: DeTable<'i>,
    text: &'i str,
    settings: RefCell<Vec<Setting>>,
    /// What is not TOML at all.
    grammar: Vec<Problem>,
    problems: RefCell<Vec<Problem>>,
}

impl<'i> Document<'i> {
    /// Parses `text`; grammar errors are collected like all others.
    pub fn parse(text: &'i str, settings: &[(String, String)]) -> Self {
        let (root, errors) = DeTable::parse_recoverable(text);
        let settings = (settings.iter())
            .map(|(path, text)| Setting { path: path.clone(), text: text.clone(), used: false })
            .collect();
        let mut document = Self {
            root: root.into_inner(),
            text,
            settings: RefCell::new(settings),
            grammar: Vec::new(),
            problems: RefCell::default(),
        };
        for error in errors {
            let (line, at) = match error.span() {
                Some(span) => {
                    let line = document.line(span.start);
                    let shown = text.lines().nth(line - 1).unwrap_or_default().trim();
                    (Some(line), format!(" in \"{shown}\""))
                }
                None => (None, String::new()),
            };
            let found = format!("{}{at}", error.message());
            document.grammar.push(Problem { line, key: String::new(), found, allowed: "valid TOML".to_owned() });
        }
        document
    }

    /// The top of the document.
    pub fn root(&self) -> Section<'_, 'i> {
        Section {
            document: self,
            table: Some(&self.root),
            path: String::new(),
            line: None,
            asked: BTreeSet::new(),
            renamed: BTreeSet::new(),
        }
    }

    /// Notes a problem that only the reader can see.
    pub fn problem(
        &self,
        line: Option<usize>,
        key: impl Into<String>,
        found: impl Into<String>,
        allowed: impl Into<String>,
    ) {
        self.problems.borrow_mut().push(Problem {
            line,
            key: key.into(),
            found: found.into(),
            allowed: allowed.into(),
        });
    }

    /// `value`, or all problems in the order of lines; settings that named no known key are among them.
    pub fn into_result<T>(self, file: &str, value: T) -> Result<T, MachineError> {
        // What follows from a broken line says nothing: those are to be mended first.
        if !self.grammar.is_empty() {
            return Err(MachineError { file: file.to_owned(), problems: self.grammar });
        }
        for setting in self.settings.borrow().iter().filter(|setting| !setting.used) {
            self.problem(
                None,
                format!("--set {}", setting.path),
                "an unknown key",
                "a key of the machine file, not a table",
            );
        }
        let mut problems = self.problems.into_inner();
        problems.sort_by_key(|problem| problem.line.unwrap_or(usize::MAX));
        if problems.is_empty() { Ok(value) } else { Err(MachineError { file: file.to_owned(), problems }) }
    }

    /// Every value of the document with its full key, as settings for another one.
    pub fn into_settings(self, file: &str) -> Result<Vec<(String, String)>, MachineError> {
        fn collect(prefix: &str, table: &DeTable, settings: &mut Vec<(String, String)>) {
            for (key, value) in table {
                let path = format!("{prefix}{}", key.get_ref());
                match value.get_ref().as_table() {
                    Some(table) => collect(&format!("{path}."), table, settings),
                    None => settings.push((path, show(value.get_ref()))),
                }
            }
        }
        let mut settings = Vec::new();
        collect("", &self.root, &mut settings);
        self.into_result(file, settings)
    }

    fn line(&self, offset: usize) -> usize {
        1 + self.text[..offset.min(self.text.len())].matches('\n').count()
    }
}
