//! Quantities as texts with their unit: `"40ms"`, `"50mm"`, `"210bar"`, `"12l/min"`, `"30%"`.
//!
//! ```text
//! x = n a / b        x value in the key's unit, n typed number, a/b size of the typed unit in the key's unit
//! ```
//!
//! Every key has one unit, of the SI with few exceptions. [`UNITS`] lists for each of them the units that a text may
//! have. A text without a unit is refused, as a duration without a unit is.
//!
//! Trap: 1.3 divided by 100 is not the number that is nearest to 0.013, because 1.3 itself is rounded. Where a/b is a
//! power of ten, the decimal point is moved, so `"1.3cm"` is the same number as `0.013`.

use std::f64::consts::PI;

/// A unit that a text may have: its symbol, and numerator and denominator of its size.
type Symbol = (&'static str, f64, f64);

/// Units of keys, each with the units that a text may have. The unit of the key comes first.
const UNITS: &[(&str, &[Symbol])] = &[
    ("m", &[("m", 1.0, 1.0), ("mm", 1.0, 1e3), ("cm", 1.0, 1e2), ("um", 1.0, 1e6), ("in", 254.0, 1e4)]),
    ("m/s", &[("m/s", 1.0, 1.0), ("mm/s", 1.0, 1e3), ("cm/s", 1.0, 1e2), ("m/min", 1.0, 60.0), ("in/s", 254.0, 1e4)]),
    ("m/s2", &[("m/s2", 1.0, 1.0), ("mm/s2", 1.0, 1e3)]),
    ("m/s3", &[("m/s3", 1.0, 1.0), ("mm/s3", 1.0, 1e3)]),
    ("m2", &[("m2", 1.0, 1.0), ("cm2", 1.0, 1e4), ("mm2", 1.0, 1e6), ("in2", 64516.0, 1e8)]),
    ("m3", &[("m3", 1.0, 1.0), ("l", 1.0, 1e3), ("cm3", 1.0, 1e6), ("ml", 1.0, 1e6), ("mm3", 1.0, 1e9)]),
    ("m3/s", &[("m3/s", 1.0, 1.0), ("l/min", 1.0, 6e4), ("l/s", 1.0, 1e3), ("m3/h", 1.0, 3600.0)]),
    ("m3/(s Pa)", &[("m3/(s Pa)", 1.0, 1.0), ("l/(min bar)", 1.0, 6e9)]),
    ("kg", &[("kg", 1.0, 1.0), ("t", 1e3, 1.0), ("g", 1.0, 1e3), ("lb", 45_359_237.0, 1e8)]),
    ("kg m2", &[("kg m2", 1.0, 1.0)]),
    ("N", &[("N", 1.0, 1.0), ("kN", 1e3, 1.0), ("MN", 1e6, 1.0)]),
    ("N/m", &[("N/m", 1.0, 1.0), ("kN/m", 1e3, 1.0), ("MN/m", 1e6, 1.0), ("N/mm", 1e3, 1.0), ("kN/mm", 1e6, 1.0)]),
    ("N s/m", &[("N s/m", 1.0, 1.0), ("kN s/m", 1e3, 1.0), ("N s/mm", 1e3, 1.0)]),
    (
        "Pa",
        &[("Pa", 1.0, 1.0), ("bar", 1e5, 1.0), ("MPa", 1e6, 1.0), ("kPa", 1e3, 1.0), ("psi", 6_894.757_293_168, 1.0)],
    ),
    ("W", &[("W", 1.0, 1.0), ("kW", 1e3, 1.0), ("MW", 1e6, 1.0)]),
    ("s", &[("s", 1.0, 1.0), ("ms", 1.0, 1e3), ("us", 1.0, 1e6), ("min", 60.0, 1.0)]),
    ("Hz", &[("Hz", 1.0, 1.0), ("kHz", 1e3, 1.0)]),
    ("rad", &[("rad", 1.0, 1.0), ("mrad", 1.0, 1e3), ("deg", PI, 180.0)]),
    ("1/m", &[("1/m", 1.0, 1.0), ("1/mm", 1e3, 1.0)]),
    ("1/s", &[("1/s", 1.0, 1.0), ("%/s", 1.0, 1e2)]),
    ("1/(m s)", &[("1/(m s)", 1.0, 1.0), ("1/(mm s)", 1e3, 1.0)]),
    ("mm2/s", &[("mm2/s", 1.0, 1.0), ("cSt", 1.0, 1.0), ("m2/s", 1e6, 1.0)]),
    ("degrees Celsius", &[("degrees Celsius", 1.0, 1.0), ("degC", 1.0, 1.0)]),
    ("", &[("%", 1.0, 1e2)]),
];

/// The units that a text for a key with this unit may have; empty where it must be a plain number. Words in brackets
/// after a unit are no part of it, as in `m (the soft limits)`.
fn symbols(unit: &str) -> &'static [Symbol] {
    let unit = unit.split_once(" (").map_or(unit, |(unit, _)| unit);
    UNITS.iter().find(|(known, _)| *known == unit).map_or(&[], |(_, symbols)| symbols)
}

/// The value of a text with its unit, in the unit `unit` of a key; `None` where the text has another form or a unit of
/// another dimension.
///
/// ```
/// use pipeline::machine::quantity;
///
/// assert_eq!(quantity("50 mm", "m"), Some(0.05));
/// assert_eq!(quantity("210bar", "Pa"), Some(21e6));
/// assert_eq!(quantity("210bar", "m"), None);
/// ```
pub fn quantity(text: &str, unit: &str) -> Option<f64> {
    let (number, typed) = split(text)?;
    let symbols = symbols(unit);
    let (_, numerator, denominator) = symbols.iter().find(|(symbol, ..)| *symbol == typed)?;
    Some(scaled(number, *numerator, *denominator))
}

/// n a / b.
fn scaled(number: f64, numerator: f64, denominator: f64) -> f64 {
    let power = (numerator / denominator).log10();
    let whole = power.round() as i32;
    if 10f64.powi(whole) * denominator == numerator || 10f64.powi(-whole) * numerator == denominator {
        let shown = format!("{number:e}");
        let moved = shown.split_once('e').and_then(|(digits, exponent)| {
            let exponent: i32 = exponent.parse().ok()?;
            format!("{digits}e{}", exponent + whole).parse().ok()
        });
        // A number that is not finite has no digits.
        return moved.unwrap_or(number);
    }
    number * numerator / denominator
}

/// The units that a text for a key with this unit may have, in words; empty where it must be a plain number.
pub fn allowed_units(unit: &str) -> String {
    let symbols: Vec<&str> = symbols(unit).iter().map(|(symbol, ..)| *symbol).collect();
    symbols.join(", ")
}

/// Units of keys, the empty one for a number without unit, each with the units that a text may have.
pub fn units() -> impl Iterator<Item = (&'static str, String)> {
    UNITS.iter().map(|(unit, _)| (*unit, allowed_units(unit)))
}

/// Number and unit of a text. Exponents of units may be raised digits or follow a `^`.
fn split(text: &str) -> Option<(f64, String)> {
    let text = text.trim();
    // Words such as "inf" are no numbers here.
    if !text.starts_with(|first: char| first.is_ascii_digit() || ['+', '-', '.'].contains(&first)) {
        return None;
    }
    let ends = (1..=text.len()).rev().filter(|end| text.is_char_boundary(*end));
    let (end, number) = ends.filter_map(|end| Some((end, text[..end].parse::<f64>().ok()?))).next()?;
    let unit = text[end..].replace('^', "").replace('²', "2").replace('³', "3").replace('µ', "u").replace('°', "deg");
    let unit = unit.split_whitespace().collect::<Vec<_>>().join(" ");
    Some((number, unit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_gives_the_number_that_is_nearest_to_its_value_in_si() {
        let cases: [(&str, &str, f64); 23] = [
            ("50mm", "m", 0.05),
            ("1.3 cm", "m", 0.013),
            ("2in", "m", 0.0508),
            ("150µm", "m", 150e-6),
            ("300mm/s", "m/s", 0.3),
            ("200kg", "kg", 200.0),
            ("1.5t", "kg", 1500.0),
            ("210bar", "Pa", 21e6),
            ("21 MPa", "Pa", 21e6),
            ("40ms", "s", 0.04),
            ("8Hz", "Hz", 8.0),
            ("12l/min", "m3/s", 2e-4),
            ("0.5 l", "m3", 5e-4),
            ("20 cm²", "m2", 2e-3),
            ("20 cm^2", "m2", 2e-3),
            ("90deg", "rad", PI / 2.0),
            ("-90°", "rad", -PI / 2.0),
            ("30%", "", 0.3),
            ("46 cSt", "mm2/s", 46.0),
            ("50 °C", "degrees Celsius", 50.0),
            ("3e-1mm", "m", 3e-4),
            ("12 N  s/mm", "N s/m", 12e3),
            ("60mm", "m (the soft limits)", 0.06),
        ];
        for (text, unit, value) in cases {
            assert_eq!(quantity(text, unit), Some(value), "{text} in {unit}");
        }
    }

    #[test]
    fn a_text_without_a_unit_or_with_one_of_another_dimension_is_no_quantity() {
        for text in ["50", "50 kg", "", "mm", "inf m", "nan m", "5,0 mm", "50 MM", "50 m m", "1e", "--5 m", "µ", "5°"]
        {
            assert_eq!(quantity(text, "m"), None, "{text}");
        }
        assert_eq!(quantity("5 m", "units of the output"), None);
        assert_eq!(quantity("5", ""), None);
        assert_eq!(allowed_units("Hz"), "Hz, kHz");
    }

    #[test]
    fn the_unit_of_a_key_stands_first_and_has_the_size_1() {
        for (unit, symbols) in UNITS.iter().filter(|(unit, _)| !unit.is_empty()) {
            assert_eq!(symbols[0], (*unit, 1.0, 1.0), "{unit}");
        }
    }
}
