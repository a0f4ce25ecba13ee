//! One object of a file of states, read key by key, and what is wrong with the file.

use std::{fmt::Display, ops::RangeInclusive};

use mechanism::AXES;
use serde_json::{Map, Value};

/// What is wrong with the file, and what its user should know.
#[derive(Default)]
pub struct Notes {
    /// For each problem its place, what was found and what is allowed.
    pub problems: Vec<String>,
    /// For each warning its place and what was found.
    pub warnings: Vec<String>,
}

impl Notes {
    /// Notes a problem at `place`.
    pub fn refuse<T>(&mut self, place: &str, found: impl Display, allowed: &str) -> Option<T> {
        self.problems.push(format!("{place}: found {found}; allowed: {allowed}"));
        None
    }
}

/// An object of the file, and its place for messages.
pub struct Fields<'a> {
    pub place: String,
    pub of: &'a Map<String, Value>,
}

impl Fields<'_> {
    /// The full name of a key.
    pub fn at(&self, key: &str) -> String {
        if self.place.is_empty() { key.to_owned() } else { format!("{}.{key}", self.place) }
    }

    /// Whether the object has the key.
    pub fn has(&self, key: &str) -> bool {
        self.of.contains_key(key)
    }

    /// Refuses keys that are not in `known`.
    pub fn expect_only(&self, known: &[&str], notes: &mut Notes) {
        for key in self.of.keys().filter(|key| !known.contains(&key.as_str())) {
            let _: Option<()> = notes.refuse(&self.at(key), "an unknown key", &format!("one of {}", known.join(", ")));
        }
    }

    /// A list of N numbers in `range`; `meaning` says their unit and their order.
    pub fn numbers<const N: usize>(
        &self,
        key: &str,
        range: RangeInclusive<f64>,
        meaning: &str,
        notes: &mut Notes,
    ) -> Option<[f64; N]> {
        let value = self.of.get(key);
        let list = value.and_then(Value::as_array);
        let numbers: Option<Vec<f64>> = list.and_then(|list| list.iter().map(Value::as_f64).collect());
        let Some(numbers) = numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok()) else {
            return notes.refuse(&self.at(key), shown(value), &format!("{N} numbers, {meaning}"));
        };
        match numbers.iter().position(|number| !range.contains(number)) {
            None => Some(numbers),
            Some(i) => {
                let allowed = format!("numbers from {} to {}, {meaning}", range.start(), range.end());
                notes.refuse(&format!("{}[{i}]", self.at(key)), format!("{:?}", numbers[i]), &allowed)
            }
        }
    }

    /// A number in `range`, which may be of one number only.
    pub fn number(&self, key: &str, range: RangeInclusive<f64>, unit: &str, notes: &mut Notes) -> Option<f64> {
        let value = self.of.get(key);
        match value.and_then(Value::as_f64).filter(|number| range.contains(number)) {
            Some(number) => Some(number),
            None if range.start() == range.end() => {
                notes.refuse(&self.at(key), shown(value), &range.start().to_string())
            }
            None => {
                let allowed = format!("a number from {} to {} {unit}", range.start(), range.end());
                notes.refuse(&self.at(key), shown(value), allowed.trim_end())
            }
        }
    }
}

/// A value of the file in a message.
pub fn shown(value: Option<&Value>) -> String {
    match value {
        None => "nothing".to_owned(),
        Some(Value::Object(_)) => "an object".to_owned(),
        Some(Value::Array(list)) if list.len() > 2 * AXES => format!("a list of {}", list.len()),
        Some(value) => value.to_string(),
    }
}
