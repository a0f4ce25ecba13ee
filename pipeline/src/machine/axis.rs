//! One axis: `[axis.NAME]`.

use std::{path::Path, time::Duration};

use crate::hammerstein::MAX_DELAY;

use super::{
    Commissioned, Estimator, Fuzzy, Identification, Plant, ReferenceSource, Source, Timing, document::Section,
};

/// One axis of the machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Axis {
    /// Its name, the table's.
    pub name: String,
    /// Travel of the piston, m; the position runs from 0 to it.
    pub stroke: f64,
    /// Fastest speed that the axis can reach, m/s; anything faster is not believed.
    pub max_speed: f64,
    /// Lowest and highest position that a reference may ask for, m.
    pub soft_limits: (f64, f64),
    /// The position encoder.
    pub encoder: Encoder,
    /// How it is identified.
    pub identification: Identification,
    /// How it is controlled.
    pub control: Control,
    /// What commissioning has found of it.
    pub commissioned: Option<Commissioned>,
    /// Where its target comes from.
    pub reference: ReferenceSource,
    /// The simulated axis; only source `sim` needs it.
    pub plant: Option<Plant>,
    /// Columns of a record: input and output; only source `replay` needs them.
    pub columns: (String, String),
}

/// The position encoder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoder {
    /// Length of one count, m.
    pub resolution: f64,
    /// How far outside the stroke a position is still believed, m.
    pub tolerance: f64,
    /// A raw value that has not changed for this long while the axis is commanded to move is stuck.
    pub stuck_after: Duration,
}

/// How one axis is controlled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Control {
    /// Proportional gain of the fallback, command per metre.
    pub kp: f64,
    /// Integral gain of the fallback, command per metre and second.
    pub ki: f64,
    /// Whether the fallback adds velocity feed-forward by what commissioning has found.
    pub feedforward: bool,
    /// Calibrated dead band of the valve, jumped over by the fallback.
    pub dead_band: DeadBand,
    /// Largest magnitude of a command.
    pub command_limit: f64,
    /// Fastest change of a command, 1/s.
    pub command_rate: f64,
    /// How far the axis may be from a target that stands, m; farther for too long is a fault.
    pub following_error: f64,
    /// Which model the model-based controller uses.
    pub model: ModelChoice,
    /// Prediction horizon after the dead time, samples.
    pub horizon: usize,
    /// Moves that the predictive controller plans.
    pub moves: usize,
    /// Weight of the moves, relative to the mean square of the model's own step response over the horizon.
    pub move_weight: f64,
}

/// Commands below which a valve does not open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadBand {
    /// When extending.
    pub extend: f64,
    /// When retracting, as a magnitude.
    pub retract: f64,
}

/// Which model the model-based controller uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ModelChoice {
    /// The one that is updated online.
    Adaptive,
    /// The one that was identified offline and is held.
    Classical,
    /// None: the fallback controls always.
    None,
}

impl Axis {
    pub(super) fn read(
        name: &str,
        mut section: Section,
        timing: &Timing,
        source: &Source,
        fuzzy: Fuzzy,
        folder: &Path,
    ) -> Self {
        if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_') {
            section.refuse("", format!("axis name \"{name}\""), "letters, digits, - and _");
        }
        let stroke = section.number("stroke", 1e-3..=100.0, "m");
        let max_speed = section.number("max_speed", 1e-3..=1000.0, "m/s");
        let limits = section.numbers("soft_limits", -100.0..=100.0, "m", 2);
        let soft_limits = match limits[..] {
            [low, high] if 0.0 <= low && low < high && high <= stroke => (low, high),
            [] => (0.0, stroke),
            _ => {
                section.refuse(
                    "soft_limits",
                    format!("{limits:?}"),
                    format!("[low, high] with 0 <= low < high <= stroke ({stroke})"),
                );
                (0.0, stroke)
            }
        };
        let encoder = Encoder::read(section.section("encoder"));
        section.renamed("forgetting", "identification.estimator");
        let mut identification = Identification::read(section.section("identification"), timing.period, fuzzy);
        let commissioned = Commissioned::read(section.section("commissioned"));
        match &commissioned {
            Some(model) if identification.estimator == Estimator::GreyBox => {
                identification.structure = model.structure(identification.structure, timing.period);
            }
            _ => {}
        }
        if let Err((found, allowed)) = identification.check_estimator(name, commissioned.is_some()) {
            section.refuse("identification.estimator", found, allowed);
        }
        let control = Control::read(section.section("control"), name, commissioned.as_ref(), timing.period);
        let reference = ReferenceSource::read(section.section("reference"), soft_limits, max_speed, folder, name);
        let plant = section.section("plant");
        let plant = if plant.is_given() {
            Some(Plant::read(plant, stroke))
        } else {
            if *source == Source::Sim {
                plant.refuse("", "nothing", "a table with the simulated axis: source is \"sim\"");
            }
            None
        };
        let columns = section.optional_texts("columns", "[\"input column\", \"output column\"]");
        let columns = match columns.as_deref() {
            None => ("u".to_owned(), "y".to_owned()),
            Some([input, output]) => (input.clone(), output.clone()),
            Some(other) => {
                section.refuse("columns", format!("{} names", other.len()), "[\"input column\", \"output column\"]");
                (String::new(), String::new())
            }
        };
        section.finish();
        Self {
            name: name.to_owned(),
            stroke,
            max_speed,
            soft_limits,
            encoder,
            identification,
            control,
            commissioned,
            reference,
            plant,
            columns,
        }
    }
}

impl Encoder {
    fn read(mut section: Section) -> Self {
        let encoder = Self {
            resolution: section.number("resolution", 1e-9..=0.1, "m"),
            tolerance: section.number_or("tolerance", 5e-3, 0.0..=1.0, "m"),
            stuck_after: section.duration_or(
                "stuck_after",
                Duration::from_millis(300),
                Duration::from_millis(1)..=Duration::from_secs(60),
            ),
        };
        section.finish();
        encoder
    }
}

impl Control {
    fn read(mut section: Section, name: &str, commissioned: Option<&Commissioned>, period: Duration) -> Self {
        let extend = section.number("dead_band_extend", 0.0..=0.9, "");
        let retract = section.number("dead_band_retract", 0.0..=0.9, "");
        let models =
            [("adaptive", ModelChoice::Adaptive), ("classical", ModelChoice::Classical), ("none", ModelChoice::None)];
        let control = Self {
            kp: section.number("kp", 0.0..=1e4, "1/m"),
            ki: section.number("ki", 0.0..=1e5, "1/(m s)"),
            feedforward: read_feedforward(&mut section, name, commissioned, period),
            dead_band: DeadBand { extend, retract },
            command_limit: section.number("command_limit", 1e-3..=1.0, ""),
            command_rate: section.number("command_rate", 1e-3..=1e4, "1/s"),
            following_error: section.number_or("following_error", 0.03, 1e-4..=100.0, "m"),
            model: section.choice_or("model", ModelChoice::Adaptive, &models),
            horizon: section.integer_or("horizon", 20, 1..=31),
            moves: section.integer_or("moves", 20, 1..=20),
            move_weight: section.number_or("move_weight", 25.0, 1e-6..=1e3, ""),
        };
        section.finish();
        control
    }
}

/// `feedforward`, which needs a commissioned model, and one whose answer comes within the targets' preview.
fn read_feedforward(section: &mut Section, name: &str, commissioned: Option<&Commissioned>, period: Duration) -> bool {
    let feedforward = section.flag_or("feedforward", false);
    if !feedforward {
        return false;
    }
    let longest = MAX_DELAY as f64 * period.as_secs_f64();
    match commissioned {
        None => section.refuse(
            "feedforward",
            format!("true without [axis.{name}.commissioned]"),
            "false, or a commissioned model: `--model MODEL.toml`, as `hydraxis commission` writes it",
        ),
        Some(model) if model.dead_time + model.time_constant > longest => section.refuse(
            "feedforward",
            format!("true with dead_time + time_constant of {} s", model.dead_time + model.time_constant),
            format!("false, or up to {MAX_DELAY} periods, {longest} s"),
        ),
        Some(_) => {}
    }
    feedforward
}
