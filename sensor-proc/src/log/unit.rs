//! Units of columns: what the numbers are multiplied by, and the unit that they have then.
//!
//! Angles stay in the unit of the file, so that the figures are those that the user knows. All other units become those
//! of the SI. Electrical units, counts and pressures stay: the gain of the model absorbs them.

use pipeline::machine::{allowed_units, quantity};

/// Units of signals that are not converted.
const KEPT: [&str; 8] = ["deg", "rad", "V", "mV", "A", "mA", "bar", "counts"];
/// Signs for a number without a unit.
const NONE: [&str; 3] = ["1", "-", ""];
/// Units that the end of a column's name may have after a `_`. Others, such as `in`, are words as well.
const IN_NAMES: [&str; 10] = ["s", "ms", "us", "ns", "m", "mm", "cm", "um", "deg", "rad"];

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Time,
    Signal,
}

/// A unit that was found.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Unit {
    /// As the file has it.
    pub(super) symbol: String,
    /// Its size in the unit `becomes`.
    pub(super) size: f64,
    /// The unit after reading; `1` for a number without a unit.
    pub(super) becomes: &'static str,
}

impl Kind {
    /// The unit with this symbol, which may stand in brackets; none for one of another kind.
    pub(super) fn unit(self, text: &str) -> Option<Unit> {
        let symbol = plain(text);
        let sized = |key: &str| quantity(&format!("1{symbol}"), key);
        let (size, becomes) = match self {
            Self::Time if symbol == "ns" => (1e-9, "s"),
            Self::Time => (sized("s")?, "s"),
            Self::Signal if NONE.contains(&symbol.as_str()) => (1.0, "1"),
            Self::Signal => match KEPT.iter().find(|kept| **kept == symbol) {
                Some(kept) => (1.0, *kept),
                None => sized("m").map(|size| (size, "m")).or_else(|| sized("").map(|size| (size, "1")))?,
            },
        };
        Some(Unit { symbol, size, becomes })
    }

    /// The units of this kind, in words.
    pub(super) fn allowed(self) -> String {
        match self {
            Self::Time => format!("{}, ns", allowed_units("s")),
            Self::Signal => format!("{}, %, {}, 1", allowed_units("m"), KEPT.join(", ")),
        }
    }

    /// Name and unit of a column whose name ends with its unit: `Position [mm]`, `Position (mm)`, `position_mm`.
    pub(super) fn split(self, name: &str) -> (&str, Option<Unit>) {
        let bracket = [('[', ']'), ('(', ')')].into_iter().find_map(|(open, close)| {
            let (before, symbol) = name.strip_suffix(close)?.rsplit_once(open)?;
            Some((before.trim_end(), self.unit(symbol)?))
        });
        let tail = || {
            let (before, symbol) = name.rsplit_once('_')?;
            Some((before, self.unit(symbol).filter(|_| IN_NAMES.contains(&symbol))?))
        };
        match bracket.or_else(tail) {
            Some((before, unit)) if !before.is_empty() => (before, Some(unit)),
            _ => (name, None),
        }
    }
}

/// A symbol without brackets, in the letters of [`quantity`].
fn plain(text: &str) -> String {
    let text = text.trim();
    let inner = [('[', ']'), ('(', ')')].into_iter().find_map(|(open, close)| {
        let inner = text.strip_prefix(open)?.strip_suffix(close)?;
        Some(inner.trim())
    });
    // The micro sign and the Greek letter look the same.
    inner.unwrap_or(text).replace(['µ', 'μ'], "u").replace('°', "deg")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_has_its_size_and_the_unit_that_it_becomes() {
        let found = |kind: Kind, text: &str| kind.unit(text).map(|unit| (unit.size, unit.becomes));
        assert_eq!(found(Kind::Signal, "[mm]"), Some((1e-3, "m")));
        assert_eq!(found(Kind::Signal, " (%) "), Some((1e-2, "1")));
        assert_eq!(found(Kind::Signal, "°"), Some((1.0, "deg")));
        assert_eq!(found(Kind::Signal, "-"), Some((1.0, "1")));
        assert_eq!(found(Kind::Signal, "four"), None);
        assert_eq!(found(Kind::Signal, "ms"), None);
        assert_eq!(found(Kind::Time, "ms"), Some((1e-3, "s")));
        assert_eq!(found(Kind::Time, "µs"), Some((1e-6, "s")));
        assert_eq!(found(Kind::Time, "μs"), Some((1e-6, "s")));
        assert_eq!(found(Kind::Time, "mm"), None);
        assert_eq!(found(Kind::Time, ""), None);
        for kept in KEPT {
            assert_eq!(found(Kind::Signal, kept), Some((1.0, kept)));
        }
    }

    #[test]
    fn the_end_of_a_name_may_be_its_unit() {
        let split = |kind: Kind, name: &str| {
            let (before, unit) = kind.split(name);
            (before.to_owned(), unit.map(|unit| unit.symbol))
        };
        let with = |before: &str, unit: &str| (before.to_owned(), Some(unit.to_owned()));
        assert_eq!(split(Kind::Signal, "Rod position [mm]"), with("Rod position", "mm"));
        assert_eq!(split(Kind::Time, "t (ms)"), with("t", "ms"));
        assert_eq!(split(Kind::Time, "t_ms"), with("t", "ms"));
        for name in ["valve_in", "u [cmd]", "y_min", "[mm]", "_mm", "t"] {
            assert_eq!(split(Kind::Signal, name), (name.to_owned(), None));
        }
    }
}
