//! The choice of the estimator: key `estimator` of `[axis.NAME.identification]`.

use std::{fmt, str::FromStr};

use crate::nearest::did_you_mean;

/// Algorithm that adapts the coefficients online.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Estimator {
    /// The paper's method as printed: recursive least squares with the fuzzy forgetting factor of Table 1, on the
    /// paper's universes, with the coefficients separated by (17).
    Paper,
    /// Recursive least squares with the fuzzy forgetting factor that `[fuzzy]` sets.
    Rules,
    /// Recursive least squares with this constant forgetting factor.
    Constant(f64),
    /// Recursive least squares with the paper's rules on errors divided by their own scale; the value is the smallest
    /// forgetting factor.
    Fuzzy(f64),
    /// Recursive least squares with the forgetting factor of Fortescue, Kershenbaum and Ydstie. The value is the
    /// memory in samples while the errors are as large as those of the training.
    Fortescue(usize),
    /// Recursive least squares that forgets along the regressor only, with this forgetting factor.
    Directional(f64),
    /// Least squares on a sliding window of this many samples.
    Window(usize),
    /// Bank of estimators, weighted by how well they predict.
    Auto,
    /// Adapts only the speeds and the lag of the commissioned model, which also gives the structure.
    GreyBox,
}

impl Estimator {
    /// The texts that `FromStr` takes.
    pub const ALLOWED: &str = "\"auto\", \"paper\", \"rules\", \"constant:L\" with L from 0.5 to 1, \
         \"fuzzy:LOW\" with LOW from 0.5 to below 1, \"fortescue:N0\" with N0 of 2 samples or more, \
         \"directional:L\" with L from 0.5 to 1, \"window:N\" with N from 2 to 100000 samples, or \"grey-box\"";

    /// Names of the estimators, without their values.
    pub const NAMES: [&str; 9] =
        ["auto", "paper", "rules", "constant", "fuzzy", "fortescue", "directional", "window", "grey-box"];

    fn parse(text: &str) -> Option<Self> {
        let (kind, value) = text.split_once(':').unwrap_or((text, ""));
        // `contains` is false for NaN.
        let factor = || value.parse().ok().filter(|factor| (0.5..=1.0).contains(factor));
        let samples = |most| value.parse().ok().filter(|samples| (2..=most).contains(samples));
        match kind {
            "auto" if text == kind => Some(Self::Auto),
            "paper" if text == kind => Some(Self::Paper),
            "rules" if text == kind => Some(Self::Rules),
            "grey-box" if text == kind => Some(Self::GreyBox),
            "constant" => factor().map(Self::Constant),
            "fuzzy" => factor().filter(|low| *low < 1.0).map(Self::Fuzzy),
            "fortescue" => samples(usize::MAX).map(Self::Fortescue),
            "directional" => factor().map(Self::Directional),
            "window" => samples(100_000).map(Self::Window),
            _ => None,
        }
    }
}

impl FromStr for Estimator {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::parse(text).ok_or_else(|| {
            let name = text.split(':').next().unwrap_or_default();
            let hint = if Self::NAMES.contains(&name) { String::new() } else { did_you_mean(name, Self::NAMES) };
            format!("found \"{text}\"; allowed: {}{hint}", Self::ALLOWED)
        })
    }
}

impl fmt::Display for Estimator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Paper => write!(f, "paper"),
            Self::Rules => write!(f, "rules"),
            Self::Constant(factor) => write!(f, "constant:{factor}"),
            Self::Fuzzy(low) => write!(f, "fuzzy:{low}"),
            Self::Fortescue(memory) => write!(f, "fortescue:{memory}"),
            Self::Directional(factor) => write!(f, "directional:{factor}"),
            Self::Window(rows) => write!(f, "window:{rows}"),
            Self::Auto => write!(f, "auto"),
            Self::GreyBox => write!(f, "grey-box"),
        }
    }
}
