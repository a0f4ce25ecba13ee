//! TOML values as numbers, durations and choices, and as text.

use std::{ops::RangeInclusive, time::Duration};

use toml::{Spanned, de::DeValue};

use crate::machine::quantity::quantity;

/// Number of samples that a duration spans, rounded to the nearest.
pub fn samples_of(duration: Duration, period: Duration) -> usize {
    (duration.as_secs_f64() / period.as_secs_f64()).round() as usize
}

/// A number in `range` and in `unit`, or a text with another unit of the same dimension.
pub(super) fn number(value: &DeValue, range: &RangeInclusive<f64>, unit: &str) -> Option<f64> {
    let number = match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(_) => integer(value).map(|number| number as f64),
        DeValue::String(text) => quantity(text, unit),
        _ => None,
    };
    // `contains` is false for NaN, which TOML allows.
    number.filter(|number| range.contains(number))
}

/// A whole number in any base.
fn integer(value: &DeValue) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

pub(super) fn count(value: &DeValue) -> Option<usize> {
    usize::try_from(integer(value)?).ok()
}

/// A list of numbers as [`number`] takes them.
pub(super) fn numbers(value: &DeValue, range: &RangeInclusive<f64>, unit: &str) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(|item| number(item.get_ref(), range, unit)).collect()
}

/// A list of texts.
pub(super) fn texts(value: &DeValue) -> Option<Vec<String>> {
    value.as_array()?.iter().map(|item: &Spanned<DeValue>| item.get_ref().as_str().map(str::to_owned)).collect()
}

pub(super) fn duration(value: &DeValue, range: &RangeInclusive<Duration>) -> Option<Duration> {
    humantime::parse_duration(value.as_str()?).ok().filter(|duration| range.contains(duration))
}

pub(super) fn allowed_duration(range: &RangeInclusive<Duration>) -> String {
    let (start, end) = (humantime::format_duration(*range.start()), humantime::format_duration(*range.end()));
    format!("a duration with its unit, \"{start}\" to \"{end}\"")
}

/// Index of the choice that a text names.
pub(super) fn choose<T>(value: &DeValue, choices: &[(&str, T)]) -> Option<usize> {
    let text = value.as_str()?;
    choices.iter().position(|(name, _)| *name == text)
}

pub(super) fn allowed_choice<T>(choices: &[(&str, T)]) -> String {
    let names: Vec<String> = choices.iter().map(|(name, _)| format!("\"{name}\"")).collect();
    names.join(" or ")
}

/// A value as the user wrote it, with its type.
pub(super) fn show(value: &DeValue) -> String {
    match value {
        DeValue::String(text) => format!("\"{text}\""),
        DeValue::Integer(integer) => match integer.radix() {
            16 => format!("0x{}", integer.as_str()),
            8 => format!("0o{}", integer.as_str()),
            2 => format!("0b{}", integer.as_str()),
            _ => integer.as_str().to_owned(),
        },
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

/// A text in quotation marks.
pub(super) fn quoted(text: &str) -> String {
    format!("\"{text}\"")
}

/// A value in the notation of TOML.
pub(in crate::machine) trait Shown {
    fn shown(&self) -> String;
}

impl Shown for f64 {
    fn shown(&self) -> String {
        format!("{self:?}")
    }
}

impl Shown for usize {
    fn shown(&self) -> String {
        self.to_string()
    }
}

impl Shown for bool {
    fn shown(&self) -> String {
        self.to_string()
    }
}

impl Shown for String {
    fn shown(&self) -> String {
        quoted(self)
    }
}

impl Shown for Duration {
    fn shown(&self) -> String {
        quoted(&humantime::format_duration(*self).to_string())
    }
}

impl<T: Shown> Shown for Option<T> {
    fn shown(&self) -> String {
        self.as_ref().map_or_else(|| "none".to_owned(), T::shown)
    }
}

impl Shown for (f64, f64) {
    fn shown(&self) -> String {
        [self.0, self.1].shown()
    }
}

impl<T: Shown> Shown for [T] {
    fn shown(&self) -> String {
        let items: Vec<String> = self.iter().map(T::shown).collect();
        format!("[{}]", items.join(", "))
    }
}

impl<T: Shown, const N: usize> Shown for [T; N] {
    fn shown(&self) -> String {
        self[..].shown()
    }
}

impl<T: Shown> Shown for Vec<T> {
    fn shown(&self) -> String {
        self[..].shown()
    }
}
