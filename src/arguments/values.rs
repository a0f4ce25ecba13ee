//! Values as a user types them.

use std::{fmt::Display, str::FromStr, time::Duration};

use pipeline::{
    hammerstein::{Basis, MAX_ORDER},
    machine::{Estimator, TipTask, allowed_units, quantity, samples_of},
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

/// A time from a beginning on: 0, or as [`seconds`] has it.
pub fn time(text: &str) -> Result<Duration, String> {
    if text.parse() == Ok(0.0) { Ok(Duration::ZERO) } else { seconds(text) }
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
pub fn in_range<N>(low: N, high: N) -> impl Fn(&str) -> Result<N, String> + Clone
where
    N: FromStr + PartialOrd + Display + Copy,
{
    move |text| match text.parse() {
        Ok(number) if (low..=high).contains(&number) => Ok(number),
        _ => Err(format!("allowed: a whole number from {low} to {high}")),
    }
}

/// A whole number of 0 or more.
pub fn whole(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| "allowed: a whole number of 0 or more, below 1.8e19".to_owned())
}

/// The value of a plain number, which is in `unit`, or of a text with its unit; none for another text, or a number that
/// is not finite.
pub fn in_unit(text: &str, unit: &str) -> Option<f64> {
    let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
    number.or_else(|| quantity(text, unit)).filter(|value| value.is_finite())
}

/// What a text for [`in_unit`] may be, in words.
pub fn allowed_in(unit: &str) -> String {
    format!("a number in {unit} or with one of the units {}", allowed_units(unit))
}

/// A position, m.
pub fn position(text: &str) -> Result<f64, String> {
    in_unit(text, "m").ok_or_else(|| format!("allowed: {}", allowed_in("m")))
}

/// A place in the plane of the boom: forward of the centre of swing and above ground, m.
pub fn place(text: &str) -> Result<[f64; 2], String> {
    let place = text.split_once(',').and_then(|(x, z)| Some([in_unit(x.trim(), "m")?, in_unit(z.trim(), "m")?]));
    let near = place.filter(|place| place.iter().all(|value| TipTask::PLACES.contains(value)));
    near.ok_or_else(|| "allowed: X,Z in m, such as 6.2,-0.5, or with their units; -100 to 100 m".to_owned())
}

/// Most that a bucket holds, kg.
const HEAVIEST: f64 = 1e5;

/// A mass in the bucket, kg.
pub fn payload(text: &str) -> Result<f64, String> {
    let mass = in_unit(text, "kg").filter(|mass| (0.0..=HEAVIEST).contains(mass));
    mass.ok_or_else(|| format!("allowed: 0 to {HEAVIEST} kg, as {}", allowed_in("kg")))
}

/// A speed of the teeth, m/s.
pub fn teeth_speed(text: &str) -> Result<f64, String> {
    let speed = in_unit(text, "m/s").filter(|speed| TipTask::SPEEDS.contains(speed));
    speed.ok_or_else(|| format!("allowed: 0.001 to 10 m/s, as {}", allowed_in("m/s")))
}

/// A length or a speed greater than 0 in `unit`.
pub fn positive_in(unit: &'static str) -> impl Fn(&str) -> Result<f64, String> + Clone {
    let allowed = move || format!("allowed: more than 0 {unit}, as {}", allowed_in(unit));
    move |text| in_unit(text, unit).filter(|value| *value > 0.0).ok_or_else(allowed)
}

/// A valve command: a number, or a percentage of the largest one.
pub fn valve_command(text: &str) -> Result<f64, String> {
    let command = in_unit(text, "").filter(|command| (-1.0..=1.0).contains(command));
    command.ok_or_else(|| "allowed: a valve command in [-1, 1], such as 0.2 or 20%".to_owned())
}

/// `COLUMN=UNIT`; the name of a column may have a `=`.
pub fn column_unit(text: &str) -> Result<(String, String), String> {
    match text.rsplit_once('=') {
        Some((column, unit)) if !column.trim().is_empty() && !unit.trim().is_empty() => {
            Ok((column.trim().to_owned(), unit.trim().to_owned()))
        }
        _ => Err("allowed: COLUMN=UNIT, such as y=mm or \"Time stamp=ms\"".to_owned()),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plain_number_is_in_si_and_a_text_has_its_unit() {
        assert_eq!(["0.3", "300mm", "30 cm", "0.3m"].map(position), [Ok(0.3), Ok(0.3), Ok(0.3), Ok(0.3)]);
        assert_eq!(position("-300mm"), Ok(-0.3));
        assert_eq!(["0.05", "50mm/s", "3m/min"].map(positive_in("m/s")), [Ok(0.05), Ok(0.05), Ok(0.05)]);
        assert_eq!(["1500", "1.5t", "1500 kg", "0"].map(payload), [Ok(1500.0), Ok(1500.0), Ok(1500.0), Ok(0.0)]);
        assert_eq!(["0.2", "20%", "-100%"].map(valve_command), [Ok(0.2), Ok(0.2), Ok(-1.0)]);
    }

    #[test]
    fn other_texts_are_refused_with_what_is_allowed() {
        for wrong in ["", "x", "5kg", "nan", "inf", "1e999", "0,3"] {
            assert!(position(wrong).unwrap_err().ends_with("m, mm, cm, um, in"), "{wrong}");
            assert!(positive_in("m/s")(wrong).unwrap_err().contains("more than 0 m/s"), "{wrong}");
            assert!(valve_command(wrong).unwrap_err().contains("[-1, 1]"), "{wrong}");
        }
        assert!(positive_in("m")("0mm").is_err() && positive_in("m")("-1").is_err() && valve_command("101%").is_err());
        for wrong in ["-1", "1e6", "200t", "much", "3m"] {
            let allowed = "allowed: 0 to 100000 kg, as a number in kg or with one of the units kg, t, g, lb";
            assert_eq!(payload(wrong), Err(allowed.to_owned()), "{wrong}");
        }
        assert!(whole("-1").is_err() && whole("1.5").is_err() && whole("7") == Ok(7));
    }
}
