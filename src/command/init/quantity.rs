//! The quantities of a rig: flag, words of the question, unit, and how a value is shown.

use std::ops::RangeInclusive;

use pipeline::machine::{allowed_units, quantity};

use crate::arguments::values::in_unit;

/// A quantity that a user gives by a flag or as an answer.
#[derive(Debug, Clone, Copy)]
pub struct Quantity {
    /// The flag, with its dashes.
    pub flag: &'static str,
    /// What is asked for.
    pub words: &'static str,
    /// Unit of a plain number after the flag.
    pub unit: &'static str,
    /// Unit in which the question shows and takes a plain number.
    pub shown: &'static str,
    /// Whether the flag is needed where nobody can be asked.
    pub is_required: bool,
    /// Whether a dialogue asks for the quantity; else its default is taken.
    pub is_asked: bool,
}

impl Quantity {
    const fn required(flag: &'static str, words: &'static str, unit: &'static str, shown: &'static str) -> Self {
        Self { flag, words, unit, shown, is_required: true, is_asked: true }
    }

    const fn asked(flag: &'static str, words: &'static str, unit: &'static str, shown: &'static str) -> Self {
        Self { is_required: false, ..Self::required(flag, words, unit, shown) }
    }

    const fn derived(flag: &'static str, words: &'static str, unit: &'static str, shown: &'static str) -> Self {
        Self { is_asked: false, ..Self::asked(flag, words, unit, shown) }
    }
}

pub const STROKE: Quantity = Quantity::required("--stroke", "stroke of the cylinder", "m", "mm");
pub const BORE: Quantity = Quantity::required("--bore", "bore of the cylinder", "m", "mm");
pub const ROD: Quantity = Quantity::required("--rod", "diameter of the rod", "m", "mm");
pub const VALVE_HZ: Quantity = Quantity::required("--valve-hz", "bandwidth of the valve", "Hz", "Hz");
pub const DEAD_TIME: Quantity =
    Quantity::required("--dead-time", "time from a command to the first reaction of the valve", "s", "ms");
pub const SPEED: Quantity = Quantity::asked("--speed", "largest speed", "m/s", "mm/s");
pub const MASS: Quantity = Quantity::asked("--mass", "moved mass", "kg", "kg");
pub const LOAD: Quantity = Quantity::derived("--load", "force of the load against extension", "N", "kN");
pub const DEAD_BAND: Quantity = Quantity::derived("--dead-band", "dead band of the valve", "", "%");
pub const RESOLUTION: Quantity = Quantity::asked("--resolution", "one count of the position sensor", "m", "um");
pub const PRESSURE: Quantity = Quantity::asked("--pressure", "pressure of the pump", "Pa", "bar");
pub const PERIOD: Quantity = Quantity::derived("--period", "control period", "s", "ms");

impl Quantity {
    /// The value of a flag: a number in SI units, or a text with its unit.
    pub fn of_flag(&self, text: &str) -> Option<f64> {
        in_unit(text, self.unit)
    }

    /// The value of an answer: a number in the unit that the question shows, or a text with its unit.
    pub fn of_answer(&self, text: &str) -> Option<f64> {
        let shown = || quantity(&format!("{}{}", text.trim(), self.shown), self.unit);
        // A text with its own unit and the shown one after it is no quantity.
        if text.trim().parse::<f64>().is_ok() { shown() } else { in_unit(text, self.unit) }
    }

    /// A value as the question shows it, without its unit.
    pub fn number(&self, value: f64) -> String {
        let one = quantity(&format!("1{}", self.shown), self.unit).unwrap_or(1.0);
        format!("{}", significant(value / one, 4))
    }

    /// A value with its unit.
    pub fn text(&self, value: f64) -> String {
        format!("{} {}", self.number(value), self.shown)
    }

    /// What is allowed in the place of `found`, in words. `plain` is the unit of a plain number.
    pub fn allowed(&self, range: &RangeInclusive<f64>, found: Option<f64>, plain: &str) -> String {
        let is_negative = found.is_some_and(|found| found <= 0.0) && *range.start() > 0.0;
        let greater = if is_negative { "more than 0, " } else { "" };
        let number = if plain.is_empty() { "a plain number".to_owned() } else { format!("a number in {plain}") };
        format!(
            "{greater}{} to {}, as {number} or with one of the units {}",
            self.text(*range.start()),
            self.text(*range.end()),
            allowed_units(self.unit)
        )
    }
}

/// Significant digits of the numbers in a machine file.
pub const DIGITS: usize = 4;

/// A positive number rounded up to so many significant digits.
pub fn significant_or_more(value: f64, digits: usize) -> f64 {
    let nearest = significant(value, digits);
    let last_digit = 10f64.powi(value.log10().floor() as i32 + 1 - digits as i32);
    if nearest < value { significant(value + last_digit, digits) } else { nearest }
}

/// A number rounded to so many significant digits.
pub fn significant(value: f64, digits: usize) -> f64 {
    // The shortest decimal number is what a person would write.
    format!("{value:.*e}", digits - 1).parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plain_number_is_in_si_after_a_flag_and_in_the_shown_unit_in_an_answer() {
        assert_eq!((BORE.of_flag("0.05"), BORE.of_answer("50")), (Some(0.05), Some(0.05)));
        assert_eq!((BORE.of_flag("50mm"), BORE.of_answer("5 cm")), (Some(0.05), Some(0.05)));
        assert_eq!((DEAD_BAND.of_flag("0.1"), DEAD_BAND.of_answer("10")), (Some(0.1), Some(0.1)));
        for wrong in ["", "x", "5kg", "nan", "inf", "0,05"] {
            assert_eq!((BORE.of_flag(wrong), BORE.of_answer(wrong)), (None, None), "{wrong}");
        }
        assert_eq!(BORE.text(0.05), "50 mm");
        assert_eq!(PRESSURE.text(21e6), "210 bar");
        assert_eq!(significant(0.001_963_495_4, 4), 0.001_963);
        assert_eq!(
            [1200.4, 1200.6, 1200.0, 0.5406].map(|value| significant_or_more(value, 4)),
            [1201.0, 1201.0, 1200.0, 0.5406]
        );
    }
}
