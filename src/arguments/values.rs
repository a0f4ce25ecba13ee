//! Values as a user types them.

use std::{str::FromStr, time::Duration};

use pipeline::{
    hammerstein::{Basis, MAX_ORDER},
    machine::{Estimator, samples_of},
};

/// `--train`: a number of rows, or a part of all rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rows {
    /// This number.
    Count(usize),
    /// This part of all rows, between 0 and 1.
    Fraction(f64),
}

impl FromStr for Rows {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Ok(count) = text.parse() {
            return Ok(Self::Count(count));
        }
        match text.parse() {
            Ok(fraction) if fraction > 0.0 && fraction < 1.0 => Ok(Self::Fraction(fraction)),
            _ => Err("allowed: a whole number of rows, or a fraction between 0 and 1".to_owned()),
        }
    }
}

impl Rows {
    /// The number of rows when there are `all`.
    pub fn of(self, all: usize) -> usize {
        match self {
            Self::Count(count) => count,
            Self::Fraction(fraction) => (fraction * all as f64).round() as usize,
        }
    }
}

/// `--horizon`: a number of samples, typed as a number or as a duration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Samples {
    /// This number.
    Count(usize),
    /// The samples in this time.
    Duration(Duration),
}

impl FromStr for Samples {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Ok(count) = text.parse() {
            return Ok(Self::Count(count));
        }
        let allowed = |_| "allowed: a whole number of samples, or a duration with its unit such as 0.5s".to_owned();
        humantime::parse_duration(text).map(Self::Duration).map_err(allowed)
    }
}

impl Samples {
    /// The number of samples with this period.
    pub fn at(self, period: Duration) -> usize {
        match self {
            Self::Count(count) => count,
            Self::Duration(duration) => samples_of(duration, period),
        }
    }
}

/// `--dead-band`: the dead band of the valve below and above zero, as magnitudes of the command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadBand(pub f64, pub f64);

impl FromStr for DeadBand {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (low, high) = text.split_once(',').unwrap_or((text, text));
        let magnitude = |text: &str| text.trim().parse().ok().filter(|m: &f64| m.is_finite() && *m >= 0.0);
        match (magnitude(low), magnitude(high)) {
            (Some(low), Some(high)) => Ok(Self(low, high)),
            _ => Err("allowed: one number of at least 0 for both directions, or two, LOW,HIGH".to_owned()),
        }
    }
}

/// `--knots`: hinges and their number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knots {
    /// Hinges that begin at the knots.
    pub basis: Basis,
    /// Number of knots.
    pub count: usize,
}

impl FromStr for Knots {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let knots: Result<Vec<f64>, _> = text.split(',').map(|knot| knot.trim().parse()).collect();
        let knots = knots.unwrap_or_default();
        let allowed = || format!("allowed: 1 to {MAX_ORDER} rising numbers of at least 0, K1,K2,..");
        Basis::hinges(&knots).map(|basis| Self { basis, count: knots.len() }).ok_or_else(allowed)
    }
}

/// A duration as a plain number of seconds or with its unit.
pub fn seconds(text: &str) -> Result<Duration, String> {
    let plain = text.parse().ok().and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    let duration = plain.or_else(|| humantime::parse_duration(text).ok());
    // At most half a year; at least the resolution of a duration, a nanosecond.
    duration
        .filter(|duration| (1..=16_000_000_000_000_000).contains(&duration.as_nanos()))
        .ok_or_else(|| "allowed: seconds from 1e-9 to 1.6e7, or a duration with its unit such as 20ms".to_owned())
}

/// `--forgetting`, the old name of `--estimator`.
pub fn forgetting(_: &str) -> Result<String, String> {
    Err("allowed: `--estimator`, its new name".to_owned())
}

/// `--estimator`.
pub fn estimator(text: &str) -> Result<Estimator, String> {
    text.parse()
}

/// A whole number in a range.
pub fn in_range(low: usize, high: usize) -> impl Fn(&str) -> Result<usize, String> + Clone {
    move |text| match text.parse() {
        Ok(number) if (low..=high).contains(&number) => Ok(number),
        _ => Err(format!("allowed: a whole number from {low} to {high}")),
    }
}

/// A number greater than 0.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(number) if number > 0.0 && f64::is_finite(number) => Ok(number),
        _ => Err("allowed: a number greater than 0".to_owned()),
    }
}

/// A duration greater than 0 with its unit.
pub fn duration(text: &str) -> Result<Duration, String> {
    let parsed = humantime::parse_duration(text).ok().filter(|duration| !duration.is_zero());
    parsed.ok_or_else(|| "allowed: a duration greater than 0 with its unit, such as 20s or 500ms".to_owned())
}

/// `KEY=VALUE`.
pub fn setting(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.trim().is_empty() => Ok((key.trim().to_owned(), value.trim().to_owned())),
        _ => Err("allowed: KEY=VALUE with a key of the machine file, such as axis.boom.control.kp=3".to_owned()),
    }
}
