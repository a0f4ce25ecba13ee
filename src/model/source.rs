//! An identified model as source code: a C header, a Python module, a MATLAB function.
//!
//! | ending | has |
//! |---|---|
//! | `.h` | a struct with the past, predictions one step and several steps ahead; C99 |
//! | `.py` | a class with the same; Python 3 |
//! | `.m` | state space and N |
//!
//! The sums are in the order of [`Coefficients::predict_one`], so predictions are the same but for the rounding of a
//! compiler that contracts a product and a sum. Numbers are written so that they read back exactly.

use pipeline::hammerstein::{Basis, Coefficients};

use super::{IdentifiedModel, Origin};

/// A language.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Language {
    /// A C header.
    C,
    /// A Python module.
    Python,
    /// A MATLAB function.
    Matlab,
}

impl Language {
    /// The code. `name` is that of the function, or the prefix of all names.
    pub fn code(self, model: &IdentifiedModel, name: &str) -> String {
        let IdentifiedModel { coefficients, period, unit, commands: [low, high], .. } = model;
        let (template, sum) = match self {
            Self::C => (include_str!("templates/model.h"), self.sum(coefficients)),
            Self::Python => (include_str!("templates/model.py"), self.sum(coefficients)),
            Self::Matlab => (include_str!("templates/model.m"), String::new()),
        };
        let order = coefficients.order as usize;
        let [dead_low, dead_high] = coefficients.dead_band;
        let number = |value: f64| format!("{value:?}");
        let values = [
            ("@SUM@", sum),
            ("@KNOTS@", knots(coefficients)),
            ("@ABOUT@", self.about(&model.origin)),
            ("@UNIT@", unit.as_ref().map_or_else(String::new, |unit| format!(" in {}", plain(unit)))),
            ("@NAME@", name.to_owned()),
            ("@UPPER@", name.to_uppercase()),
            ("@PERIOD@", number(*period)),
            ("@LOW@", number(*low)),
            ("@HIGH@", number(*high)),
            ("@NA@", coefficients.na.to_string()),
            ("@LAGS@", coefficients.b().len().to_string()),
            ("@ORDER@", order.to_string()),
            ("@DELAY@", coefficients.nk.to_string()),
            ("@A@", list(coefficients.a())),
            ("@B@", list(coefficients.b())),
            ("@F@", list(&coefficients.f[..order])),
            ("@G@", list(&coefficients.g[..order])),
            ("@DRIFT@", number(coefficients.drift)),
            ("@DEAD_LOW@", number(dead_low)),
            ("@DEAD_HIGH@", number(dead_high)),
            ("@FEATURE@", feature(coefficients)),
        ];
        values.iter().fold(template.to_owned(), |text, (place, value)| text.replace(place, value))
    }

    /// Where the model comes from, in one line of a comment.
    fn about(self, Origin { recordings, estimator, verdict }: &Origin) -> String {
        plain(&format!("Model of one axis by `hydraxis identify` on {recordings}, estimator {estimator}. {verdict}"))
    }

    /// The end of the function N, from the opening v, the coefficients c and a sum that is 0.
    fn sum(self, model: &Coefficients) -> String {
        let knots = match model.nonlinearity().input.basis {
            Basis::Powers => None,
            Basis::Hinges(knots) => Some(list(&knots[..model.order as usize])),
        };
        match (self, knots) {
            (Self::C, None) => "    for (i = @UPPER@_ORDER - 1; i >= 0; i--)\n        sum = (sum + c[i]) * v;\n    \
                                return sum;"
                .to_owned(),
            (Self::C, Some(knots)) => format!(
                "    {{\n        static const double knots[@UPPER@_ORDER] = {{{knots}}};\n        const double size = \
                 v < 0.0 ? -v : v;\n        for (i = 0; i < @UPPER@_ORDER; i++)\n            sum += c[i] * (size > \
                 knots[i] ? size - knots[i] : 0.0 * size);\n    }}\n    return v < 0.0 ? -sum : sum;"
            ),
            (_, None) => {
                "    for c in reversed(coefficients):\n        total = (total + c) * v\n    return total".to_owned()
            }
            (_, Some(knots)) => format!(
                "    for c, knot in zip(coefficients, [{knots}]):\n        total += c * (abs(v) - knot if abs(v) > \
                 knot else 0.0 * v)\n    return -total if v < 0.0 else total"
            ),
        }
    }
}

/// The i-th function of the basis, in MATLAB.
fn feature(model: &Coefficients) -> String {
    let feature = match model.nonlinearity().input.basis {
        Basis::Powers => "v .^ i",
        Basis::Hinges(_) => "(sign(v) .* max(abs(v) - knots(i), 0))",
    };
    feature.to_owned()
}

/// The line with the knots, in MATLAB; empty for powers.
fn knots(model: &Coefficients) -> String {
    match model.nonlinearity().input.basis {
        Basis::Powers => String::new(),
        Basis::Hinges(knots) => format!("knots = [{}];\n", list(&knots[..model.order as usize])),
    }
}

/// Numbers with commas between them.
fn list(values: &[f64]) -> String {
    values.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>().join(", ")
}

/// A text that ends no comment and no string: without line breaks, quotes, backslashes, stars and place holders.
fn plain(text: &str) -> String {
    text.chars().map(|sign| if sign.is_control() || "\"'\\*@".contains(sign) { '_' } else { sign }).collect()
}
