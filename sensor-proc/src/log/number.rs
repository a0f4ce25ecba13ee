//! Numbers with a decimal point or a decimal comma.
//!
//! Trap: `1,234` is 1.234 in one file and 1234 in another. So a file has one of the two marks, and a number with the
//! other mark is refused.

/// The decimal mark of a file, once a number has shown it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Decimal {
    comma: Option<bool>,
}

impl Decimal {
    pub(super) fn name(self) -> &'static str {
        if self.comma == Some(true) { "decimal commas" } else { "decimal points" }
    }

    /// The finite number of a field; else what was found and what is allowed.
    pub(super) fn parse(&mut self, text: &str) -> Result<f64, (String, &'static str)> {
        let refused = || (format!("\"{text}\""), "a finite number");
        let comma = text.contains(',');
        let value = if comma && !text.contains('.') { text.replacen(',', ".", 1).parse() } else { text.parse::<f64>() };
        let value = value.ok().filter(|value| value.is_finite()).ok_or_else(refused)?;
        if comma || text.contains('.') {
            match *self.comma.get_or_insert(comma) {
                true if !comma => return Err((format!("\"{text}\""), "decimal commas, as in the rows before")),
                false if comma => return Err((format!("\"{text}\""), "decimal points, as in the rows before")),
                _ => {}
            }
        }
        Ok(value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_has_points_or_commas() {
        let mut points = Decimal::default();
        assert_eq!(["1", "-0.5", "2e-3"].map(|text| points.parse(text).unwrap()), [1.0, -0.5, 2e-3]);
        assert_eq!(points.parse("1,234").unwrap_err().1, "decimal points, as in the rows before");
        let mut commas = Decimal::default();
        assert_eq!(["1", "-0,5", "2,5e-3"].map(|text| commas.parse(text).unwrap()), [1.0, -0.5, 2.5e-3]);
        assert_eq!(commas.parse("1.5").unwrap_err().1, "decimal commas, as in the rows before");
        for wrong in ["", "nan", "inf", "1.234,5", "1,234,5", "1,234.5", "four", "1e999", ","] {
            assert_eq!(Decimal::default().parse(wrong).unwrap_err().1, "a finite number", "{wrong}");
        }
    }
}
