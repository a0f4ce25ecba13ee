//! One table of a document, read key by key.

use std::collections::BTreeSet;

use toml::{
    Spanned,
    de::{DeTable, DeValue},
};

use crate::{
    columns::{TableError, TableProblem},
    nearest::{nearest, question},
};

use super::{
    Document,
    record::{EffectiveValue, Origin, Place},
    value::show,
};

/// One value, with the place that it comes from.
pub(super) enum Value<'d, 'i> {
    /// From the document itself.
    File(&'d Spanned<DeValue<'i>>),
    /// From a setting, with the place that the setting comes from.
    Setting(String, Origin),
}

/// One table of the document, being read.
pub(in crate::machine) struct Section<'d, 'i> {
    pub(super) document: &'d Document<'i>,
    table: Option<&'d DeTable<'i>>,
    path: String,
    line: Option<usize>,
    asked: BTreeSet<String>,
    /// Old names of keys, which are refused with the new name.
    renamed: BTreeSet<&'static str>,
}

impl<'d, 'i> Section<'d, 'i> {
    pub(super) fn new(
        document: &'d Document<'i>,
        table: Option<&'d DeTable<'i>>,
        path: String,
        line: Option<usize>,
    ) -> Self {
        Self { document, table, path, line, asked: BTreeSet::new(), renamed: BTreeSet::new() }
    }

    /// Full dotted name of a key in this table.
    pub fn path_of(&self, key: &str) -> String {
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

    /// Whether the file gives a table of this name a value, and not only tables inside it.
    pub fn has_values(&self, table: &str) -> bool {
        let inside = self.table.and_then(|own| own.get(table)).and_then(|value| value.get_ref().as_table());
        inside.is_some_and(|inside| inside.values().any(|value| value.get_ref().as_table().is_none()))
    }

    /// Line of a key of this table; without such a key, line of the table.
    pub fn line_of(&self, key: &str) -> Option<usize> {
        let found = self.table.and_then(|table| table.get(key)).map(|value| self.document.line(value.span().start));
        found.or(self.line)
    }

    /// Where a key of this table is, or should be. A table that only the model file gives is in the model file.
    fn place_of(&self, key: &str) -> Place {
        let prefix = format!("{}.", self.path);
        let settings = self.document.settings.borrow();
        let inside = settings.iter().find(|setting| setting.path.starts_with(&prefix));
        match inside.map(|setting| &setting.origin) {
            Some(Origin::ModelFile { file, .. }) if self.table.is_none() => {
                Place { file: Some(file.clone()), line: None }
            }
            _ => self.line_of(key).into(),
        }
    }

    /// The effective values of all keys of the document that were read so far.
    pub fn values(&self) -> Vec<EffectiveValue> {
        self.document.values()
    }

    /// Whether no problem has been found in the document so far.
    pub fn is_sound(&self) -> bool {
        self.document.problems.borrow().is_empty()
    }

    /// Whether something is wrong with the key of this full dotted name, as far as has been read.
    pub fn is_refused(&self, key: &str) -> bool {
        self.document.problems.borrow().iter().any(|problem| problem.key == key)
    }

    /// The text that the file or a setting gives for a key; none for a value of another type in the file. This does not
    /// read the key.
    pub fn text_of(&self, key: &str) -> Option<String> {
        let path = self.path_of(key);
        let settings = self.document.settings.borrow();
        let set = settings.iter().rfind(|setting| setting.path == path).map(|setting| setting.text.clone());
        set.or_else(|| self.table?.get(key)?.get_ref().as_str().map(str::to_owned))
    }

    /// Refuses a key that is given although another table says what it would say.
    pub fn forbid(&mut self, key: &str, allowed: &str) {
        match self.take(key) {
            None => {}
            Some(Value::File(value)) => self.refuse(key, show(value.get_ref()), allowed),
            Some(Value::Setting(text, _)) => self.refuse(key, text, allowed),
        }
    }

    /// Refuses keys of another kind than the one that the table has. Where the kind comes from the command line
    /// (`is_overridden`), the file still has the keys of its own kind; these are passed over.
    pub fn exclude(&mut self, keys: &[&str], is_overridden: bool, allowed: &str) {
        for key in keys {
            if is_overridden && !self.is_set(key) {
                self.take(key);
            } else {
                self.forbid(key, allowed);
            }
        }
    }

    /// Takes keys as read, whatever they are.
    pub fn pass_over(&mut self, keys: &[&str]) {
        for key in keys {
            self.take(key);
        }
    }

    /// Notes a problem with a key of this table.
    pub fn refuse(&self, key: &str, found: impl Into<String>, allowed: impl Into<String>) {
        let (place, found) = match self.origin_of_setting(key) {
            Some(origin) => (origin.place(), origin.of(found.into())),
            None => (self.place_of(key), found.into()),
        };
        self.document.problem(place, self.path_of(key), found, allowed);
    }

    /// Notes what is wrong with the CSV file that a key of this table names.
    pub fn refuse_table(&self, key: &str, error: TableError) {
        let file = error.file.display().to_string();
        for TableProblem { line, field, found, allowed } in error.problems {
            let field = field.map_or(String::new(), |(row, column)| format!(" in row {row}, column \"{column}\""));
            let place = Place { file: Some(file.clone()), line };
            self.document.problem(place, self.path_of(key), found + &field, allowed);
        }
    }

    /// Takes the value of a key, if there is one, and notes that the key was asked for.
    pub(super) fn take(&mut self, key: &str) -> Option<Value<'d, 'i>> {
        self.asked.insert(key.to_owned());
        let path = self.path_of(key);
        let mut settings = self.document.settings.borrow_mut();
        // The last of several settings counts, as on any command line.
        let mut chosen = None;
        for setting in settings.iter_mut().filter(|setting| setting.path == path) {
            setting.used = true;
            chosen = Some((setting.text.clone(), setting.origin.clone()));
        }
        match chosen {
            Some((text, origin)) => Some(Value::Setting(text, origin)),
            None => self.table.and_then(|table| table.get(key)).map(Value::File),
        }
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
        Section::new(self.document, table, self.path_of(key), line)
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
            let path = format!("{}[{i}]", self.path_of(key));
            let line = Some(self.document.line(item.span().start));
            let table = item.get_ref().as_table();
            if table.is_none() {
                self.document.problem(line, path.clone(), show(item.get_ref()), "a table");
            }
            Section::new(self.document, table, path, line)
        });
        sections.collect()
    }

    /// Notes that the effective value of a key follows from other keys, whatever was read for it.
    pub fn derive(&self, key: &str, value: String, rule: &str) {
        self.document.derive(&self.path_of(key), value, rule);
    }

    /// Refuses the old name of a key and says the new one, `to`, which is relative to this table.
    pub fn renamed(&mut self, key: &'static str, to: &str) {
        if self.take(key).is_some() {
            let place = self.origin_of_setting(key).map_or_else(|| self.line_of(key).into(), |origin| origin.place());
            let allowed = format!("{}, its new name", self.path_of(to));
            self.document.problem(place, self.path_of(key), "a key that has been renamed", allowed);
        }
        self.asked.remove(key);
        self.renamed.insert(key);
    }

    /// Whether the command line or a model file gives this key.
    pub fn is_set(&self, key: &str) -> bool {
        self.origin_of_setting(key).is_some()
    }

    /// Whether the file, the command line or a model file gives this key.
    pub fn is_present(&self, key: &str) -> bool {
        self.is_set(key) || self.table.is_some_and(|table| table.get(key).is_some())
    }

    /// Where the value of this key comes from, if it takes the place of the value in the file.
    fn origin_of_setting(&self, key: &str) -> Option<Origin> {
        let path = self.path_of(key);
        let settings = self.document.settings.borrow();
        settings.iter().rfind(|setting| setting.path == path).map(|setting| setting.origin.clone())
    }

    /// Ends the reading: a key that was not asked for is unknown.
    pub fn finish(self) {
        let known: Vec<String> = self.asked.iter().cloned().collect();
        for key in self.table.into_iter().flat_map(|table| table.keys()) {
            if !self.asked.contains(key.get_ref().as_ref()) && !self.renamed.contains(key.get_ref().as_ref()) {
                let line = Some(self.document.line(key.span().start));
                let meant = nearest(key.get_ref(), self.asked.iter().map(String::as_str));
                for meant in &meant {
                    self.document.mistyped(self.path_of(key.get_ref()), self.path_of(meant));
                }
                let hint = question(meant);
                let allowed = format!("one of {}{hint}", known.join(", "));
                self.document.problem(line, self.path_of(key.get_ref()), "an unknown key", allowed);
            }
        }
        self.document.tables.borrow_mut().push((self.path, known));
    }
}
