//! How an axis is identified: `[axis.NAME.identification]`.

use std::{fmt, str::FromStr, time::Duration};

use super::{Fuzzy, document::Section};
use crate::hammerstein::{Basis, InputMap, MAX_DELAY, MAX_LINEAR, MAX_ORDER, Structure};

/// Widest dead band that the machine file takes, as that of the fallback.
const WIDEST_DEAD_BAND: f64 = 0.9;

/// How one output is identified.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// Orders and options of the model of the output.
    pub structure: Structure,
    /// What the output is.
    pub output: IdentifiedOutput,
    /// Sample period, s.
    pub period: f64,
    /// Samples for offline identification, from the start on.
    pub training: usize,
    /// Samples ahead for the h-step error.
    pub horizon: usize,
    /// Which coefficients are updated online.
    pub form: Form,
    /// How b, f and g are separated.
    pub split: Split,
    /// Algorithm that adapts the coefficients online.
    pub estimator: Estimator,
    /// Settings of the fuzzy forgetting factor.
    pub fuzzy: Fuzzy,
}

/// What is identified, of an axis whose position is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum IdentifiedOutput {
    /// The position itself, m.
    Position,
    /// Its backward difference by the period, m/s. The published model is one of the position all the same.
    Velocity,
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

/// Algorithm that adapts the coefficients online.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Estimator {
    /// Recursive least squares with the paper's fuzzy forgetting factor.
    Paper,
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
    pub const ALLOWED: &str = "\"auto\", \"paper\", \"constant:L\" with L from 0.5 to 1, \"fuzzy:LOW\" with LOW from 0.5 \
         to below 1, \"fortescue:N0\" with N0 of 2 samples or more, \"directional:L\" with L from 0.5 to 1, \
         \"window:N\" with N from 2 to 100000 samples, or \"grey-box\"";

    fn parse(text: &str) -> Option<Self> {
        let (kind, value) = text.split_once(':').unwrap_or((text, ""));
        // `contains` is false for NaN.
        let factor = || value.parse().ok().filter(|factor| (0.5..=1.0).contains(factor));
        let samples = |most| value.parse().ok().filter(|samples| (2..=most).contains(samples));
        match kind {
            "auto" if text == kind => Some(Self::Auto),
            "paper" if text == kind => Some(Self::Paper),
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
        Self::parse(text).ok_or_else(|| format!("found \"{text}\"; allowed: {}", Self::ALLOWED))
    }
}

impl fmt::Display for Estimator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Paper => write!(f, "paper"),
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

impl Identification {
    pub(super) fn read(mut section: Section, period: Duration, fuzzy: Fuzzy) -> Self {
        let paper = Structure::PAPER;
        let (order, basis) = read_basis(&mut section);
        let structure = Structure {
            na: section.integer_or("na", paper.na, 1..=MAX_LINEAR),
            nb: section.integer_or("nb", paper.nb, 0..=MAX_LINEAR - 1),
            nk: section.integer_or("nk", paper.nk, 1..=MAX_DELAY),
            order,
            integrator: section.flag_or("integrator", false),
            drift: section.flag_or("drift", false),
            input: InputMap { dead_band: section.pair_or("dead_band", (0.0, 0.0), 0.0..=WIDEST_DEAD_BAND), basis },
        };
        let outputs = [("position", IdentifiedOutput::Position), ("velocity", IdentifiedOutput::Velocity)];
        let output = section.choice_or("output", IdentifiedOutput::Position, &outputs);
        let shortest = shortest_training(structure, output);
        let identification = Self {
            structure,
            output,
            period: period.as_secs_f64(),
            training: section.samples_or("training", shortest.max(1000), shortest..=100_000_000, period),
            horizon: section.samples_or(
                "horizon",
                super::samples_of(Duration::from_millis(500), period).max(1),
                1..=10_000,
                period,
            ),
            form: section.choice_or("form", Form::Linear, &[("linear", Form::Linear), ("full", Form::Full)]),
            split: section.choice_or("split", Split::Als, &[("als", Split::Als), ("paper", Split::Paper)]),
            estimator: section.parsed_or("estimator", Estimator::Auto, Estimator::ALLOWED),
            fuzzy,
        };
        section.finish();
        identification
    }

    /// How many coefficients are updated online.
    pub const fn coefficients(&self) -> usize {
        match self.form {
            Form::Linear => self.structure.linear_len(),
            Form::Full => self.structure.full_len(),
        }
    }

    /// Refuses what cannot work for the axis `name`: a window with fewer samples than coefficients, which cannot determine
    /// them, and a grey box of an axis that is not commissioned, or of another output or order than it has.
    ///
    /// # Errors
    /// What was found, and what is allowed.
    pub fn check_estimator(&self, name: &str, commissioned: bool) -> Result<(), (String, String)> {
        let n = self.coefficients();
        match self.estimator {
            Estimator::GreyBox if !commissioned => {
                let found = format!("\"grey-box\" without [axis.{name}.commissioned]");
                let allowed =
                    "another one, or a commissioned model: `--model MODEL.toml`, as `hydraxis commission` writes it";
                Err((found, allowed.to_owned()))
            }
            Estimator::GreyBox if self.output != IdentifiedOutput::Position || self.structure.past_outputs() < 2 => {
                let found = format!("\"grey-box\" with output \"{:?}\" and na = {}", self.output, self.structure.na);
                Err((found.to_lowercase(), "output \"position\" and na of 2 or more".to_owned()))
            }
            Estimator::Window(rows) if rows < n => {
                let found = format!("\"{}\" for {n} coefficients", self.estimator);
                Err((found, format!("\"window:N\" with N from {n}, one sample for each, to 100000")))
            }
            _ => Ok(()),
        }
    }

    /// The structure of the coefficients that are published: those of a model of the position, with every integrator
    /// multiplied into A.
    pub const fn published(&self) -> Structure {
        published(self.structure, self.output)
    }
}

const fn published(structure: Structure, output: IdentifiedOutput) -> Structure {
    let published = structure.published();
    match output {
        IdentifiedOutput::Position => published,
        IdentifiedOutput::Velocity => Structure { na: published.na + 1, ..published },
    }
}

/// Fewest samples for offline identification: fewer rows than coefficients cannot determine them.
pub const fn shortest_training(structure: Structure, output: IdentifiedOutput) -> usize {
    structure.full_len() + published(structure, output).memory()
}

/// Order and basis of N, from `order` and `knots`.
fn read_basis(section: &mut Section) -> (usize, Basis) {
    let order = section.optional_integer("order", 1..=MAX_ORDER);
    let default = order.unwrap_or(Structure::PAPER.order);
    let allowed = format!("a list of 1 to {MAX_ORDER} rising numbers from 0 to 1");
    let knots = section.optional_numbers("knots", 0.0..=1.0, &allowed);
    let Some(knots) = knots else { return (default, Basis::Powers) };
    let Some(basis) = Basis::hinges(&knots) else {
        section.refuse("knots", format!("{knots:?}"), allowed);
        return (default, Basis::Powers);
    };
    if let Some(order) = order.filter(|order| *order != knots.len()) {
        let allowed = format!("{}, the number of knots, or no order", knots.len());
        section.refuse("order", format!("{order} with {} knots", knots.len()), allowed);
    }
    (knots.len(), basis)
}
