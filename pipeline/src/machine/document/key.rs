//! One key of a table: its meaning, its allowed values and its default, and the value that it has.
//!
//! This is the one place where a key is read. So an error, `check --explain` and the table of all keys say the same
//! about it, and a key without a meaning cannot be read.

use std::{ops::RangeInclusive, time::Duration};

use toml::{Spanned, de::DeValue};

use crate::{
    machine::quantity::{allowed_units, quantity},
    nearest::did_you_mean,
};

use super::{
    Entry, NOTHING,
    form::ValueForm,
    record::{DefaultValue, EffectiveValue, Origin},
    section::{Section, Value},
    value::{
        Shown, allowed_choice, allowed_duration, choose, count, duration, number, numbers, quoted, samples_of, show,
        texts,
    },
};

/// One key that is about to be read.
pub(in crate::machine) struct Key<'s, 'd, 'i> {
    section: &'s mut Section<'d, 'i>,
    name: &'s str,
    meaning: &'static str,
    unit: String,
    /// Words for a default that follows from other keys.
    rule: Option<&'static str>,
    /// Words for the table of all keys where `allowed` depends on other keys.
    allows: Option<&'static str>,
    /// Whether the value is made of numbers, which a text with a unit can give.
    is_quantity: bool,
    /// Names that the value can have, for a name that is mistyped.
    names: Vec<String>,
    /// Forms that the value can have.
    forms: Vec<ValueForm>,
}

/// What a parser has found for a key.
enum Found<T> {
    /// The key is absent.
    Absent,
    /// The value was refused; the problem is noted.
    Refused,
    /// The value, and where it comes from.
    Given(T, Origin),
}

impl<'d, 'i> Section<'d, 'i> {
    /// A key of this table, with one sentence that says what it means.
    pub fn key<'s>(&'s mut self, name: &'s str, meaning: &'static str) -> Key<'s, 'd, 'i> {
        Key {
            section: self,
            name,
            meaning,
            unit: String::new(),
            rule: None,
            allows: None,
            is_quantity: false,
            names: Vec::new(),
            forms: Vec::new(),
        }
    }
}

impl Key<'_, '_, '_> {
    /// Says in words how the default follows from other keys.
    pub fn rule(self, rule: &'static str) -> Self {
        Self { rule: Some(rule), ..self }
    }

    /// Says for the table of all keys what is allowed, where that depends on other keys.
    pub fn allows(self, allows: &'static str) -> Self {
        Self { allows: Some(allows), ..self }
    }

    /// Gives the names that the value can have, for a name that is mistyped.
    fn among<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { names: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Says that the value is made of numbers in this unit.
    fn unit(self, unit: &str) -> Self {
        Self { unit: unit.to_owned(), is_quantity: true, ..self }
    }

    /// Says which form the value can have, beside those that were said before.
    fn form(mut self, form: ValueForm) -> Self {
        self.forms.push(form);
        self
    }

    /// Says that the value can be a number in `range` and `unit`.
    fn one(self, range: &RangeInclusive<f64>, unit: &str) -> Self {
        let range = Some((*range.start(), *range.end()));
        self.unit(unit).form(ValueForm::Number { range, unit: Some(unit.to_owned()) })
    }

    /// Says that the value can be a list of such numbers, with a length from `shortest` to `longest`.
    fn list(self, range: &RangeInclusive<f64>, unit: &str, shortest: usize, longest: Option<usize>) -> Self {
        let (range, length) = (Some((*range.start(), *range.end())), (shortest, longest));
        self.unit(unit).form(ValueForm::Numbers { range, unit: Some(unit.to_owned()), length })
    }

    /// Says that the value can be a whole number in `range`.
    fn whole(self, range: &RangeInclusive<usize>) -> Self {
        self.form(ValueForm::Integer { range: Some((*range.start(), *range.end())) })
    }

    /// What is added to the allowed values for a refused text: the units that it may have, or the nearest names.
    fn hint(&self, typed: &str) -> String {
        let text = typed.trim_matches('"');
        let is_text = typed.starts_with('"') || text.contains(|c: char| c.is_alphabetic() || c == '%');
        let has_unit = text.contains(|c: char| c.is_ascii_digit()) && is_text;
        let units = allowed_units(&self.unit);
        if self.is_quantity && has_unit && !units.is_empty() && quantity(text, &self.unit).is_none() {
            return format!(", or a text with one of the units {units}");
        }
        did_you_mean(text, self.names.iter().map(String::as_str))
    }

    fn find<T>(&mut self, allowed: &str, parse: impl Fn(&DeValue) -> Option<T>) -> Found<T> {
        let name = self.name;
        let (parsed, typed, shown, place, origin) = match self.section.take(name) {
            None => return Found::Absent,
            Some(Value::File(value)) => {
                let line = self.section.line_of(name);
                let origin = Origin::MachineFile { line: line.unwrap_or_default() };
                let shown = show(value.get_ref());
                (parse(value.get_ref()), shown.clone(), shown, line.into(), origin)
            }
            Some(Value::Setting(text, origin)) => {
                // A setting is TOML where it can be, else a plain string, as in `--set scenario=payload`.
                let as_toml = DeValue::parse(&text);
                let parsed = as_toml.as_ref().ok().and_then(|value| parse(value.get_ref()));
                let parsed = parsed.or_else(|| parse(&DeValue::String(text.as_str().into())));
                // Other texts are plain strings, or durations.
                let is_broken = as_toml.is_err() && text.starts_with(['[', '{', '.', '+', '-']);
                let shown = match text.as_str() {
                    "" => quoted(""),
                    text if is_broken => format!("{text}, which is no TOML"),
                    text => text.to_owned(),
                };
                (parsed, text, origin.of(shown), origin.place(), origin)
            }
        };
        match parsed {
            Some(value) => Found::Given(value, origin),
            None => {
                let allowed = format!("{allowed}{}", self.hint(&typed));
                self.section.document.problem(place, self.section.path_of(name), shown, allowed);
                Found::Refused
            }
        }
    }

    fn record(self, value: Option<String>, origin: Origin, allowed: &str, default: DefaultValue) {
        let (document, key) = (self.section.document, self.section.path_of(self.name));
        let origin = match (origin, self.rule) {
            (Origin::Default, Some(rule)) => Origin::Derived { rule: rule.to_owned() },
            (origin, _) => origin,
        };
        let default = self.rule.map_or(default, DefaultValue::Rule);
        let allows = self.allows.map(str::to_owned);
        let loosened = |form: ValueForm| if self.allows.is_some() { form.loose() } else { form };
        let forms = self.forms.into_iter().map(loosened).collect();
        let allowed = allowed.to_owned();
        let value = EffectiveValue { key, value, unit: self.unit, origin, allowed, default, meaning: self.meaning };
        document.record(Entry { value, allows, forms });
    }

    /// Reads a required key by `parse`; `placeholder` takes the place of a value that is absent or refused.
    fn required<T: Shown>(mut self, allowed: &str, placeholder: T, parse: impl Fn(&DeValue) -> Option<T>) -> T {
        let found = self.find(allowed, parse);
        if matches!(found, Found::Absent) {
            self.section.refuse(self.name, NOTHING, allowed);
        }
        match found {
            Found::Given(value, origin) => {
                self.record(Some(value.shown()), origin, allowed, DefaultValue::Required);
                value
            }
            Found::Absent | Found::Refused => {
                self.record(None, Origin::Default, allowed, DefaultValue::Required);
                placeholder
            }
        }
    }

    /// Reads a key with a default.
    fn defaulted<T: Shown>(mut self, allowed: &str, default: T, parse: impl Fn(&DeValue) -> Option<T>) -> T {
        let shown = default.shown();
        let (value, origin) = match self.find(allowed, parse) {
            Found::Given(value, origin) => (value, origin),
            Found::Absent | Found::Refused => (default, Origin::Default),
        };
        self.record(Some(value.shown()), origin, allowed, DefaultValue::Value(shown));
        value
    }

    /// Reads a key that may be absent.
    fn optional<T: Shown>(mut self, allowed: &str, parse: impl Fn(&DeValue) -> Option<T>) -> Option<T> {
        match self.find(allowed, parse) {
            Found::Given(value, origin) => {
                self.record(Some(value.shown()), origin, allowed, DefaultValue::Nothing);
                Some(value)
            }
            Found::Absent | Found::Refused => {
                self.record(None, Origin::Default, allowed, DefaultValue::Nothing);
                None
            }
        }
    }

    /// A number in `range`; `unit` is shown with it. NaN is outside every range.
    pub fn number(self, range: RangeInclusive<f64>, unit: &str) -> f64 {
        let allowed = allowed_number(&range, unit);
        // In the place of a refused number the largest: then what depends on it is not refused as well.
        self.one(&range, unit).required(&allowed, *range.end(), |value| number(value, &range, unit))
    }

    /// A number in `range`; without one the default.
    pub fn number_or(self, default: f64, range: RangeInclusive<f64>, unit: &str) -> f64 {
        self.one(&range, unit).defaulted(&allowed_number(&range, unit), default, |value| number(value, &range, unit))
    }

    /// A number in `range`; without one the value that follows from other keys; required where none follows.
    pub fn number_or_derived(self, derived: Option<f64>, range: RangeInclusive<f64>, unit: &str) -> f64 {
        match derived {
            Some(default) => self.number_or(default, range, unit),
            None => self.number(range, unit),
        }
    }

    /// A number in `range`, or nothing.
    pub fn optional_number(self, range: RangeInclusive<f64>, unit: &str) -> Option<f64> {
        self.one(&range, unit).optional(&allowed_number(&range, unit), |value| number(value, &range, unit))
    }

    /// A list of numbers in `range`, of any length from `shortest` on.
    pub fn numbers(self, range: RangeInclusive<f64>, unit: &str, shortest: usize) -> Vec<f64> {
        let allowed = format!("a list of {shortest} or more numbers from {} to {} {unit}", range.start(), range.end());
        self.list(&range, unit, shortest, None).required(allowed.trim_end(), Vec::new(), |value| {
            numbers(value, &range, unit).filter(|numbers| numbers.len() >= shortest)
        })
    }

    /// A list of numbers in `range`, or nothing; `allowed` says what else the list must be.
    pub fn optional_numbers(self, range: RangeInclusive<f64>, unit: &str, allowed: &str) -> Option<Vec<f64>> {
        self.list(&range, unit, 0, None).optional(allowed, |value| numbers(value, &range, unit))
    }

    /// Two coordinates in `range`.
    pub fn point(self, range: RangeInclusive<f64>, unit: &str) -> [f64; 2] {
        let placeholder = [*range.end(); 2];
        self.list(&range, unit, 2, Some(2))
            .required(&allowed_point(&range, unit), placeholder, |value| point(value, &range, unit))
    }

    /// Two coordinates in `range`; without them the default.
    pub fn point_or(self, default: [f64; 2], range: RangeInclusive<f64>, unit: &str) -> [f64; 2] {
        self.list(&range, unit, 2, Some(2))
            .defaulted(&allowed_point(&range, unit), default, |value| point(value, &range, unit))
    }

    /// Three numbers in `range`, or one that stands for all three; `names` says what the three are.
    pub fn number_or_three(self, range: RangeInclusive<f64>, unit: &str, names: &str) -> [f64; 3] {
        let allowed = format!("a number from {} to {} {unit}, or three, {names}", range.start(), range.end());
        self.one(&range, unit).list(&range, unit, 3, Some(3)).required(&allowed, [*range.end(); 3], |value| match value
            .as_array()
        {
            None => number(value, &range, unit).map(|all| [all; 3]),
            Some(_) => numbers(value, &range, unit)?.try_into().ok(),
        })
    }

    /// Two numbers in `range`, or one that stands for both; without them the default.
    pub fn pair_or(self, default: (f64, f64), range: RangeInclusive<f64>) -> (f64, f64) {
        let allowed = format!("a number from {} to {}, or [low, high] of two", range.start(), range.end());
        self.one(&range, "").list(&range, "", 2, Some(2)).defaulted(&allowed, default, |value| match value.as_array() {
            None => number(value, &range, "").map(|both| (both, both)),
            Some(_) => match numbers(value, &range, "")?[..] {
                [low, high] => Some((low, high)),
                _ => None,
            },
        })
    }

    /// A whole number in `range`; without one the default.
    pub fn integer_or(self, default: usize, range: RangeInclusive<usize>) -> usize {
        self.whole(&range)
            .defaulted(&allowed_integer(&range), default, |value| count(value).filter(|number| range.contains(number)))
    }

    /// A whole number in `range`, or nothing.
    pub fn optional_integer(self, range: RangeInclusive<usize>) -> Option<usize> {
        self.whole(&range)
            .optional(&allowed_integer(&range), |value| count(value).filter(|number| range.contains(number)))
    }

    /// A duration with its unit, such as `"10ms"`, in `range`.
    pub fn duration(self, range: RangeInclusive<Duration>) -> Duration {
        self.form(ValueForm::Duration)
            .required(&allowed_duration(&range), *range.start(), |value| duration(value, &range))
    }

    /// A duration in `range`; without one the default.
    pub fn duration_or(self, default: Duration, range: RangeInclusive<Duration>) -> Duration {
        self.form(ValueForm::Duration).defaulted(&allowed_duration(&range), default, |value| duration(value, &range))
    }

    /// A duration in `range`, or nothing.
    pub fn optional_duration(self, range: RangeInclusive<Duration>) -> Option<Duration> {
        self.form(ValueForm::Duration).optional(&allowed_duration(&range), |value| duration(value, &range))
    }

    /// Samples, given as a whole number or as a duration that is divided by `period`; without them the default.
    pub fn samples_or(self, default: usize, range: RangeInclusive<usize>, period: Duration) -> usize {
        let allowed = format!(
            "{} to {} samples of {}, as a whole number or a duration such as \"0.5s\"",
            range.start(),
            range.end(),
            humantime::format_duration(period)
        );
        self.unit("samples").whole(&range).form(ValueForm::Duration).defaulted(&allowed, default, |value| {
            let samples = match value.as_str() {
                Some(text) => samples_of(humantime::parse_duration(text).ok()?, period),
                None => count(value)?,
            };
            Some(samples).filter(|samples| range.contains(samples))
        })
    }

    /// Any text but an empty one.
    pub fn text(self, allowed: &str) -> String {
        let some = |value: &DeValue| value.as_str().filter(|text| !text.is_empty()).map(str::to_owned);
        self.form(ValueForm::Text).required(allowed, String::new(), some)
    }

    /// Any text, or nothing.
    pub fn optional_text(self) -> Option<String> {
        self.form(ValueForm::Text).optional("a text", |value| value.as_str().map(str::to_owned))
    }

    /// Any text; without one the default.
    pub fn text_or(self, default: &str) -> String {
        self.form(ValueForm::Text).defaulted("a text", default.to_owned(), |value| value.as_str().map(str::to_owned))
    }

    /// A list of texts, or nothing.
    pub fn optional_texts(self, allowed: &str) -> Option<Vec<String>> {
        self.form(ValueForm::Texts).optional(allowed, texts)
    }

    /// A list of lists of texts, or nothing.
    pub fn optional_text_table(self, allowed: &str) -> Option<Vec<Vec<String>>> {
        self.form(ValueForm::TextTable).optional(allowed, |value| {
            value.as_array()?.iter().map(|row: &Spanned<DeValue>| texts(row.get_ref())).collect()
        })
    }

    /// `true` or `false`; without either the default.
    pub fn flag_or(self, default: bool) -> bool {
        self.form(ValueForm::Flag).defaulted("true or false", default, |value| value.as_bool())
    }

    /// One of the named choices; `None` when the key is absent or its value was refused.
    pub fn choice<T: Copy>(self, choices: &[(&str, T)]) -> Option<T> {
        let names = self.among(choices.iter().map(|(name, _)| *name));
        let names = names.form(form_of(choices));
        let chosen = names.required(&allowed_choice(choices), None, |value| {
            choose(value, choices).map(|index| Some(Choice { names: choices, index }))
        });
        chosen.map(|choice| choice.value())
    }

    /// One of the named choices; without one the default, which is one of them.
    pub fn choice_or<T: Copy + PartialEq>(self, default: T, choices: &[(&str, T)]) -> T {
        let index = choices.iter().position(|(_, choice)| *choice == default).unwrap_or_default();
        let chosen = Choice { names: choices, index };
        self.form(form_of(choices))
            .among(choices.iter().map(|(name, _)| *name))
            .defaulted(&allowed_choice(choices), chosen, |value| {
                choose(value, choices).map(|index| Choice { names: choices, index })
            })
            .value()
    }

    /// A text that the type parses; without one the default. `names` are those that a mistyped text may have meant.
    pub fn parsed_or<T: std::str::FromStr + std::fmt::Display>(self, default: T, allowed: &str, names: &[&str]) -> T {
        let parsed =
            self.form(ValueForm::Text)
                .among(names.iter().copied())
                .defaulted(allowed, Parsed(default), |value| value.as_str()?.parse().ok().map(Parsed));
        parsed.0
    }
}

/// One of several named values.
struct Choice<'c, T> {
    names: &'c [(&'c str, T)],
    index: usize,
}

impl<T: Copy> Choice<'_, T> {
    fn value(&self) -> T {
        self.names[self.index].1
    }
}

impl<T> Shown for Choice<'_, T> {
    fn shown(&self) -> String {
        quoted(self.names[self.index].0)
    }
}

/// A value that is written as a text.
struct Parsed<T>(T);

impl<T: std::fmt::Display> Shown for Parsed<T> {
    fn shown(&self) -> String {
        quoted(&self.0.to_string())
    }
}

fn form_of<T>(choices: &[(&str, T)]) -> ValueForm {
    ValueForm::Choice { names: choices.iter().map(|(name, _)| (*name).to_owned()).collect() }
}

fn allowed_number(range: &RangeInclusive<f64>, unit: &str) -> String {
    format!("a number from {} to {} {unit}", range.start(), range.end()).trim_end().to_owned()
}

fn allowed_point(range: &RangeInclusive<f64>, unit: &str) -> String {
    format!("[x, z], two numbers from {} to {} {unit}", range.start(), range.end())
}

fn point(value: &DeValue, range: &RangeInclusive<f64>, unit: &str) -> Option<[f64; 2]> {
    numbers(value, range, unit)?.try_into().ok()
}

fn allowed_integer(range: &RangeInclusive<usize>) -> String {
    format!("a whole number from {} to {}", range.start(), range.end())
}
