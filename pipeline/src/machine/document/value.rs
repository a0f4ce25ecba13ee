//! TOML values as numbers, durations and choices, and as text.

use std::{ops::RangeInclusive, time::Duration};

use toml::de::DeValue;

/// Number of samples that a duration spans, rounded to the nearest.
pub fn samples_of(duration: Duration, period: Duration) -> usize {
    (duration.as_secs_f64() / period.as_secs_f64()).round() as usize
}

pub(super) fn number(value: &DeValue, range: &RangeInclusive<f64>) -> Option<f64> {
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

pub(super) fn integer(value: &DeValue) -> Option<i64> {
    let integer = value.as_integer()?;
    i64::from_str_radix(integer.as_str(), integer.radix()).ok()
}

pub(super) fn count(value: &DeValue) -> Option<usize> {
    usize::try_from(integer(value)?).ok()
}

pub(super) fn duration(value: &DeValue, range: &RangeInclusive<Duration>) -> Option<Duration> {
    humantime::parse_duration(value.as_str()?).ok().filter(|duration| range.contains(duration))
}

pub(super) fn allowed_duration(range: &RangeInclusive<Duration>) -> String {
    let (start, end) = (humantime::format_duration(*range.start()), humantime::format_duration(*range.end()));
    format!("a duration with its unit, \"{start}\" to \"{end}\"")
}

pub(super) fn choose<T: Copy>(value: &DeValue, choices: &[(&str, T)]) -> Option<T> {
    let text = value.as_str()?;
    choices.iter().find(|(name, _)| *name == text).map(|(_, choice)| *choice)
}

pub(super) fn allowed_choice<T>(choices: &[(&str, T)]) -> String {
    let names: Vec<String> = choices.iter().map(|(name, _)| format!("\"{name}\"")).collect();
    names.join(" or ")
}

/// A value as the user wrote it, with its type.
pub(super) fn show(value: &DeValue) -> String {
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
