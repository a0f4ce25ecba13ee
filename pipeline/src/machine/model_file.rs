//! Model files: what may stand in them, and how they are told from machine files.
//!
//! A model file is what `hydraxis commission` writes, and what `--model` takes: for each axis the tables
//! `commissioned`, `control` and `identification`. It says how an axis answers and with which settings it is
//! controlled. What the machine is, and the limits that protect it, are in the machine file: a model of another machine
//! must not change them.
//!
//! The models of `hydraxis identify` are others: coefficients of a difference equation, without dead time, dead bands
//! and speeds of an axis, and without gains. `hydraxis predict` applies them.

use std::{collections::BTreeSet, path::Path};

use super::{
    document::{Document, Place, Setting},
    error::MachineError,
    read_file,
};

/// Tables of an axis that a model file may have.
const TABLES: [&str; 3] = ["commissioned", "control", "identification"];
/// Keys of `control` that protect the machine. `commission` keeps to them and does not write them.
const LIMITS: [&str; 7] =
    ["command_limit", "command_rate", "following_error", "stop_deceleration", "stop_reaction", "rest_band", "jerk"];

/// The values of a model file with this text, and `file`, its name for messages.
///
/// # Errors
/// The text is not TOML, or that of a machine file.
pub(super) fn parse(text: &str, file: &str) -> Result<Vec<Setting>, MachineError> {
    let document = Document::parse(text, Vec::new());
    if is_machine(&document) {
        let allowed = "a model file, such as `hydraxis commission MACHINE.toml --out FILE` writes, and this file as \
                       MACHINE.toml";
        let found = "a machine file in the place of a model file";
        return Err(MachineError::of_file(file.to_owned(), found, allowed));
    }
    if is_identified(&document) {
        let found = "a model of `hydraxis identify`, which `hydraxis predict` applies";
        let allowed = "a model file, such as `hydraxis commission MACHINE.toml --out FILE` writes: an identified model \
                       has neither the speeds and dead bands of the axis, nor gains of a controller";
        return Err(MachineError::of_file(file.to_owned(), found, allowed));
    }
    document.into_settings(file)
}

/// The values of the model file at `path`.
///
/// # Errors
/// The file cannot be read, or is not TOML.
pub(super) fn read(path: &Path) -> Result<Vec<Setting>, MachineError> {
    let text = read_file(path, "a model file in TOML, as `hydraxis commission --out FILE` writes it")?;
    parse(&text, &path.display().to_string())
}

/// The values of a model file, named `file`, that may stand in a model for `machine`; everything else is a problem of
/// `machine`.
pub(super) fn expect_model(settings: Vec<Setting>, file: &str, machine: &Document) -> Vec<Setting> {
    let whole = || Place { file: Some(file.to_owned()), line: None };
    let mut refused = BTreeSet::new();
    for setting in &settings {
        if let Some(key) = foreign_key(&setting.path).filter(|key| refused.insert(*key)) {
            let allowed = "only the tables commissioned, control and identification of an axis, without the limits of \
                           its machine; this key belongs into the machine file";
            machine.problem(setting.origin.place(), key, "a key that a model file does not have", allowed);
        }
    }
    let is_empty = settings.is_empty();
    let mut kept: Vec<Setting> = settings.iter().filter(|s| foreign_key(&s.path).is_none()).cloned().collect();
    let of = |table: &str| kept.iter().filter_map(|s| axis_of(&s.path, table).map(str::to_owned)).collect();
    let (axes, commissioned): (BTreeSet<String>, BTreeSet<String>) = (of(""), of("commissioned"));
    let mut without: Vec<&str> = axes.difference(&commissioned).map(String::as_str).collect();
    if is_empty {
        without.push("NAME");
    }
    for name in without {
        let allowed = "a table with the model of the axis; `hydraxis commission MACHINE.toml --out FILE` measures it \
                       and writes the file";
        machine.problem(whole(), format!("axis.{name}.commissioned"), "nothing", allowed);
    }
    let known = machine.names("axis");
    let foreign: Vec<&str> = axes.iter().map(String::as_str).filter(|name| !known.iter().any(|k| k == name)).collect();
    if !foreign.is_empty() && !known.is_empty() {
        let found = format!("a model of axis {}", foreign.join(", "));
        let name = machine.name().unwrap_or_default();
        let allowed = format!("a model of the machine \"{name}\", which has {}", known.join(", "));
        machine.problem(whole(), "", found, allowed);
    }
    kept.retain(|setting| axis_of(&setting.path, "").is_some_and(|name| !foreign.contains(&name)));
    kept
}

/// The outermost part of a key that a model file must not have.
fn foreign_key(path: &str) -> Option<&str> {
    let parts: Vec<&str> = path.split('.').collect();
    let first = |count: usize| {
        let end = parts.iter().take(count).map(|part| part.len() + 1).sum::<usize>() - 1;
        Some(&path[..end])
    };
    match parts[..] {
        ["axis", _, "control", key, ..] if LIMITS.contains(&key) => first(4),
        ["axis", _, table, _, ..] if TABLES.contains(&table) => None,
        ["axis", ..] => first(3),
        _ => first(1),
    }
}

/// The axis of a key such as `axis.boom.control.kp`, if the key is in `table` of the axis; every table is meant where
/// `table` is empty.
fn axis_of<'p>(path: &'p str, table: &str) -> Option<&'p str> {
    let mut parts = path.split('.').skip(1);
    let axis = parts.next()?;
    let found = parts.next()?;
    (table.is_empty() || found == table).then_some(axis)
}

/// Whether the text is that of a model file.
pub(super) fn is_model(document: &Document) -> bool {
    let axes = document.names("axis");
    let tables: Vec<String> = axes.iter().flat_map(|name| document.names(&format!("axis.{name}"))).collect();
    document.names("") == ["axis"]
        && tables.iter().any(|table| table == "commissioned")
        && tables.iter().all(|table| TABLES.contains(&table.as_str()))
}

/// Whether the text is that of a model that `hydraxis identify` has written.
fn is_identified(document: &Document) -> bool {
    let names = document.names("");
    ["kind", "version", "model", "origin"].iter().all(|needed| names.iter().any(|name| name == needed))
}

/// Whether the text is that of a machine file.
fn is_machine(document: &Document) -> bool {
    let names = document.names("");
    ["name", "source", "axis"].iter().all(|needed| names.iter().any(|name| name == needed))
}
