//! How an axis is controlled: `[axis.NAME.control]`.

use std::time::Duration;

use super::{commissioned::Commissioned, dead_band::DeadBand};
use crate::{hammerstein::MAX_DELAY, machine::document::Section};

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

impl Control {
    pub(super) fn read(
        mut section: Section,
        name: &str,
        commissioned: Option<&Commissioned>,
        period: Duration,
    ) -> Self {
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
