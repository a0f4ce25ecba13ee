//! Reads a TOML document key by key and collects every problem, instead of stopping at the first.
//!
//! | file | what it holds |
//! |---|---|
//! | `section` | one table: its keys, the tables inside it, what is unknown |
//! | `key` | one key: meaning, allowed values, default, and the reading of its value |
//! | `form` | what form a value has, for editors |
//! | `grammar` | where the text is no TOML |
//! | `value` | TOML values as numbers, durations and choices, and back to text |
//! | `record` | the effective value of a key, and where the value comes from |
//!
//! Each key is asked for once, with its meaning, what is allowed and its default. A key that was never asked for is
//! unknown. Settings, from a model file or the command line (`--set a.b=c`), take the place of values in the document.

mod form;
mod grammar;
mod key;
mod record;
mod section;
mod value;

use std::cell::RefCell;

use toml::de::DeTable;

pub use form::ValueForm;
pub(super) use record::Place;
pub use record::{DefaultValue, EffectiveValue, Origin};
pub(super) use section::Section;
pub(super) use value::Shown;
pub use value::samples_of;

use super::error::{MachineError, Problem};
use crate::nearest::{did_you_mean, nearest, question};
use value::show;

/// What was found in the place of a key that is absent.
const NOTHING: &str = "nothing";

/// A value that takes the place of one in the document.
#[derive(Debug, Clone)]
pub(super) struct Setting {
    /// Full dotted name of the key.
    pub path: String,
    /// The value as text.
    pub text: String,
    /// Where the value comes from.
    pub origin: Origin,
    used: bool,
}

impl Setting {
    /// A setting that no key has used yet.
    pub fn new(path: String, text: String, origin: Origin) -> Self {
        Self { path, text, origin, used: false }
    }

    /// The settings of a command line.
    pub fn typed(settings: &[(String, String)]) -> Vec<Self> {
        let typed = |(path, text): &(String, String)| Self::new(path.clone(), text.clone(), Origin::CommandLine);
        settings.iter().map(typed).collect()
    }
}

/// What was read for one key.
#[derive(Debug, Clone)]
pub(super) struct Entry {
    /// The effective value.
    pub value: EffectiveValue,
    /// Words of the table of all keys for what is allowed, where that depends on other keys.
    pub allows: Option<String>,
    /// Forms that the value can have.
    pub forms: Vec<ValueForm>,
}

/// A parsed document with its settings, and what has been found while it was read.
pub(super) struct Document<'i> {
    root: DeTable<'i>,
    /// Where the lines of the text end.
    line_ends: Vec<usize>,
    settings: RefCell<Vec<Setting>>,
    /// Where the text is no TOML.
    grammar: Vec<Problem>,
    problems: RefCell<Vec<Problem>>,
    /// What was read, in the order of asking.
    entries: RefCell<Vec<Entry>>,
    /// Path and known keys of each table that was read.
    tables: RefCell<Vec<(String, Vec<String>)>>,
    /// Unknown keys, each with a known one that it may have meant; full dotted names.
    mistyped: RefCell<Vec<(String, String)>>,
}

impl<'i> Document<'i> {
    /// Parses `text`; grammar errors are collected like all others.
    pub fn parse(text: &'i str, settings: Vec<Setting>) -> Self {
        let (root, errors) = DeTable::parse_recoverable(text);
        Self {
            root: root.into_inner(),
            line_ends: text.match_indices('\n').map(|(end, _)| end).collect(),
            settings: RefCell::new(settings),
            grammar: grammar::problems(text, &errors),
            problems: RefCell::default(),
            entries: RefCell::default(),
            tables: RefCell::default(),
            mistyped: RefCell::default(),
        }
    }

    /// Whether the text has no key at all.
    pub fn is_empty(&self) -> bool {
        self.grammar.is_empty() && self.root.is_empty()
    }

    /// Notes that an unknown key may have meant a known one; full dotted names.
    pub fn mistyped(&self, key: String, meant: String) {
        self.mistyped.borrow_mut().push((key, meant));
    }

    /// Whether a problem says that a key is missing which a mistyped table has.
    fn is_in_mistyped(&self, problem: &Problem) -> bool {
        let has = |path: String| {
            let (table, key) = path.rsplit_once('.').unwrap_or(("", &path));
            self.names(table).iter().any(|name| name == key)
        };
        let within = |(typed, meant): &(String, String)| {
            problem
                .key
                .strip_prefix(meant.as_str())
                .is_some_and(|rest| rest.starts_with('.') && has(format!("{typed}{rest}")))
        };
        problem.found == NOTHING && self.mistyped.borrow().iter().any(within)
    }

    /// The top of the document.
    pub fn root(&self) -> Section<'_, 'i> {
        Section::new(self, Some(&self.root), String::new(), None)
    }

    /// Adds settings that rank before those that are there.
    pub fn prepend(&self, settings: Vec<Setting>) {
        self.settings.borrow_mut().splice(0..0, settings);
    }

    /// Names of the keys of a table of the text, in its order; none of a table that is not there.
    pub fn names(&self, table: &str) -> Vec<String> {
        let mut parts = table.split('.').filter(|part| !part.is_empty());
        let found = parts.try_fold(&self.root, |table, part| table.get(part)?.get_ref().as_table());
        found.into_iter().flat_map(|table| table.keys()).map(|key| key.get_ref().to_string()).collect()
    }

    /// The machine's name.
    pub fn name(&self) -> Option<&str> {
        self.root.get("name")?.get_ref().as_str()
    }

    /// Notes what was read for a key.
    pub fn record(&self, entry: Entry) {
        self.entries.borrow_mut().push(entry);
    }

    /// Notes that the effective value of a key follows from other keys, whatever was read for it.
    pub fn derive(&self, key: &str, value: String, rule: &str) {
        let mut entries = self.entries.borrow_mut();
        if let Some(Entry { value: known, .. }) = entries.iter_mut().find(|entry| entry.value.key == key) {
            (known.value, known.origin) = (Some(value), Origin::Derived { rule: rule.to_owned() });
        }
    }

    /// What was read for all keys that were asked for, in the order of asking.
    pub fn entries(&self) -> Vec<Entry> {
        self.entries.borrow().clone()
    }

    /// The effective values of all keys that were asked for, in the order of asking.
    pub fn values(&self) -> Vec<EffectiveValue> {
        self.entries.borrow().iter().map(|entry| entry.value.clone()).collect()
    }

    /// Notes a problem.
    pub fn problem(
        &self,
        place: impl Into<Place>,
        key: impl Into<String>,
        found: impl Into<String>,
        allowed: impl Into<String>,
    ) {
        let Place { file, line } = place.into();
        self.problems.borrow_mut().push(Problem {
            file,
            line,
            key: key.into(),
            found: found.into(),
            allowed: allowed.into(),
        });
    }

    /// `value`, or all problems in the order of lines. A setting whose key is unknown is a problem too.
    pub fn into_result<T>(self, file: &str, value: T) -> Result<T, MachineError> {
        // A broken line makes other keys look wrong that are not, so broken lines are shown alone.
        if !self.grammar.is_empty() {
            return Err(MachineError { file: file.to_owned(), problems: self.grammar });
        }
        for setting in self.settings.borrow().iter().filter(|setting| !setting.used) {
            let (key, found, allowed) = self.unknown(&setting.path);
            let (key, found) = match setting.origin {
                Origin::CommandLine => (format!("--set {key}"), found.to_owned()),
                _ => (key, setting.origin.of(found.to_owned())),
            };
            // A whole table that is unknown is one problem.
            if !self.problems.borrow().iter().any(|problem| problem.key == key) {
                self.problem(setting.origin.place(), key, found, allowed);
            }
        }
        let mut problems = self.problems.take();
        problems.retain(|problem| !self.is_in_mistyped(problem));
        problems.sort_by_key(|problem| (problem.file.is_some(), problem.line.unwrap_or(usize::MAX)));
        if problems.is_empty() { Ok(value) } else { Err(MachineError { file: file.to_owned(), problems }) }
    }

    /// The first part of a setting's path that takes no value, what it is, and what is allowed: for an unknown key the
    /// keys of the table that should have it.
    fn unknown(&self, path: &str) -> (String, &'static str, String) {
        let tables = self.tables.borrow();
        let below =
            |table: &str| if table.is_empty() { Some(path) } else { path.strip_prefix(table)?.strip_prefix('.') };
        let deepest = tables.iter().filter(|(table, _)| below(table).is_some()).max_by_key(|(table, _)| table.len());
        let entries = self.entries.borrow();
        let whole = || {
            let inside = |key: &&str| key.strip_prefix(path).is_some_and(|rest| rest.starts_with(['.', '[']));
            let first = entries.iter().map(|entry| entry.value.key.as_str()).find(inside);
            let such = first.map_or(String::new(), |key| format!(", such as {key}"));
            let allowed = format!("a key inside it{such}; the machine file takes the whole");
            (path.to_owned(), "one value for a table or a list of tables", allowed)
        };
        let Some((table, known)) = deepest else { return whole() };
        let rest = below(table).unwrap_or_default();
        let name = rest.split('.').next().unwrap_or_default();
        let unknown = path[..path.len() - rest.len() + name.len()].to_owned();
        match known.iter().any(|known| known == name) {
            true if name == rest => return whole(),
            true => return (path.to_owned(), "an unknown key", format!("{unknown}, which has no keys inside it")),
            false => {}
        }
        let end = path.rsplit('.').next().unwrap_or_default();
        let is_inside = |key: &str| table.is_empty() || key.starts_with(&format!("{table}."));
        let has_name = |key: &&str| is_inside(key) && key.rsplit('.').next() == Some(end);
        let others: Vec<&str> = entries.iter().map(|entry| entry.value.key.as_str()).filter(has_name).collect();
        let others = match (did_you_mean(name, known.iter().map(String::as_str)), &others[..]) {
            // A table that is mistyped.
            (hint, _) if !hint.is_empty() && name != rest => hint,
            (hint, []) if hint.is_empty() && name == rest => {
                // A key that is mistyped, and that another table has.
                let inside = || entries.iter().map(|entry| entry.value.key.as_str()).filter(|key| is_inside(key));
                let last = |key: &'_ str| key.rsplit('.').next().map(str::to_owned).unwrap_or_default();
                let lasts: Vec<String> = inside().map(last).collect();
                let near = nearest(name, lasts.iter().map(String::as_str));
                question(inside().filter(|key| near.contains(&last(key).as_str())))
            }
            (hint, []) => hint,
            (_, others) => format!("; or {}", others.join(", ")),
        };
        (unknown, "an unknown key", format!("one of {}{others}", known.join(", ")))
    }

    /// Every value of the document with its full key and its line, as settings for another document.
    pub fn into_settings(self, file: &str) -> Result<Vec<Setting>, MachineError> {
        let mut settings = Vec::new();
        self.collect(file, "", &self.root, &mut settings);
        self.into_result(file, settings)
    }

    fn collect(&self, file: &str, prefix: &str, table: &DeTable, settings: &mut Vec<Setting>) {
        for (key, value) in table {
            let path = format!("{prefix}{}", key.get_ref());
            match value.get_ref().as_table() {
                Some(table) => self.collect(file, &format!("{path}."), table, settings),
                None => {
                    let origin = Origin::ModelFile { file: file.to_owned(), line: self.line(value.span().start) };
                    settings.push(Setting::new(path, show(value.get_ref()), origin));
                }
            }
        }
    }

    fn line(&self, offset: usize) -> usize {
        1 + self.line_ends.partition_point(|end| *end < offset)
    }
}
