//! How an axis is identified: `[axis.NAME.identification]` and `forgetting`.

use std::{fmt, str::FromStr, time::Duration};

use super::{Fuzzy, document::Section};
use crate::hammerstein::{MAX_DELAY, MAX_LINEAR, MAX_ORDER, Structure};

/// How one output is identified.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// Orders of the model.
    pub structure: Structure,
    /// Samples for offline identification, from the start on.
    pub training: usize,
    /// Samples ahead for the h-step error.
    pub horizon: usize,
    /// Which coefficients are updated online.
    pub form: Form,
    /// How b, f and g are separated.
    pub split: Split,
    /// The forgetting factor.
    pub forgetting: Forgetting,
    /// Settings of the fuzzy forgetting factor.
    pub fuzzy: Fuzzy,
}

/// Which coefficients the recursive estimator updates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Form {
    /// a and b, with f and g held from offline identification: the paper's steps 3 and 6.
    Linear,
    /// The over-parametrised form (14), a and all products C_ij: can follow a changing valve curve.
    Full,
}

/// How the products C_ij = f_i b_j are separated into b, f and g.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// Alternating least squares on the stored normal equations.
    Als,
    /// The paper's formula (17).
    Paper,
}

/// Which forgetting factor the recursive estimator uses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Forgetting {
    /// The paper's fuzzy one.
    Paper,
    /// A constant.
    Constant(f64),
}

impl FromStr for Forgetting {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let allowed = || format!("found \"{text}\"; allowed: \"paper\", or \"constant:L\" with L from 0.5 to 1");
        if text == "paper" {
            return Ok(Self::Paper);
        }
        let factor = text.strip_prefix("constant:").ok_or_else(allowed)?;
        let factor: f64 = factor.parse().map_err(|_| allowed())?;
        if (0.5..=1.0).contains(&factor) { Ok(Self::Constant(factor)) } else { Err(allowed()) }
    }
}

impl fmt::Display for Forgetting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Paper => write!(f, "paper"),
            Self::Constant(factor) => write!(f, "constant:{factor}"),
        }
    }
}

impl Identification {
    pub(super) fn read(mut section: Section, forgetting: Forgetting, period: Duration, fuzzy: Fuzzy) -> Self {
        let paper = Structure::PAPER;
        let structure = Structure {
            na: section.integer_or("na", paper.na, 1..=MAX_LINEAR),
            nb: section.integer_or("nb", paper.nb, 0..=MAX_LINEAR - 1),
            nk: section.integer_or("nk", paper.nk, 1..=MAX_DELAY),
            order: section.integer_or("order", paper.order, 1..=MAX_ORDER),
        };
        // Fewer rows than coefficients cannot determine them.
        let shortest = structure.full_len() + structure.memory();
        let identification = Self {
            structure,
            training: section.samples_or("training", shortest.max(1000), shortest..=100_000_000, period),
            horizon: section.samples_or(
                "horizon",
                super::samples_of(Duration::from_millis(500), period).max(1),
                1..=10_000,
                period,
            ),
            form: section.choice_or("form", Form::Linear, &[("linear", Form::Linear), ("full", Form::Full)]),
            split: section.choice_or("split", Split::Als, &[("als", Split::Als), ("paper", Split::Paper)]),
            forgetting,
            fuzzy,
        };
        section.finish();
        identification
    }
}
