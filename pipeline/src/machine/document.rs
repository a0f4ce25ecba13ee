//! Reads a TOML document key by key and collects every problem, instead of stopping at the first.
//!
//! Each key is asked for once, with what is allowed; what was never asked for is an unknown key. Values given on
//! the command line (`--set a.b=c`) take the place of those in the file.

use std::{cell::RefCell, collections::BTreeSet, ops::RangeInclusive, time::Duration};

use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use super::{MachineError, Problem};

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

/// One value, wherever it comes from.
enum Value<'d, 'i> {
    File(&'d Spanned<DeValue<'i>>),
    Setting(String),
}

/// One table of the document, being read.
pub(super) struct Section<'d, 'i> {
    document: &'d Document<'i>,
    table: Option<&'d DeTable<'i>>,
    path: String,
    line: Option<usize>,
    asked: BTreeSet<String>,
    /// Keys that have another name now and were refused with it.
    renamed: BTreeSet<&'static str>,
}

impl<'d, 'i> Section<'d, 'i> {
    /// Full dotted name of a key in this table.
    pub fn key(&self, key: &str) -> String {
        match (self.path.as_str(), key) {
            ("", key) => key.to_owned(),
            (path, "") => path.to_owned(),
            (path, key) => format!("{path}.{key}"),
        }
    }

    /// Whether the file or the command line gives anything for this table.
    pub fn is_given(&self) -> bool {
        let prefix = format!("{}.", self.path);
        self.table.is_some() || self.document.settings.borrow().iter().any(|s| s.path.starts_with(&prefix))
    }

    /// Names of the keys in the file, in its order.
    pub fn names(&self) -> Vec<String> {
        self.table.into_iter().flat_map(|table| table.keys()).map(|key| key.get_ref().to_string()).collect()
    }

    /// The line that the table or one of its keys stands on.
    pub fn line_of(&self, key: &str) -> Option<usize> {
        let found = self.table.and_then(|table| table.get(key)).map(|value| self.document.line(value.span().start));
        found.or(self.line)
    }

    /// Notes a problem with a key of this table.
    pub fn refuse(&self, key: &str, found: impl Into<String>, allowed: impl Into<String>) {
        self.document.problem(self.line_of(key), self.key(key), found, allowed);
    }

    fn take(&mut self, key: &str) -> Option<Value<'d, 'i>> {
        self.asked.insert(key.to_owned());
        let path = self.key(key);
        let mut settings = self.document.settings.borrow_mut();
        // The last of several settings counts, as on any command line.
        let mut chosen = None;
        for setting in settings.iter_mut().filter(|setting| setting.path == path) {
            setting.used = true;
            chosen = Some(setting.text.clone());
        }
        match chosen {
            Some(text) => Some(Value::Setting(text)),
            None => self.table.and_then(|table| table.get(key)).map(Value::File),
        }
    }

    /// Reads a required key by `parse`, which returns what is wrong with the value, if anything.
    fn required<T>(&mut self, key: &str, allowed: &str, placeholder: T, parse: impl Fn(&DeValue) -> Option<T>) -> T {
        match self.optional(key, allowed, parse) {
            Some(Some(value)) => value,
            Some(None) => placeholder,
            None => {
                self.refuse(key, "nothing", allowed);
                placeholder
            }
        }
    }

    /// `None` when the key is absent, `Some(None)` when its value was refused.
    fn optional<T>(&mut self, key: &str, allowed: &str, parse: impl Fn(&DeValue) -> Option<T>) -> Option<Option<T>> {
        let (parsed, shown, line) = match self.take(key)? {
            Value::File(value) => (parse(value.get_ref()), show(value.get_ref()), self.line_of(key)),
            Value::Setting(text) => {
                // A setting is TOML where it can be, else a plain string, as in `--set scenario=payload`.
                let as_toml = DeValue::parse(&text).ok().and_then(|value| parse(value.get_ref()));
                let parsed = as_toml.or_else(|| parse(&DeValue::String(text.as_str().into())));
                (parsed, format!("{text} (from the command line)"), None)
            }
        };
        if parsed.is_none() {
            self.document.problem(line, self.key(key), shown, allowed);
        }
        Some(parsed)
    }

    /// A number in `range`; `unit` is shown with it. NaN is outside every range.
    pub fn number(&mut self, key: &str, range: RangeInclusive<f64>, unit: &str) -> f64 {
        let allowed = format!("a number from {} to {} {unit}", range.start(), range.end());
        // In the place of a refused number the largest: then what depends on it is not refused as well.
        self.required(key, allowed.trim_end(), *range.end(), |value| number(value, &range))
    }

    /// The same with a default.
    pub fn number_or(&mut self, key: &str, default: f64, range: RangeInclusive<f64>, unit: &str) -> f64 {
        self.optional_number(key, range, unit).unwrap_or(default)
    }

    /// The same, or nothing.
    pub fn optional_number(&mut self, key: &str, range: RangeInclusive<f64>, unit: &str) -> Option<f64> {
        let allowed = format!("a number from {} to {} {unit}", range.start(), range.end());
        self.optional(key, allowed.trim_end(), |value| number(value, &range)).flatten()
    }

    /// A list of numbers in `range`, of any length from `shortest` on.
    pub fn numbers(&mut self, key: &str, range: RangeInclusive<f64>, unit: &str, shortest: usize) -> Vec<f64> {
        let allowed = format!("a list of {shortest} or more numbers from {} to {} {unit}", range.start(), range.end());
        self.required(key, allowed.trim_end(), Vec::new(), |value| {
            let list = value.as_array()?;
            let numbers: Option<Vec<f64>> = list.iter().map(|item| number(item.get_ref(), &range)).collect();
            numbers.filter(|numbers| numbers.len() >= shortest)
        })
    }

    /// A list of numbers in `range`, or nothing; `allowed` says what else is asked of it.
    pub fn optional_numbers(&mut self, key: &str, range: RangeInclusive<f64>, allowed: &str) -> Option<Vec<f64>> {
        self.optional(key, allowed, |value| {
            value.as_array()?.iter().map(|item| number(item.get_ref(), &range)).collect()
        })
        .flatten()
    }

    /// Three numbers in `range`, or one that stands for all; `names` says what the three are.
    pub fn number_or_three(&mut self, key: &str, range: RangeInclusive<f64>, unit: &str, names: &str) -> [f64; 3] {
        let allowed = format!("a number from {} to {} {unit}, or three, {names}", range.start(), range.end());
        self.required(key, &allowed, [*range.end(); 3], |value| match value.as_array() {
            None => number(value, &range).map(|all| [all; 3]),
            Some(list) => {
                let numbers: Option<Vec<f64>> = list.iter().map(|item| number(item.get_ref(), &range)).collect();
                numbers?.try_into().ok()
            }
        })
    }

    /// Two numbers in `range`, or one that stands for both, with a default.
    pub fn pair_or(&mut self, key: &str, default: (f64, f64), range: RangeInclusive<f64>) -> (f64, f64) {
        let allowed = format!("a number from {} to {}, or [low, high] of two", range.start(), range.end());
        let parse = |value: &DeValue| match value.as_array() {
            None => number(value, &range).map(|both| (both, both)),
            Some(list) if list.len() == 2 => {
                Some((number(list[0].get_ref(), &range)?, number(list[1].get_ref(), &range)?))
            }
            Some(_) => None,
        };
        self.optional(key, &allowed, parse).flatten().unwrap_or(default)
    }

    /// A whole number in `range` with a default.
    pub fn integer_or(&mut self, key: &str, default: usize, range: RangeInclusive<usize>) -> usize {
        self.optional_integer(key, range).unwrap_or(default)
    }

    /// A whole number in `range`, or nothing.
    pub fn optional_integer(&mut self, key: &str, range: RangeInclusive<usize>) -> Option<usize> {
        let allowed = format!("a whole number from {} to {}", range.start(), range.end());
        self.optional(key, &allowed, |value| count(value).filter(|number| range.contains(number))).flatten()
    }

    /// A duration with its unit, such as `"10ms"`, in `range`.
    pub fn duration(&mut self, key: &str, range: RangeInclusive<Duration>) -> Duration {
        let allowed = allowed_duration(&range);
        self.required(key, &allowed, *range.start(), |value| duration(value, &range))
    }

    /// The same with a default.
    pub fn duration_or(&mut self, key: &str, default: Duration, range: RangeInclusive<Duration>) -> Duration {
        self.optional_duration(key, range).unwrap_or(default)
    }

    /// The same, or nothing.
    pub fn optional_duration(&mut self, key: &str, range: RangeInclusive<Duration>) -> Option<Duration> {
        let allowed = allowed_duration(&range);
        self.optional(key, &allowed, |value| duration(value, &range)).flatten()
    }

    /// Samples, given as a whole number or as a duration that is divided by `period`.
    pub fn samples_or(&mut self, key: &str, default: usize, range: RangeInclusive<usize>, period: Duration) -> usize {
        let allowed = format!(
            "{} to {} samples of {}, as a whole number or a duration such as \"0.5s\"",
            range.start(),
            range.end(),
            humantime::format_duration(period)
        );
        let parse = |value: &DeValue| {
            let samples = match value.as_str() {
                Some(text) => super::samples_of(humantime::parse_duration(text).ok()?, period),
                None => count(value)?,
            };
            Some(samples).filter(|samples| range.contains(samples))
        };
        self.optional(key, &allowed, parse).flatten().unwrap_or(default)
    }

    /// Any text.
    pub fn text(&mut self, key: &str, allowed: &str) -> String {
        self.required(key, allowed, String::new(), |value| value.as_str().map(str::to_owned))
    }

    /// Any text, or nothing.
    pub fn optional_text(&mut self, key: &str) -> Option<String> {
        self.optional(key, "a text", |value| value.as_str().map(str::to_owned)).flatten()
    }

    /// Any text, or the default.
    pub fn text_or(&mut self, key: &str, default: &str) -> String {
        self.optional_text(key).unwrap_or_else(|| default.to_owned())
    }

    /// A list of texts, or nothing.
    pub fn optional_texts(&mut self, key: &str, allowed: &str) -> Option<Vec<String>> {
        self.optional(key, allowed, |value| {
            let list = value.as_array()?;
            list.iter().map(|item| item.get_ref().as_str().map(str::to_owned)).collect()
        })
        .flatten()
    }

    /// A list of lists of texts, or nothing.
    pub fn optional_text_table(&mut self, key: &str, allowed: &str) -> Option<Vec<Vec<String>>> {
        self.optional(key, allowed, |value| {
            let row = |row: &Spanned<DeValue>| -> Option<Vec<String>> {
                let cells = row.get_ref().as_array()?;
                cells.iter().map(|cell| cell.get_ref().as_str().map(str::to_owned)).collect()
            };
            value.as_array()?.iter().map(row).collect()
        })
        .flatten()
    }

    /// `true` or `false`, with a default.
    pub fn flag_or(&mut self, key: &str, default: bool) -> bool {
        self.optional(key, "true or false", |value| value.as_bool()).flatten().unwrap_or(default)
    }

    /// One of the named choices.
    pub fn choice<T: Copy>(&mut self, key: &str, choices: &[(&str, T)]) -> Option<T> {
        let allowed = allowed_choice(choices);
        self.required(key, &allowed, None, |value| choose(value, choices).map(Some))
    }

    /// One of the named choices, or the default.
    pub fn choice_or<T: Copy>(&mut self, key: &str, default: T, choices: &[(&str, T)]) -> T {
        let allowed = allowed_choice(choices);
        self.optional(key, &allowed, |value| choose(value, choices)).flatten().unwrap_or(default)
    }

    /// Whatever its `FromStr` takes, or the default.
    pub fn parsed_or<T: std::str::FromStr>(&mut self, key: &str, default: T, allowed: &str) -> T {
        self.optional(key, allowed, |value| value.as_str()?.parse().ok()).flatten().unwrap_or(default)
    }

    /// A table inside this one; an absent one reads as empty.
    pub fn section(&mut self, key: &str) -> Section<'d, 'i> {
        self.asked.insert(key.to_owned());
        let value = self.table.and_then(|table| table.get(key));
        let table = value.and_then(|value| value.get_ref().as_table());
        if let (Some(value), None) = (value, table) {
            self.refuse(key, show(value.get_ref()), "a table");
        }
        let line = value.map(|value| self.document.line(value.span().start)).or(self.line);
        Section {
            document: self.document,
            table,
            path: self.key(key),
            line,
            asked: BTreeSet::new(),
            renamed: BTreeSet::new(),
        }
    }

    /// The tables of a list; an absent list reads as empty.
    pub fn list(&mut self, key: &str) -> Vec<Section<'d, 'i>> {
        self.asked.insert(key.to_owned());
        let Some(value) = self.table.and_then(|table| table.get(key)) else { return Vec::new() };
        let Some(items) = value.get_ref().as_array() else {
            self.refuse(key, show(value.get_ref()), "a list of tables");
            return Vec::new();
        };
        let sections = items.iter().enumerate().map(|(i, item)| {
            let path = format!("{}[{i}]", self.key(key));
            let line = Some(self.document.line(item.span().start));
            let table = item.get_ref().as_table();
            if table.is_none() {
                self.document.problem(line, path.clone(), show(item.get_ref()), "a table");
            }
            Section { document: self.document, table, path, line, asked: BTreeSet::new(), renamed: BTreeSet::new() }
        });
        sections.collect()
    }

    /// Refuses the old name of a key and says the new one, `to`, which is relative to this table.
    pub fn renamed(&mut self, key: &'static str, to: &str) {
        let is_set = self.is_set(key);
        if self.take(key).is_some() {
            let line = if is_set { None } else { self.line_of(key) };
            let allowed = format!("{}, its new name", self.key(to));
            self.document.problem(line, self.key(key), "a key that has been renamed", allowed);
        }
        self.asked.remove(key);
        self.renamed.insert(key);
    }

    /// Whether the command line gives this key.
    pub fn is_set(&self, key: &str) -> bool {
        let path = self.key(key);
        self.document.settings.borrow().iter().any(|setting| setting.path == path)
    }

    /// Ends the reading: whatever was not asked for is unknown.
    pub fn finish(self) {
        for key in self.table.into_iter().flat_map(|table| table.keys()) {
            if !self.asked.contains(key.get_ref().as_ref()) && !self.renamed.contains(key.get_ref().as_ref()) {
                let known: Vec<&str> = self.asked.iter().map(String::as_str).collect();
                let line = Some(self.document.line(key.span().start));
                let allowed = format!("one of {}", known.join(", "));
                self.document.problem(line, self.key(key.get_ref()), "an unknown key", allowed);
            }
        }
    }
}

fn number(value: &DeValue, range: &RangeInclusive<f64>) -> Option<f64> {
    let digits = match value {
        DeValue::Float(float) => float.as_str(),
        DeValue::Integer(_) => {
            return integer(value).map(|number| number as f64).filter(|number| range.contains(number));
        }
        _ => return None,
    };
    // `contains` is false for NaN, which TOML allows.
    digits.parse().ok().filter(|number| range.contains(number))
}

fn integer(value: &DeValue) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

fn count(value: &DeValue) -> Option<usize> {
    usize::try_from(integer(value)?).ok()
}

fn duration(value: &DeValue, range: &RangeInclusive<Duration>) -> Option<Duration> {
    humantime::parse_duration(value.as_str()?).ok().filter(|duration| range.contains(duration))
}

fn allowed_duration(range: &RangeInclusive<Duration>) -> String {
    let (start, end) = (humantime::format_duration(*range.start()), humantime::format_duration(*range.end()));
    format!("a duration with its unit, \"{start}\" to \"{end}\"")
}

fn choose<T: Copy>(value: &DeValue, choices: &[(&str, T)]) -> Option<T> {
    let text = value.as_str()?;
    choices.iter().find(|(name, _)| *name == text).map(|(_, choice)| *choice)
}

fn allowed_choice<T>(choices: &[(&str, T)]) -> String {
    let names: Vec<String> = choices.iter().map(|(name, _)| format!("\"{name}\"")).collect();
    names.join(" or ")
}

/// A value as the user wrote it, with its type.
fn show(value: &DeValue) -> String {
    match value {
        DeValue::String(text) => format!("\"{text}\""),
        DeValue::Integer(integer) => integer.as_str().to_owned(),
        DeValue::Float(float) => float.as_str().to_owned(),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::Datetime(time) => time.to_string(),
        DeValue::Array(list) => {
            let items: Vec<String> = list.iter().map(|item| show(item.get_ref())).collect();
            format!("[{}]", items.join(", "))
        }
        DeValue::Table(_) => "a table".to_owned(),
    }
}
