//! The window that the axis may move in, and the speed that the window allows.

use pipeline::machine::Axis;

use super::{ExperimentOptions, abort::Abort};

/// Part of the travel between the soft limits that is used when the options do not say.
const DEFAULT_TRAVEL: f64 = 0.4;
/// Part of the axis' `max_speed` that is allowed when the options do not say.
const DEFAULT_SPEED: f64 = 0.25;
/// Part of the window, on either side, that the axis may be outside before the experiment ends.
const MARGIN: f64 = 0.05;
/// The least margin, m.
const LEAST_MARGIN: f64 = 5e-3;
/// Travel that the window needs for each second of a stroke, as multiple of a clear motion, 1/s.
const CLEAR_MOTIONS: f64 = 25.0;

/// Window and speeds of one experiment.
#[derive(Debug, Clone)]
pub(super) struct Window {
    soft_limits: (f64, f64),
    /// Travel that is asked for, m.
    travel: f64,
    /// Speed bound, m/s.
    pub fastest: f64,
    /// Speed that the strokes aim at, m/s: the bound, or less if the window is short.
    pub aim: f64,
    /// Low and high end, m.
    pub range: (f64, f64),
    /// How far the axis may be outside, m.
    pub margin: f64,
}

impl Window {
    /// Without a place until the first sample.
    pub fn new(axis: &Axis, options: &ExperimentOptions) -> Self {
        let (low, high) = axis.soft_limits;
        let fastest = options.speed.unwrap_or(DEFAULT_SPEED * axis.max_speed).min(axis.max_speed);
        Self {
            soft_limits: axis.soft_limits,
            travel: options.travel.unwrap_or(DEFAULT_TRAVEL * (high - low)),
            fastest,
            aim: fastest,
            range: (f64::NEG_INFINITY, f64::INFINITY),
            margin: 0.0,
        }
    }

    /// Places the window around where the axis stands, m.
    pub fn place(&mut self, position: f64) -> Result<(), Abort> {
        let (low, high) = self.soft_limits;
        self.range = ((position - 0.5 * self.travel).max(low), (position + 0.5 * self.travel).min(high));
        let travel = self.range.1 - self.range.0;
        self.margin = (MARGIN * travel).max(LEAST_MARGIN);
        if (low..=high).contains(&position) {
            Ok(())
        } else {
            Err(Abort::Start { position, soft_limits: self.soft_limits })
        }
    }

    /// Chooses the speed to aim at, such that a stroke of `time` s fits in. Refuses a window in which such a stroke
    /// could not be seen; `clear` is the way from which on motion is clear, m.
    pub fn choose_aim(&mut self, time: f64, clear: f64) -> Result<(), Abort> {
        let travel = self.range.1 - self.range.0;
        let needed = CLEAR_MOTIONS * clear * time;
        if travel < needed {
            return Err(Abort::TooSmall { travel, needed });
        }
        self.aim = self.fastest.min(0.5 * travel / time);
        Ok(())
    }

    /// Part of the window above `position`, 0 to 1.
    pub fn part_above(&self, position: f64) -> f64 {
        let (low, high) = self.range;
        (high - position) / (high - low)
    }

    /// Whether the position is in the upper half.
    pub fn is_above_middle(&self, position: f64) -> bool {
        position > 0.5 * (self.range.0 + self.range.1)
    }
}
