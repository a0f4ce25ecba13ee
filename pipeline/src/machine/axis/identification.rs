//! How an axis is identified: `[axis.NAME.identification]`.

use std::time::Duration;

use super::{
    commissioned::{Commissioned, POINTS_AT_KNOTS},
    estimator::Estimator,
};
use crate::{
    hammerstein::{Basis, Coefficients, InputMap, MAX_DELAY, MAX_LINEAR, MAX_ORDER, Structure},
    machine::{
        document::{Section, Shown, samples_of},
        fuzzy::Fuzzy,
    },
};

/// Widest dead band that the machine file takes, here and for the fallback.
const WIDEST_DEAD_BAND: f64 = 0.9;

/// Memory of the grey box where nothing else is given, s of motion.
pub const GREY_BOX_MEMORY: f64 = 0.7;
/// Memory of a grey box whose curve a Smith predictor uses, s of motion: its feedback does not depend on the curve, so
/// the curve may be slow, and is less noisy then.
pub const SMITH_MEMORY: f64 = 3.0;

/// How one output is identified.
#[derive(Debug, Clone, PartialEq)]
pub struct Identification {
    /// Orders and options of the model of the output.
    pub structure: Structure,
    /// What is identified.
    pub output: IdentifiedOutput,
    /// Sample period, s.
    pub period: f64,
    /// Samples from the start on for offline identification.
    pub training: usize,
    /// How many samples ahead the h-step error looks.
    pub horizon: usize,
    /// Which coefficients are updated online.
    pub form: Form,
    /// How the products f_i b_j are separated.
    pub split: Split,
    /// Algorithm that adapts the coefficients online.
    pub estimator: Estimator,
    /// Settings of the fuzzy forgetting factor.
    pub fuzzy: Fuzzy,
    /// Width of the valve's hysteresis that the commands go through before they are identified, in parts of the full
    /// command.
    pub hysteresis: f64,
    /// Memory of the grey box, s of motion.
    pub memory: f64,
    /// What the grey box starts from in the place of the commissioned speeds and lag.
    pub start: Option<Start>,
}

/// What a grey box had learned at the end of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Lag of the model, s: that of the axis without the part of it that the whole samples of the delay hold.
    pub lag: f64,
    /// Speeds at the openings of [`Commissioned::at_knots`] while extending, m/s, rising.
    pub speeds_extend: Vec<f64>,
    /// Speeds at those openings while retracting, m/s, as magnitudes, rising.
    pub speeds_retract: Vec<f64>,
}

impl Start {
    /// From a `model` of a grey box on the `commissioned` axis, identified every `period` s; `None` where the numbers
    /// are none that a grey box has.
    pub fn of(model: &Coefficients, commissioned: &Commissioned, period: f64) -> Option<Self> {
        let alpha = model.a[1];
        let Commissioned { openings, dead_band, .. } = commissioned.at_knots();
        let n = model.nonlinearity();
        let speeds = |sign: f64, edge: f64| openings.iter().map(|x| sign * n.evaluate(sign * (edge + x))).collect();
        let start = Self {
            lag: period * alpha / (1.0 - alpha),
            speeds_extend: speeds(1.0, dead_band.extend),
            speeds_retract: speeds(-1.0, dead_band.retract),
        };
        let fits = (0.0..=LONGEST_LAG).contains(&start.lag);
        (fits && [&start.speeds_extend, &start.speeds_retract].into_iter().all(|speeds| rise(speeds))).then_some(start)
    }

    /// The `commissioned` axis with the speeds of this start.
    pub fn speeds(&self, commissioned: &Commissioned) -> Commissioned {
        Commissioned {
            speeds_extend: self.speeds_extend.clone(),
            speeds_retract: self.speeds_retract.clone(),
            ..commissioned.at_knots()
        }
    }

    /// `start_lag`, `start_speeds_extend` and `start_speeds_retract`, all of them or none.
    fn read(section: &mut Section, commissioned: Option<&Commissioned>, estimator: Estimator) -> Option<Self> {
        let allowed = format!("{POINTS_AT_KNOTS} rising numbers greater than 0, or no start_ keys");
        let lag = section
            .key("start_lag", "Lag that the grey box starts from, as a run has learned it; `run --warm` sets it")
            .optional_number(0.0..=LONGEST_LAG, "s");
        let speeds_extend = section
            .key("start_speeds_extend", "Speeds that the grey box starts from, at the hinges of its curve, extending")
            .optional_numbers(0.0..=1000.0, "m/s", &allowed);
        let speeds_retract = section
            .key("start_speeds_retract", "The same while retracting, as magnitudes")
            .optional_numbers(0.0..=1000.0, "m/s", &allowed);
        if estimator != Estimator::GreyBox || commissioned.is_none() {
            if lag.is_some() || speeds_extend.is_some() || speeds_retract.is_some() {
                let found = format!("start_ keys with estimator \"{estimator}\"");
                section.refuse("estimator", found, "\"grey-box\" with a commissioned model, or no start_ keys");
            }
            return None;
        }
        for (key, speeds) in [("start_speeds_extend", &speeds_extend), ("start_speeds_retract", &speeds_retract)] {
            if let Some(speeds) = speeds.as_ref().filter(|speeds| speeds.len() != POINTS_AT_KNOTS || !rise(speeds)) {
                section.refuse(key, format!("{speeds:?}"), allowed.clone());
            }
        }
        match (lag, speeds_extend, speeds_retract) {
            (Some(lag), Some(speeds_extend), Some(speeds_retract)) => Some(Self { lag, speeds_extend, speeds_retract }),
            (None, None, None) => None,
            _ => {
                section.refuse("start_lag", "some of the start_ keys", "all three of them, or none");
                None
            }
        }
    }
}

/// Longest lag that a model starts from, s.
const LONGEST_LAG: f64 = 10.0;

/// Whether these are speeds of a curve.
fn rise(speeds: &[f64]) -> bool {
    speeds.first().is_some_and(|first| *first > 0.0) && speeds.is_sorted_by(|a, b| a < b)
}

/// What is identified. The position is what is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum IdentifiedOutput {
    /// The position itself, m.
    Position,
    /// The backward difference of the position, divided by the period, m/s. The published model is still one of the
    /// position.
    Velocity,
}

/// Which coefficients the recursive estimator updates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Form {
    /// a and b, with f and g held from offline identification: the paper's steps 3 and 6.
    Linear,
    /// a and all products C_ij of the over-parametrised form (14): can follow a valve curve that changes.
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

impl Split {
    /// The separation that an estimator has unless another one is asked for.
    pub fn default_of(estimator: Estimator) -> Self {
        if estimator == Estimator::Paper { Self::Paper } else { Self::Als }
    }
}

impl Identification {
    pub(super) fn read(
        mut section: Section,
        axis: &str,
        commissioned: Option<&Commissioned>,
        period: Duration,
        fuzzy: Fuzzy,
    ) -> Self {
        section.renamed("forgetting", "estimator");
        let structure = read_structure(&mut section, commissioned, period);
        let outputs = [("position", IdentifiedOutput::Position), ("velocity", IdentifiedOutput::Velocity)];
        let output = section
            .key("output", "What is identified; the controller's model is one of the position with either choice")
            .choice_or(IdentifiedOutput::Position, &outputs);
        let shortest = shortest_training(structure, output);
        let estimator = read_estimator(&mut section);
        let (hysteresis, memory) = read_grey_box(&mut section);
        let mut identification = Self {
            structure,
            output,
            period: period.as_secs_f64(),
            training: section
                .key(
                    "training",
                    "Samples from the start on for offline identification; of a running machine only those with motion",
                )
                .rule("1000 samples, or one for each coefficient where those are more")
                .allows("one sample for each coefficient or more, as a whole number or a duration such as \"8s\"")
                .samples_or(shortest.max(1000), shortest..=100_000_000, period),
            horizon: section
                .key("horizon", "How many samples ahead the h-step error looks")
                .rule("0.5s, one sample at least")
                .allows("1 to 10000 samples, as a whole number or a duration such as \"0.5s\"")
                .samples_or(samples_of(Duration::from_millis(500), period).max(1), 1..=10_000, period),
            form: section
                .key("form", "Which coefficients are updated online: a and b (linear), or all products f_i b_j (full)")
                .choice_or(Form::Linear, &[("linear", Form::Linear), ("full", Form::Full)]),
            split: section
                .key(
                    "split",
                    "How the products f_i b_j are separated: by alternating least squares, or by formula (17)",
                )
                .rule("\"als\"; \"paper\" with estimator = \"paper\"")
                .choice_or(Split::default_of(estimator), &[("als", Split::Als), ("paper", Split::Paper)]),
            estimator,
            fuzzy,
            hysteresis,
            memory,
            start: Start::read(&mut section, commissioned, estimator),
        };
        if let Some(model) = commissioned.filter(|_| identification.estimator == Estimator::GreyBox) {
            identification.structure = model.structure(structure, period);
            show_structure(&section, identification.structure);
        }
        if let Err((found, allowed)) = identification.check_estimator(axis, commissioned.is_some()) {
            section.refuse("estimator", found, allowed);
        }
        section.finish();
        identification
    }

    /// Number of coefficients that are updated online.
    pub const fn coefficients(&self) -> usize {
        match self.form {
            Form::Linear => self.structure.linear_len(),
            Form::Full => self.structure.full_len(),
        }
    }

    /// Refuses an estimator that cannot work for the axis `name`: a window with fewer samples than coefficients, which
    /// cannot determine them; a grey box without a commissioned model, or with an output or order that the grey box
    /// does not have; and the paper's method with a form, separation or output that is not the paper's.
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
            Estimator::Paper
                if (self.form, self.split, self.output) != (Form::Linear, Split::Paper, IdentifiedOutput::Position) =>
            {
                let (form, split, output) = (self.form, self.split, self.output);
                let found = format!("\"paper\" with form \"{form:?}\", split \"{split:?}\", output \"{output:?}\"");
                let allowed = "form \"linear\", split \"paper\" and output \"position\", or estimator \"rules\"";
                Err((found.to_lowercase(), allowed.to_owned()))
            }
            Estimator::Window(rows) if rows < n => {
                let found = format!("\"{}\" for {n} coefficients", self.estimator);
                Err((found, format!("\"window:N\" with N from {n}, one sample for each, to 100000")))
            }
            _ => Ok(()),
        }
    }

    /// Structure of the published coefficients: a model of the position, with every integrator multiplied into A.
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

/// Smallest number of samples for offline identification: fewer rows than coefficients cannot determine them.
pub const fn shortest_training(structure: Structure, output: IdentifiedOutput) -> usize {
    structure.full_len() + published(structure, output).memory()
}

fn read_estimator(section: &mut Section) -> Estimator {
    section.key("estimator", "Algorithm that adapts the coefficients online").parsed_or(
        Estimator::Auto,
        Estimator::ALLOWED,
        &Estimator::NAMES,
    )
}

/// Hysteresis of the commands, and memory of the grey box in s of motion.
fn read_grey_box(section: &mut Section) -> (f64, f64) {
    let hysteresis = section
        .key("hysteresis", "Width of the valve's hysteresis that the commands go through before they are identified")
        .number_or(0.0, 0.0..=0.5, "");
    let memory = section.key("memory", "Memory of the grey box, in seconds of motion").number_or(
        GREY_BOX_MEMORY,
        0.1..=1e4,
        "s",
    );
    (hysteresis, memory)
}

/// The structure; delay and dead band of the commissioned model are its defaults.
fn read_structure(section: &mut Section, commissioned: Option<&Commissioned>, period: Duration) -> Structure {
    let paper = Structure::PAPER;
    let (order, basis) = read_basis(section);
    refuse_long_delay(section, commissioned, period);
    Structure {
        na: section.key("na", "Order of A: number of past outputs").integer_or(paper.na, 1..=MAX_LINEAR),
        nb: section.key("nb", "Order of B: number of past commands less one").integer_or(paper.nb, 0..=MAX_LINEAR - 1),
        nk: section
            .key("nk", "Samples from command to motion")
            .rule("commissioned.dead_time in periods, rounded up, plus 1; 1 without it")
            .integer_or(commissioned.map_or(paper.nk, |model| model.delay(period)), 1..=MAX_DELAY),
        order,
        integrator: section
            .key("integrator", "Whether A(z) = (1 - z^-1) A'(z), estimated on the increments of the position")
            .flag_or(false),
        drift: section
            .key("drift", "Whether the difference equation has a constant, for gravity and leakage")
            .flag_or(false),
        input: InputMap {
            dead_band: section
                .key("dead_band", "Dead band that is taken off the command first: retracting and extending")
                .rule("commissioned.dead_band_retract and _extend, less 0.01; [0.0, 0.0] without them")
                .pair_or(commissioned.map_or((0.0, 0.0), Commissioned::identified_dead_band), 0.0..=WIDEST_DEAD_BAND),
            basis,
        },
    }
}

/// Refuses a commissioned dead time of more periods than a model can have, where no `nk` is given.
fn refuse_long_delay(section: &mut Section, commissioned: Option<&Commissioned>, period: Duration) {
    let Some(model) = commissioned.filter(|model| model.unlimited_delay(period) > MAX_DELAY) else { return };
    if !section.is_present("nk") {
        let (dead_time, nk) = (model.dead_time, model.unlimited_delay(period));
        let longest = (period * (MAX_DELAY as u32 - 1)).as_secs_f64();
        let found = format!("nothing, and {nk} from commissioned.dead_time of {dead_time} s");
        let allowed = format!("1 to {MAX_DELAY}: a longer timing.period, or a dead time of up to {longest} s");
        section.refuse("nk", found, allowed);
    }
}

/// Notes the structure that the grey box takes from the commissioned model, whatever its keys say.
fn show_structure(section: &Section, structure: Structure) {
    let rule = |from: &str| format!("{from}, by estimator \"grey-box\"");
    section.derive("nk", structure.nk.shown(), &rule("commissioned.dead_time in periods, rounded up, plus 1"));
    let dead_band = rule("commissioned.dead_band_retract and _extend, less 0.01");
    section.derive("dead_band", structure.input.dead_band.shown(), &dead_band);
    if let Basis::Hinges(knots) = structure.input.basis {
        let rule = rule("parts of the largest of commissioned.openings");
        section.derive("knots", knots[..structure.order].shown(), &rule);
        section.derive("order", structure.order.shown(), &rule);
    }
}

/// Order and basis of N, from `order` and `knots`.
fn read_basis(section: &mut Section) -> (usize, Basis) {
    let order = section
        .key("order", "Order of the polynomials of the nonlinearity N")
        .rule("3, or the number of knots")
        .optional_integer(1..=MAX_ORDER);
    let default = order.unwrap_or(Structure::PAPER.order);
    let allowed = format!("a list of 1 to {MAX_ORDER} rising numbers from 0 to 1");
    let knots = section
        .key("knots", "Hinges in the place of powers: magnitudes of the command beyond the dead band where they begin")
        .optional_numbers(0.0..=1.0, "", &allowed);
    let effective = knots.as_ref().map_or(default, Vec::len);
    if order.is_none() {
        section.derive("order", effective.shown(), "3, or the number of knots");
    }
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
