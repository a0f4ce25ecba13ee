//! Margins of the loop that an axis closes: how much gain and dead time the plant may gain before the loop swings.
//! Never called in the loop: it allocates.
//!
//! | module | what it holds |
//! |---|---|
//! | `plant` | the axis at one slope of its curve, sampled |
//! | `controller` | fallback and Smith predictor as transfer functions |
//! | `response` | the open loop along the unit circle |
//!
//! ```text
//! L(z) = K(z) P(z)          z = exp(j w T)
//! gain margin          1 / |L| where arg L = -180 degrees
//! delay margin         (180 degrees + arg L) / w where |L| = 1
//! largest sensitivity  max |1 / (1 + L)|
//! bandwidth            least w where |L / (1 + L)| < 1 / sqrt 2
//! ```
//!
//! P the plant from a command beyond the dead band to the sampled position, K everything between the measured position
//! and the command, T period in s, w frequency in rad/s. Both are exact in z: the command is held for a period, the
//! dead time need not be a whole number of periods, and the time in which the command is computed is a part of the
//! commissioned dead time. Of several crossings the one with the smallest margin counts. Source: K. J. Astrom and R. M.
//! Murray, Feedback Systems (2008), chapters 9 and 12.
//!
//! K of a Smith predictor contains its model. The margins change the plant alone: the model inside stays as it is, so L
//! is in proportion to the gain of the plant, and a dead time is a factor exp(-j w t) of it. K may be unstable while
//! the loop is not. Whether a loop is stable is therefore counted ([`Loop::is_stable`]) and not read from L.
//!
//! The loop is linear. Limits of that, all measured by simulation, are on the page `commission` of the book: hysteresis
//! and compensation of the dead band swing with an amplitude of their own, and the curve is less steep elsewhere.
//!
//! Trap: a margin of a loop that is unstable is the distance to a stable one. Its gain margin is below 1.

mod controller;
mod plant;
mod response;

use std::f64::consts::{PI, TAU};

use nalgebra::Complex;
use pipeline::machine::{Commissioned, Control, Law, SmithSettings};

use controller::Controller;
use plant::Plant;
pub use plant::{mean_slope, moved, steepest};
use response::{Point, response};

/// Least gain margin that commissioning asks for.
pub const LEAST_GAIN_MARGIN: f64 = 1.7;
/// Least delay margin that commissioning asks for, as a part of the dead time.
pub const LEAST_DELAY_MARGIN: f64 = 0.5;
/// Reaction of an axis, in periods of its swing, up to which its valve shakes it: a slower one closes its loop far
/// below the swing.
pub const FAST_VALVE: f64 = 0.4;
/// A step by which gains are reduced, and the number of gains that are tried: the last is a twentieth of the first.
const REDUCTION: f64 = 0.95;
const REDUCTIONS: i32 = 60;
/// Relative step in gain from a crossing to a loop whose stability is counted.
const ASIDE: f64 = 1e-3;

/// Margins of one loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Margins {
    /// Least factor in the gain of the plant from which on the loop swings; infinite where none does. For an unstable
    /// loop the largest factor below which it is stable, less than 1; 0 where there is none.
    pub gain: f64,
    /// Frequency with which it swings at that factor, Hz; 0 where none does.
    pub swing: f64,
    /// Largest factor below 1 in the gain of the plant from which on the loop swings; 0 where none does.
    pub least_gain: f64,
    /// Additional dead time from which on the loop swings, s; infinite where none does, 0 for an unstable loop.
    pub delay: f64,
    /// [`Self::delay`] as a part of the plant's dead time.
    pub delay_part: f64,
    /// Phase margin, rad; infinite where |L| is never 1, 0 for an unstable loop.
    pub phase: f64,
    /// Ms, the largest sensitivity; infinite for an unstable loop.
    pub sensitivity: f64,
    /// Highest frequency with |L| = 1, Hz; 0 where there is none.
    pub crossover: f64,
    /// Frequency up to which the axis follows to -3 dB, Hz: that of the complementary sensitivity.
    pub bandwidth: f64,
}

impl Margins {
    /// Whether the loop is stable.
    pub fn is_stable(&self) -> bool {
        self.gain > 1.0
    }

    /// Whether the loop keeps [`LEAST_GAIN_MARGIN`] and [`LEAST_DELAY_MARGIN`].
    pub fn is_kept(&self) -> bool {
        self.gain >= LEAST_GAIN_MARGIN && self.delay_part >= LEAST_DELAY_MARGIN
    }
}

/// The linear loop of an axis.
#[derive(Debug, Clone)]
pub struct Loop {
    plant: Plant,
    controller: Controller,
    period: f64,
    /// Of the plant, s.
    dead_time: f64,
}

impl Loop {
    /// The loop of the law of `control`, Smith predictor or fallback, around `model` where its curve has the slope
    /// `gain` m/s per command; `period` in s. Predictive control has no linear loop.
    pub fn new(control: &Control, model: &Commissioned, gain: f64, period: f64) -> Self {
        let controller = match &control.law {
            Law::Smith(settings) => Controller::smith(settings, model, gain, period),
            Law::Predictive => Controller::proportional_integral(control.kp, control.ki),
        };
        Self { plant: Plant::new(&moved(control, model), gain, period), controller, period, dead_time: model.dead_time }
    }

    /// L at a frequency in Hz, from more than 0 to half of the sampling frequency.
    pub fn open(&self, frequency: f64) -> Complex<f64> {
        let z = Complex::from_polar(1.0, TAU * frequency * self.period);
        self.point(z).open()
    }

    /// The parts of the loop at z.
    fn point(&self, z: Complex<f64>) -> Point {
        let (inner, outer) = self.controller.at(z, self.period);
        Point { angle: z.arg(), inner, outer: outer * self.plant.at(z) }
    }

    /// Whether the loop is stable with `gain` times the gain of its plant.
    ///
    /// The closed loop has as many unstable poles as 1 + L_u turns around 0, L_u the loop cut at the command. All poles
    /// of L_u are at rest or stable, also where those of K are not.
    pub fn is_stable(&self, gain: f64) -> bool {
        self.is_stable_along(&response(self), gain)
    }

    fn is_stable_along(&self, points: &[Point], gain: f64) -> bool {
        let values = points.iter().map(|point| point.characteristic(gain));
        let turn = values.clone().zip(values.skip(1)).map(|(from, to)| (to / from).arg()).sum::<f64>();
        let begin = points.first().map_or(0.0, |point| point.characteristic(gain).arg());
        (begin + turn).abs() < 0.5 * PI
    }

    /// The margins of this loop.
    pub fn margins(&self) -> Margins {
        let all = response(self);
        let circle = &all[all.partition_point(|point| point.angle <= 0.0)..];
        let factors = gains(circle);
        if !self.is_stable_along(&all, 1.0) {
            let is_edge = |gain: &f64| *gain <= 1.0 && self.is_stable_along(&all, gain * (1.0 - ASIDE));
            let gains = factors.into_iter().map(|(gain, _)| gain);
            return Margins::unstable(gains.filter(is_edge).fold(0.0, f64::max));
        }
        let (above, below): (Vec<_>, Vec<_>) = factors.into_iter().partition(|(gain, _)| *gain > 1.0);
        let nearest = above.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let (gain, angle) = nearest.unwrap_or((f64::INFINITY, 0.0));
        let crossovers = self.crossovers(circle);
        let delay = crossovers.iter().map(|(w, phase)| phase / w).fold(f64::INFINITY, f64::min);
        let closed = |point: &Point| (point.open() / (point.open() + 1.0)).norm();
        let band = circle.iter().find(|point| closed(point) < 0.5f64.sqrt()).map_or(PI, |point| point.angle);
        Margins {
            gain,
            swing: angle / self.period / TAU,
            least_gain: below.into_iter().map(|(gain, _)| gain).fold(0.0, f64::max),
            delay,
            delay_part: if self.dead_time > 0.0 { delay / self.dead_time } else { f64::INFINITY },
            phase: crossovers.iter().map(|(_, phase)| *phase).fold(f64::INFINITY, f64::min),
            sensitivity: circle.iter().map(|point| 1.0 / (point.open() + 1.0).norm()).fold(0.0, f64::max),
            crossover: crossovers.iter().map(|(w, _)| *w).fold(0.0, f64::max) / TAU,
            bandwidth: band / self.period / TAU,
        }
    }

    /// Frequencies with |L| = 1, rad/s, and how far the phase there is from -180 degrees, rad.
    fn crossovers(&self, circle: &[Point]) -> Vec<(f64, f64)> {
        let of = |pair: &[Point]| {
            let [from, to] = [pair[0].open(), pair[1].open()];
            let (low, high) = (from.norm().ln(), to.norm().ln());
            (low * high <= 0.0 && low != high).then(|| {
                let part = low / (low - high);
                let angle = pair[0].angle + part * (pair[1].angle - pair[0].angle);
                let phase = (-from).arg() + part * (to / from).arg();
                (angle / self.period, phase.rem_euclid(TAU))
            })
        };
        circle.windows(2).filter_map(of).collect()
    }
}

impl Margins {
    /// Of a loop that becomes stable below this part of the plant's gain.
    fn unstable(gain: f64) -> Self {
        Self {
            gain,
            swing: 0.0,
            least_gain: 0.0,
            delay: 0.0,
            delay_part: 0.0,
            phase: 0.0,
            sensitivity: f64::INFINITY,
            crossover: 0.0,
            bandwidth: 0.0,
        }
    }
}

/// Parts of gains that are tried, in steps of 5 %, down to a twentieth.
pub fn parts() -> impl Iterator<Item = f64> {
    (0..REDUCTIONS).map(|n| REDUCTION.powi(n))
}

/// The largest part of both gains of the law of `control`, in steps of 5 %, whose loop passes, and the settings with
/// it. The loop is that around `model` where its curve has the slope `gain` m/s per command; `period` in s. `None`
/// where no part of at least 5 % passes.
pub fn reduced(
    control: &Control,
    model: &Commissioned,
    gain: f64,
    period: f64,
    passes: impl Fn(&Margins) -> bool,
) -> Option<(f64, Control)> {
    let with = |part: f64| match control.law {
        Law::Smith(settings) => {
            let settings = SmithSettings { kp: part * settings.kp, ki: part * settings.ki, ..settings };
            Control { law: Law::Smith(settings), ..*control }
        }
        Law::Predictive => Control { kp: part * control.kp, ki: part * control.ki, ..*control },
    };
    parts()
        .map(|part| (part, with(part)))
        .find(|(_, control)| passes(&Loop::new(control, model, gain, period).margins()))
}

/// Factors in the gain with which L goes through -1, and where on the circle, rad.
fn gains(circle: &[Point]) -> Vec<(f64, f64)> {
    let crossing = |pair: &[Point]| {
        let [from, to] = [pair[0].open(), pair[1].open()];
        if from.im * to.im > 0.0 || from.im == to.im {
            return None;
        }
        let part = from.im / (from.im - to.im);
        let re = from.re + part * (to.re - from.re);
        (re < 0.0).then(|| (-1.0 / re, pair[0].angle + part * (pair[1].angle - pair[0].angle)))
    };
    // At half of the sampling frequency L is real.
    let last = circle.last().map(|point| point.open().re).filter(|re| *re < 0.0).map(|re| (-1.0 / re, PI));
    circle.windows(2).filter_map(crossing).chain(last).collect()
}

#[cfg(test)]
mod tests;
