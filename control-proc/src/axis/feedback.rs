//! Feedback of an axis: its usable positions, missing samples, and whether it moves.
//!
//! A tick without a usable position is blind. While the axis follows, the position that the model expects is put in the
//! place of a blind tick (bridged). When a position comes again, only the blind ticks that are not bridged are filled
//! by a straight line ([`History::push_output`]). From the third blind tick on the command is neutral.
//!
//! An axis is blind for as long as `feedback_timeout` where nothing was read, but for two ticks where what was read is
//! implausible.

use pipeline::{
    machine::{Axis, Timing, samples_of},
    message::{AxisSample, sample_fault},
};

use crate::{
    fallback::pressure::{Damping, PressureFeedback},
    predictive::history::{History, OUTPUTS},
    protection::motion::{Motion, Standing},
};

/// Implausible samples in a row that latch the axis; blind ticks in a row from which on it is neutral.
pub const UNUSABLE_LIMIT: u64 = 3;
/// Leaky count of unusable samples that latches the axis: 1 for each, less a leak for each usable one. Two in three
/// latch after 14 samples, one in two after 21, one in six never. A stale one counts for less where `feedback_timeout`
/// is longer than three periods, so that three and a time-out without readings count the same.
const LEAKY_LIMIT: f64 = 8.0;
const LEAK: f64 = 0.25;
/// Time over which the speed of an axis is taken, s: a count of 0.1 mm is 2.5 mm/s then.
pub(super) const SPEED_TIME: f64 = 0.04;

/// Silence after which references wait, s; a shorter one leaves an axis less behind than a person sees.
const SILENCE: f64 = 0.05;

/// Ticks without a reading after which references wait: at least those after which the axis is neutral.
pub fn patience(period: f64) -> u64 {
    ((SILENCE / period).round() as u64).max(UNUSABLE_LIMIT)
}

/// What was observed of an axis at one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// The usable position, m.
    pub position: Option<f64>,
    /// Ticks without a usable position before this one.
    pub missing: u64,
    /// Nothing was read; a position that was read and is implausible is none either.
    pub is_stale: bool,
    /// The sample is outside the stroke.
    pub is_out_of_range: bool,
    /// The position has been missing for too long.
    pub is_lost: bool,
    /// The axis is driven and does not move.
    pub standing: Option<Standing>,
}

/// The feedback of one axis.
#[derive(Debug, Clone)]
pub struct Feedback {
    period: f64,
    /// Ticks over which the speed is taken.
    speed_ticks: usize,
    /// Missing ticks before a usable position that are too many.
    timeout_ticks: u64,
    /// `None` until the first usable position.
    history: Option<History>,
    /// Ticks since the last usable position.
    blind: u64,
    /// Implausible samples since the last usable position.
    implausible: u64,
    /// How many of the blind ticks the model has filled.
    bridged: u64,
    /// Unusable samples, less the leak.
    unusable: f64,
    motion: Motion,
    /// None where pressures do not damp the load.
    pressure: Option<PressureFeedback>,
}

impl Feedback {
    /// Before the first sample.
    pub fn new(axis: &Axis, timing: &Timing) -> Self {
        let period = timing.period.as_secs_f64();
        Self {
            period,
            speed_ticks: ((SPEED_TIME / period).round() as usize).clamp(1, OUTPUTS - 1),
            timeout_ticks: samples_of(timing.feedback_timeout, timing.period).max(1) as u64,
            history: None,
            blind: 0,
            implausible: 0,
            bridged: 0,
            unusable: 0.0,
            motion: Motion::new(axis, timing),
            pressure: PressureFeedback::of(axis, period),
        }
    }

    /// Forgets the past of the axis.
    pub fn reset(&mut self) {
        self.history = None;
        (self.blind, self.implausible, self.bridged, self.unusable) = (0, 0, 0, 0.0);
    }

    /// The axis begins to follow: samples that were missing while it settled have prolonged that, and count no more.
    pub fn begin(&mut self) {
        self.unusable = 0.0;
    }

    /// Takes in the sample of a tick, `elapsed` ticks after the last one; `command` has been on the valve since.
    pub fn observe(&mut self, elapsed: u64, sample: Option<&AxisSample>, command: f64) -> Observation {
        self.blind = self.blind.saturating_add(elapsed);
        let position = sample.and_then(AxisSample::usable);
        let is_stale = position.is_none() && sample.is_some_and(AxisSample::is_stale);
        let (blind, missing) = (self.blind, self.blind.saturating_sub(1));
        self.unusable = match position {
            Some(_) => (self.unusable - LEAK).max(0.0),
            None if is_stale => self.unusable + (UNUSABLE_LIMIT as f64 / self.timeout_ticks as f64).min(1.0),
            None => self.unusable + 1.0,
        };
        self.implausible += u64::from(position.is_none() && !is_stale);
        let is_unreliable = self.unusable >= LEAKY_LIMIT;
        if let Some(position) = position {
            match &mut self.history {
                None => self.history = Some(History::resting(position)),
                Some(history) => history.push_output(position, missing.saturating_sub(self.bridged)),
            }
            (self.blind, self.implausible, self.bridged) = (0, 0, 0);
        }
        let is_blind = blind >= self.timeout_ticks || self.implausible >= UNUSABLE_LIMIT;
        Observation {
            position,
            missing,
            is_stale,
            is_out_of_range: sample.is_some_and(|sample| sample.faults & sample_fault::RANGE != 0),
            is_lost: is_unreliable || if position.is_some() { missing >= self.timeout_ticks } else { is_blind },
            standing: self.motion.update(elapsed, command, position),
        }
    }

    /// What the pressures of a sample change in the fallback, before [`Self::observe`].
    pub fn damping(&mut self, sample: Option<&AxisSample>) -> Damping {
        let speed = self.speed();
        self.pressure.as_mut().map_or(Damping::NONE, |pressure| pressure.update(sample, speed))
    }

    /// Whether no position has come for so long that references wait for the axis.
    pub fn is_silent(&self) -> bool {
        self.are_too_many(self.blind)
    }

    /// Whether a silence of so many ticks makes references wait.
    pub fn are_too_many(&self, ticks: u64) -> bool {
        ticks > patience(self.period)
    }

    /// Puts `expected` (m) in the place of the position of a blind tick.
    pub fn bridge(&mut self, expected: f64) {
        if let Some(history) = &mut self.history {
            history.push_output(expected, self.blind.saturating_sub(self.bridged + 1));
            self.bridged = self.blind;
        }
    }

    /// The last command stayed on the valve for so many more ticks.
    pub fn hold_command(&mut self, ticks: u64) {
        if let Some(history) = &mut self.history {
            history.hold_command(ticks);
        }
    }

    /// Takes in the command that was sent.
    pub fn push_command(&mut self, command: f64) {
        if let Some(history) = &mut self.history {
            history.push_command(command);
        }
    }

    /// Another command than the last one taken in was on the valve.
    pub fn replace_command(&mut self, command: f64) {
        if let Some(history) = &mut self.history {
            history.replace_command(command);
        }
    }

    /// Past positions and commands; none before the first usable position.
    pub fn history(&self) -> Option<&History> {
        self.history.as_ref()
    }

    /// The newest position, m.
    pub fn position(&self) -> Option<f64> {
        self.history.as_ref().map(|history| history.outputs()[0])
    }

    /// Speed of the axis over the last ticks, m/s.
    pub fn speed(&self) -> f64 {
        self.history.as_ref().map_or(0.0, |history| {
            let ticks = self.speed_ticks;
            (history.outputs()[0] - history.outputs()[ticks]) / (ticks as f64 * self.period)
        })
    }
}
