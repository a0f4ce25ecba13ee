//! Gains of the fallback, by simulation of the commissioned model. Never called in the loop: it allocates and takes
//! seconds.
//!
//! | module | what it holds |
//! |---|---|
//! | [`mod@course`] | the course on which controllers are tuned and compared |
//! | [`axis`] | the axis of the simulation |
//! | [`rest`] | margins of the whole loop about a reference that stands |
//!
//! ```text
//! l tau dx/dt + x = H(u(t - m t_d))             (g, m, l) in (0.7, 1, 1), (1, 1, 1), (1.4, 1.2, 2)
//! d2v/dt2 + 2 zeta w dv/dt + w^2 v = w^2 g c(x)         dy/dt = v
//! J(kp, ki) = mean of (y_r - y)^2 over the judged part of the course, over the three plants
//! ```
//!
//! u command that the fallback makes of the encoder's counts, H play of the hysteresis, x spool, v speed in m/s, y
//! position in m, c static curve, tau and t_d of [`Commissioned`], y_r the [`mod@course`] in m; g gain, m dead time and
//! l lag of a plant as multiples of those of the commissioned one: with cold oil the lag of a valve doubles. w and zeta
//! ([`SPRING_FREQUENCY`], [`SPRING_DAMPING`]) are the load on its spring of oil. A static curve behind a lag does not
//! contain this spring, which limits the gains where the dead time is short.
//!
//! The gain of the Smith predictor is twice that of the fallback, or less: its loop comes to rest on the same three
//! plants, and on two more with its margins ([`MARGINS`]). A gain that is chosen by J relies on the plants of this
//! simulation: on drawn machines it was worse than the plain factor.
//!
//! No loop is chosen that is unstable at the mean slope of the curve ([`crate::margins`]): gains of the fallback are
//! reduced, and those of the Smith predictor passed over. An axis that moves steadily shows what J does not, so
//! commissioning reduces the fallback's gains further ([`with_margin`]). The gain of its Smith predictor stays.
//!
//! The gains with the least J are chosen among those with which none of the three plants moves by more than
//! [`RESTING_MOTION`] while the reference stands for long. Where there are none, those with the least motion are. A
//! grid of factors of two is searched first, then finer and finer steps around the best point.
//!
//! The comparison is fair: a baseline gets the gains that a patient engineer with this model would find, on this
//! course. The gains are robust: a fast plant with a long dead time asks for low gains, a slow one for high gains, and
//! at rest all three are quiet. Tuning does not know the scenarios.
//!
//! Traps: if only the nominal plant is used, the gains become so high that a little more dead time makes the loop
//! cycle. Without the spring they become so high that every heavy axis oscillates.

pub mod axis;
pub mod course;
pub mod rest;

use std::f64::consts::TAU;

use pipeline::machine::{Axis, COMPENSATED, Commissioned, Control, DeadBand, Law, ModelChoice, SmithSettings};

use axis::{SimulatedAxis, Swing};
use course::{END, TRAINING, course};

use crate::{
    fallback::Fallback,
    margins::{FAST_VALVE, LEAST_GAIN_MARGIN, Loop, Margins, mean_slope, moved, parts, reduced, steepest},
    smith::{LastBy, Smith},
};

/// Motion at rest from which on the loop cycles, peak to peak, m.
pub const RESTING_MOTION: f64 = 0.5e-3;
/// Fit of a model below which it must not control, percent: the gains are tuned for plants that are slower than the
/// model by up to 30 %, [`PLANTS`]. A model that misses more of the motion says nothing about them.
pub const LEAST_FIT: f64 = 70.0;
/// The plants on which gains are tried: slow, as commissioned, and fast with cold oil.
pub const PLANTS: [Plant; 3] = [
    Plant { gain: 0.7, dead_time: 1.0, lag: 1.0 },
    Plant { gain: 1.0, dead_time: 1.0, lag: 1.0 },
    Plant { gain: 1.4, dead_time: 1.2, lag: 2.0 },
];
/// More plants at which the loop of a Smith predictor comes to rest: the margins that it has in gain and in dead time.
pub const MARGINS: [Plant; 2] =
    [Plant { gain: 1.7, dead_time: 1.0, lag: 1.0 }, Plant { gain: 1.0, dead_time: 1.5, lag: 1.0 }];
/// Gains of the Smith predictor in multiples of the fallback's: the first with which it comes to rest on all plants.
const SMITH_GAINS: [f64; 5] = [2.0, 1.7, 1.4, 1.2, 1.0];
/// What the gain may be more than the fallback's, for each part of t_d/(tau + T): without a dead time there is nothing
/// to predict, and a higher gain only finds what the model does not know.
const PREDICTED: f64 = 2.0;
/// Least t_d/(tau + T) of a Smith predictor. Of 22 drawn machines with less it was worse than the fallback on 14, each
/// in one of four tasks or more, by a factor of up to 3.5.
const LEAST_DEAD_TIME: f64 = 0.3;
/// Error on the plant as commissioned, in parts of that of the fallback, beyond which it is not worth its model.
const WORTH: f64 = 0.9;
/// Least natural frequency of the load that a Smith predictor is used with, Hz. It takes the load for stiff: an axis
/// with 2.4 Hz followed worse by it.
const LEAST_FREQUENCY: f64 = 4.0;
/// Largest ki in parts of kp^2 times the mean slope: with it the poles of s^2 + g kp s + g ki, a PI and an axis that is
/// an integrator, are equal. More of it swings about what the axis does that the model does not have.
const MOST_INTEGRAL: f64 = 0.25;
/// By how much later an axis that is damped by its pressures may answer with its gain margin, in parts of its reaction.
const LATER: f64 = 0.5;
/// Part of the natural frequency that commissioning found to which it falls in another posture, or with a payload.
const SOFTEST: f64 = 0.7;
/// Natural frequency of load and oil where commissioning has found none, Hz: a slower swing would have been seen.
const UNSEEN_FREQUENCY: f64 = 10.0;
/// Natural frequency of load and oil, Hz. A loaded boom of a 20 t machine has some 4 to 6 Hz, lighter axes have more
/// (Merritt, Hydraulic Control Systems, 1967).
pub const SPRING_FREQUENCY: f64 = 5.0;
/// Damping ratio of load and oil; 0.1 to 0.2 is usually measured (Merritt, 1967).
pub const SPRING_DAMPING: f64 = 0.15;
/// Length of the last rest of the course, in s and in reactions of the axis: slow cycles need time to show.
const LONG_REST: (f64, f64) = (20.0, 36.0);
/// The part of it that is watched for motion.
const WATCHED: f64 = 0.5;
/// Longest step of the simulation, s: a small part of the spring's period.
const LONGEST_STEP: f64 = 2.5e-3;
/// First kp of the grid as part of 1 / (gain * delay); the delay is at least [`spring_delay`].
const FIRST_GAIN: f64 = 0.5;
/// Powers of two by which the grid multiplies the first kp. No gain is less: where the dead time is long, the course is
/// followed as well without any, but then nothing brings an axis back that is loaded or slower than its model. The
/// least has a gain margin of 6 on the steepest piece of the curve.
const GAIN_POWERS: std::ops::RangeInclusive<i32> = -1..=2;
/// Ratios of ki to kp on the grid, 1/s.
const RATES: [f64; 7] = [0.0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6];

/// Whether a model misses so much of the motion that it must not control.
pub fn is_poor(model: &Commissioned) -> bool {
    model.fit_percent.is_nan() || model.fit_percent < LEAST_FIT
}

/// A plant, by its ratios to the commissioned model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plant {
    /// Ratio of the gains.
    pub gain: f64,
    /// Ratio of the dead times.
    pub dead_time: f64,
    /// Ratio of the lags.
    pub lag: f64,
}

/// What a machine usually has in the place of a predictive controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Baseline {
    /// PI alone.
    Pi,
    /// PI with dead-band compensation.
    DeadBand,
    /// PI with dead-band compensation and velocity feed-forward.
    Feedforward,
}

impl Baseline {
    /// The settings of `axis` number `index` with this baseline and its tuned gains, for a command every `period` s;
    /// `None` for an axis that is not commissioned.
    pub fn tuned(self, index: usize, axis: &Axis, period: f64) -> Option<Control> {
        let bench = Bench::new(index, axis, period)?;
        let control = self.untuned(&axis.control, bench.model);
        // For a linear loop with the gain of the steepest piece the grid begins far below the gain that delay and
        // spring allow.
        let slowest = (bench.model.reaction() + period).max(spring_delay());
        let start = FIRST_GAIN / (steepest(bench.model) * slowest);
        let mut best = (Rating { excess: f64::INFINITY, square: f64::INFINITY }, control);
        let least = start * 2f64.powi(*GAIN_POWERS.start());
        let mut consider = |kp: f64, ki: f64| {
            let kp = kp.max(least);
            let candidate = Control { kp, ki, ..control };
            let rating = bench.rated(&candidate);
            if rating < best.0 {
                best = (rating, candidate);
            }
            best.1
        };
        let mut at = control;
        for i in GAIN_POWERS {
            let kp = start * 2f64.powi(i);
            for rate in RATES {
                at = consider(kp, rate * kp);
            }
        }
        for factor in [2f64.powf(0.5), 2f64.powf(0.25), 2f64.powf(0.125)] {
            for (kp, ki) in [(factor, 1.0), (1.0 / factor, 1.0), (1.0, factor), (1.0, 1.0 / factor)] {
                // Goes on in a direction as long as the rating becomes better.
                loop {
                    let before = at;
                    at = consider(before.kp * kp, before.ki * ki);
                    if at == before {
                        break;
                    }
                }
            }
        }
        let at = Control { pressure_damping: axis.control.pressure_damping, ..at };
        let stable = reduced(&at, bench.model, mean_slope(bench.model), period, Margins::is_stable);
        Some(stable.map_or(at, |(_, control)| control))
    }

    /// The settings of this baseline with gains of 0.
    fn untuned(self, control: &Control, model: &Commissioned) -> Control {
        let part = if self == Self::Pi { 0.0 } else { COMPENSATED };
        let DeadBand { extend, retract } = model.dead_band;
        Control {
            kp: 0.0,
            ki: 0.0,
            feedforward: self == Self::Feedforward,
            pressure_damping: 0.0,
            // The model has no pump.
            pump_response: 0.0,
            dead_band: DeadBand { extend: part * extend, retract: part * retract },
            model: ModelChoice::None,
            law: Law::Predictive,
            ..*control
        }
    }
}

/// `control` with as much of the fallback's gains as leaves [`LEAST_GAIN_MARGIN`] at the mean slope of the curve of
/// `model`, or all where no part does, and with no more integral than `MOST_INTEGRAL` says; of an axis that is damped
/// by its pressures, where it answers later by half of its reaction. `period` in s.
pub fn with_margin(control: &Control, model: &Commissioned, period: f64) -> Control {
    let slope = mean_slope(model);
    let with = |part: f64| {
        let kp = part * control.kp;
        Control { kp, ki: (part * control.ki).min(MOST_INTEGRAL * kp * kp * slope), ..*control }
    };
    // Pressures that act later than the model says damp less.
    let late = if control.pressure_damping > 0.0 { LATER * (model.reaction() + period) } else { 0.0 };
    let later = Commissioned { dead_time: model.dead_time + late, ..model.clone() };
    let keeps = |of: &Control| {
        let fallback = Control { law: Law::Predictive, ..*of };
        Loop::new(&fallback, &later, slope, period).margins().gain >= LEAST_GAIN_MARGIN
    };
    parts().map(with).find(keeps).unwrap_or_else(|| with(1.0))
}

/// `model` where its load swings most slowly, on a machine whose masses and levers change with its posture: the gain
/// that a swing bears rises with its frequency. A slow valve closes its loop far below the swing.
pub fn softest(model: &Commissioned) -> Commissioned {
    let mut softest = model.clone();
    if model.natural_frequency > 0.0 && model.reaction() * model.natural_frequency <= FAST_VALVE {
        softest.natural_frequency *= SOFTEST;
        softest.time_constant += softest.swing_delay() - model.swing_delay();
    }
    softest
}

/// The Smith predictor for `axis` number `index`, whose fallback has the tuned settings `control`, for a command every
/// `period` s: the integral gain of the fallback, and twice its gain or as much of that as keeps the margins and as the
/// dead time is worth. `None` for an axis that is not commissioned, of a soft load or with hardly any dead time, where
/// no gain keeps them, and where the fallback follows as well.
pub fn smith(index: usize, axis: &Axis, control: &Control, period: f64) -> Option<SmithSettings> {
    let bench = Bench::new(index, axis, period)?;
    // A load without a spring that was found has the frequency 0.
    if (f64::MIN_POSITIVE..LEAST_FREQUENCY).contains(&bench.model.natural_frequency) {
        return None;
    }
    let observer_time = bench.model.observer_time(period);
    let relative_dead_time = bench.model.dead_time / (bench.model.time_constant + period);
    if relative_dead_time < LEAST_DEAD_TIME {
        return None;
    }
    let most = 1.0 + PREDICTED * relative_dead_time;
    let gains = SMITH_GAINS.into_iter().filter(|gain| *gain <= most);
    let settings = gains.map(|gain| SmithSettings { kp: gain * control.kp, ki: control.ki, observer_time });
    let with = |settings| Control { law: Law::Smith(settings), ..*control };
    let keeps_margins = |settings: &SmithSettings| {
        PLANTS.iter().chain(&MARGINS).all(|plant| bench.simulated(&with(*settings), *plant).0 <= RESTING_MOTION)
    };
    let nominal = |control: &Control| bench.simulated(control, PLANTS[1]).1;
    let is_worth = |settings: &SmithSettings| nominal(&with(*settings)) <= WORTH * WORTH * nominal(control);
    let slope = mean_slope(bench.model);
    let has_gain_margin = |settings: &SmithSettings| {
        Loop::new(&with(*settings), bench.model, slope, period).margins().gain >= LEAST_GAIN_MARGIN
    };
    settings.filter(has_gain_margin).find(keeps_margins).filter(is_worth)
}

/// What is tried: the fallback, or a Smith predictor on the commissioned model.
enum Tried {
    Fallback(Box<Fallback>),
    Smith(Box<Smith>),
}

impl Tried {
    fn new(control: &Control, model: &Commissioned, period: f64) -> Self {
        match Smith::new(control, model, period) {
            Some(smith) => Self::Smith(Box::new(smith)),
            None => Self::Fallback(Box::new(Fallback::new(control, Some(model), period))),
        }
    }

    /// The command for references in m, from this tick on, at a measured position in m, after the command `last`.
    fn update(&mut self, references: &[f64], position: f64, last: f64) -> f64 {
        match self {
            Self::Fallback(fallback) => fallback.update(references[0] - position, fallback.forward(references), last),
            Self::Smith(smith) => {
                smith.observe(1, position, last);
                smith.update(None, references, (last, LastBy::Law)).unwrap_or(0.0)
            }
        }
    }
}

/// Positions from tick to tick, m, after the reference has jumped from 0 to `step` m, for `ticks` periods of `period`
/// s: the controller of `control` around its model. It has no preview of the jump, and positions are not rounded to
/// counts.
pub fn step_response(control: &Control, model: &Commissioned, period: f64, step: f64, ticks: usize) -> Vec<f64> {
    let substeps = (period / LONGEST_STEP).ceil().max(1.0);
    let plant = moved(control, model);
    let mut axis = SimulatedAxis::of(&plant, period / substeps);
    let mut tried = Tried::new(control, model, period);
    let mut command = 0.0;
    let tick = |_| {
        let before = axis.position;
        command = tried.update(&[step], before, command);
        (0..substeps as usize).for_each(|_| axis.advance(command));
        before
    };
    (0..ticks).map(tick).collect()
}

/// How good gains are; less is better. The first part counts first.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
struct Rating {
    /// Motion at rest beyond [`RESTING_MOTION`], m.
    excess: f64,
    /// J, m2.
    square: f64,
}

/// The course and the model that gains are tried on.
struct Bench<'a> {
    model: &'a Commissioned,
    resolution: f64,
    period: f64,
    /// The part of the course that is watched for motion, s.
    watched: f64,
    /// y_r tick by tick, m.
    references: Vec<f64>,
}

impl<'a> Bench<'a> {
    fn new(index: usize, axis: &'a Axis, period: f64) -> Option<Self> {
        let model = axis.commissioned.as_ref()?;
        let points = course(index, axis.soft_limits, model.reached(axis.control.command_limit));
        let round = crate::reference::trajectory::Trajectory::through(points);
        let rest = LONG_REST.0.max(LONG_REST.1 * model.reaction());
        let ticks = ((END - TRAINING + rest) / period) as usize;
        let references = (0..ticks).map(|tick| round.position(TRAINING + tick as f64 * period)).collect();
        Some(Self { model, resolution: axis.encoder.resolution, period, watched: WATCHED * rest, references })
    }

    /// Natural frequency of load and oil, Hz. The gains of the fallback hold with the slowest spring; those of a Smith
    /// predictor, which relies on the commissioned model in all, with the one that was found.
    fn frequency(&self, control: &Control) -> f64 {
        match (control.law, self.model.natural_frequency > 0.0) {
            (Law::Predictive, _) => SPRING_FREQUENCY,
            (Law::Smith(_), true) => self.model.natural_frequency,
            (Law::Smith(_), false) => UNSEEN_FREQUENCY,
        }
    }

    fn rated(&self, control: &Control) -> Rating {
        let results = PLANTS.map(|plant| self.simulated(control, plant));
        let excess = results.iter().map(|(motion, _)| (motion - RESTING_MOTION).max(0.0)).fold(0.0, f64::max);
        Rating { excess, square: results.iter().map(|(_, square)| square).sum::<f64>() / PLANTS.len() as f64 }
    }

    /// Motion at rest, m, and mean square of the error, m2, of one plant.
    fn simulated(&self, control: &Control, plant: Plant) -> (f64, f64) {
        let substeps = (self.period / LONGEST_STEP).ceil().max(1.0);
        let step = self.period / substeps;
        let swing = Swing { frequency: TAU * self.frequency(control), damping: SPRING_DAMPING };
        let mut axis = SimulatedAxis::new(self.model, plant, swing, step, self.references[0]);
        let mut tried = Tried::new(control, self.model, self.period);
        let judged = ((END - TRAINING) / self.period) as usize;
        let watched = self.references.len() - (self.watched / self.period) as usize;
        let (mut command, mut squares) = (0.0, 0.0);
        let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
        for (tick, reference) in self.references.iter().enumerate() {
            let y = axis.position;
            if tick < judged {
                squares += (reference - y) * (reference - y);
            }
            if tick >= watched {
                (lowest, highest) = (lowest.min(y), highest.max(y));
            }
            let seen = (y / self.resolution).round() * self.resolution;
            command = tried.update(&self.references[tick..], seen, command);
            for _ in 0..substeps as usize {
                axis.advance(command);
            }
        }
        (highest - lowest, squares / judged as f64)
    }
}

/// 1 / (2 zeta w), s. Behind a valve that acts at once, a load on its spring begins to swing at one by this as kp times
/// the gain from command to speed.
fn spring_delay() -> f64 {
    1.0 / (2.0 * SPRING_DAMPING * TAU * SPRING_FREQUENCY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{machine, models::commissioned};

    const PERIOD: f64 = 0.01;
    const ALL: [Baseline; 3] = [Baseline::Pi, Baseline::DeadBand, Baseline::Feedforward];

    #[test]
    fn a_load_that_is_damped_bears_higher_gains() {
        let fast = Commissioned {
            dead_time: 0.002,
            time_constant: 0.015 + 0.2 / (TAU * 2.5),
            natural_frequency: 2.5,
            damping: 0.1,
            ..commissioned()
        };
        let gains = |pressure_damping: f64| {
            let control = Control { kp: 50.0, ki: 500.0, pressure_damping, ..machine(1).axes[0].control };
            let control = with_margin(&Control { law: Law::Predictive, ..control }, &fast, PERIOD);
            let gain = Loop::new(&control, &fast, mean_slope(&fast), PERIOD).margins().gain;
            assert!(gain >= LEAST_GAIN_MARGIN, "{gain}");
            control.kp
        };
        assert!(gains(0.3) > 2.0 * gains(0.0), "{} {}", gains(0.3), gains(0.0));
    }

    fn axis(dead_time: f64) -> Axis {
        let mut axis = machine(1).axes.remove(0);
        axis.commissioned = Some(Commissioned { dead_time, ..commissioned() });
        axis
    }

    /// kp and ki by the rules of Skogestad (SIMC, 2003) for an integrator with gain k (m/s per command), dead time and
    /// lag: kp = 1 / (2 k (t_d + T/2 + tau)), ki = kp / (8 (t_d + T/2 + tau)).
    fn simc(bench: &Bench) -> (f64, f64) {
        let delay = bench.model.dead_time + 0.5 * PERIOD + bench.model.time_constant;
        let kp = 0.5 / (steepest(bench.model) * delay);
        (kp, kp / (8.0 * delay))
    }

    #[test]
    fn all_three_plants_are_quiet_at_rest_and_follow_better_than_with_simc_gains() {
        for dead_time in [0.01, 0.15] {
            let axis = axis(dead_time);
            for baseline in ALL {
                let bench = Bench::new(0, &axis, PERIOD).unwrap();
                let tuned = baseline.tuned(0, &axis, PERIOD).unwrap();
                for plant in PLANTS {
                    let (motion, square) = bench.simulated(&tuned, plant);
                    assert!(motion <= RESTING_MOTION, "{baseline:?} {dead_time} s {plant:?}: {motion} m at rest");
                    assert!(square.sqrt() < 0.04, "{baseline:?} {dead_time} s {plant:?}: {} m", square.sqrt());
                }
                let (kp, ki) = simc(&bench);
                let (tuned, simc) = (bench.rated(&tuned), bench.rated(&Control { kp, ki, ..tuned }));
                println!(
                    "{baseline:?} {dead_time} s: {:.3} mm, SIMC {:.3} mm",
                    1e3 * tuned.square.sqrt(),
                    1e3 * simc.square.sqrt()
                );
                assert!(tuned < simc, "{baseline:?} {dead_time} s: {tuned:?}, SIMC {simc:?}");
            }
        }
    }

    #[test]
    fn tuning_is_deterministic_and_each_addition_reduces_the_error() {
        let axis = axis(0.15);
        let bench = Bench::new(0, &axis, PERIOD).unwrap();
        let errors = ALL.map(|baseline| {
            let tuned = baseline.tuned(0, &axis, PERIOD).unwrap();
            assert_eq!(baseline.tuned(0, &axis, PERIOD), Some(tuned));
            bench.rated(&tuned).square.sqrt()
        });
        assert!(errors[1] < 0.9 * errors[0] && errors[2] < 0.5 * errors[1], "{errors:?}");
    }

    #[test]
    fn gains_that_cycle_are_recognised() {
        let axis = axis(0.15);
        let bench = Bench::new(0, &axis, PERIOD).unwrap();
        let tuned = Baseline::DeadBand.tuned(0, &axis, PERIOD).unwrap();
        let Rating { excess, .. } = bench.rated(&Control { kp: 4.0 * tuned.kp, ..tuned });
        assert!(excess > 1e-3, "{excess}");
    }

    #[test]
    fn a_fallback_with_margin_has_a_factor_of_1_7_at_the_mean_slope_and_the_smith_predictor_stays() {
        for dead_time in [0.01, 0.15] {
            let axis = axis(dead_time);
            let model = axis.commissioned.as_ref().unwrap();
            let tuned = Baseline::Feedforward.tuned(0, &axis, PERIOD).unwrap();
            let gain_margin = |control: &Control| Loop::new(control, model, mean_slope(model), PERIOD).margins().gain;
            // Four times the gain is surely too much, a tenth surely is not.
            for (factor, is_reduced) in [(4.0, true), (0.1, false)] {
                let law = Law::Smith(SmithSettings { kp: 3.0, ki: 0.1, observer_time: 0.1 });
                let before = Control { kp: factor * tuned.kp, ki: factor * tuned.ki, law, ..tuned };
                let after = with_margin(&before, model, PERIOD);
                assert_eq!(after.kp < before.kp, is_reduced, "{dead_time} s: {} of {}", after.kp, before.kp);
                assert!(gain_margin(&Control { law: Law::Predictive, ..after }) >= LEAST_GAIN_MARGIN, "{dead_time} s");
                let most = MOST_INTEGRAL * after.kp * after.kp * mean_slope(model);
                let expected = (after.kp / before.kp * before.ki).min(most);
                assert!(after.law == law && (after.ki - expected).abs() < 1e-12, "{dead_time} s: {after:?}");
                let more = Control { ki: 10.0 * most, ..after };
                assert!(with_margin(&more, model, PERIOD).ki <= 1.0001 * most, "{dead_time} s");
            }
        }
    }

    #[test]
    fn a_softer_load_has_the_same_lag_and_leaves_less_gain() {
        let mut axis = axis(0.01);
        let model = axis.commissioned.as_mut().unwrap();
        (model.natural_frequency, model.damping) = (2.4, 0.1);
        let softer = softest(model);
        let lag = |model: &Commissioned| model.time_constant - model.swing_delay();
        assert!((lag(&softer) - lag(model)).abs() < 1e-12 && softer.natural_frequency < model.natural_frequency);
        let control =
            Control { kp: 10.0, ..Baseline::Feedforward.untuned(&axis.control, axis.commissioned.as_ref().unwrap()) };
        let gain = |model: &Commissioned| with_margin(&control, model, PERIOD).kp;
        let (as_found, softer) = (gain(axis.commissioned.as_ref().unwrap()), gain(&softer));
        assert!((0.6..0.9).contains(&(softer / as_found)), "{softer} of {as_found}");
    }

    #[test]
    fn the_smith_predictor_keeps_its_margins_and_follows_better_than_the_fallback() {
        for dead_time in [0.05, 0.15] {
            let axis = axis(dead_time);
            let control = Baseline::Feedforward.tuned(0, &axis, PERIOD).unwrap();
            let settings = smith(0, &axis, &control, PERIOD).unwrap();
            assert!(settings.kp >= control.kp && settings.ki == control.ki, "{settings:?}");
            let bench = Bench::new(0, &axis, PERIOD).unwrap();
            let with = Control { law: Law::Smith(settings), ..control };
            for plant in PLANTS.into_iter().chain(MARGINS) {
                let (motion, _) = bench.simulated(&with, plant);
                assert!(motion <= RESTING_MOTION, "{dead_time} s {plant:?}: {motion} m at rest");
            }
            let ratio = (bench.simulated(&with, PLANTS[1]).1 / bench.simulated(&control, PLANTS[1]).1).sqrt();
            assert!(ratio < 0.9, "{dead_time} s: {ratio}");
        }
    }

    #[test]
    fn beside_a_load_that_swings_the_smith_predictor_has_a_gain_margin_of_1_7_at_the_mean_slope() {
        let mut found = 0;
        // At 8.3 Hz and 0.03 no more than 1.0007 is left of twice the gain.
        for (natural_frequency, damping) in [(6.5, 0.03), (8.3, 0.03), (8.3, 0.1), (9.0, 0.03), (11.0, 0.03)] {
            let mut axis = axis(0.07);
            let model = Commissioned {
                dead_time: 0.07,
                time_constant: 0.009,
                natural_frequency,
                damping,
                openings: vec![0.1, 0.5, 0.9],
                speeds_extend: vec![0.03, 0.42, 0.6],
                speeds_retract: vec![0.03, 0.42, 0.6],
                ..commissioned()
            };
            axis.commissioned = Some(model.clone());
            let control = Baseline::Feedforward.tuned(0, &axis, PERIOD).unwrap();
            let Some(settings) = smith(0, &axis, &control, PERIOD) else { continue };
            let with = Control { law: Law::Smith(settings), ..control };
            let margins = Loop::new(&with, &model, mean_slope(&model), PERIOD).margins();
            assert!(margins.gain >= LEAST_GAIN_MARGIN, "{natural_frequency} Hz, {damping}: {}", margins.gain);
            found += 1;
        }
        assert!(found >= 3, "{found}");
    }

    #[test]
    fn after_a_jump_of_the_reference_an_axis_rests_within_what_is_not_compensated() {
        let axis = axis(0.15);
        let control = Baseline::Feedforward.tuned(0, &axis, PERIOD).unwrap();
        let settings = smith(0, &axis, &control, PERIOD).unwrap();
        for law in [Law::Predictive, Law::Smith(settings)] {
            let control = Control { law, ki: 0.0, ..control };
            let positions = step_response(&control, &commissioned(), PERIOD, 0.1, 1000);
            // A tenth of the dead band of 0.1 is left, and the speed that the observer takes for the rest of a motion.
            let left = 0.1 * 0.1 / control.kp;
            let (before, last) = (positions[990], positions[999]);
            assert!((before - last).abs() < 1e-4 && (0.1 - last).abs() < left + 1e-3, "{law:?}: {last} m, {left} m");
        }
    }

    #[test]
    fn an_axis_with_a_long_dead_time_has_gains_that_bring_it_to_its_reference() {
        for dead_time in [0.5, 1.0] {
            let axis = axis(dead_time);
            let model = Commissioned { dead_time, ..commissioned() };
            let control = Baseline::Feedforward.tuned(0, &axis, PERIOD).unwrap();
            let settings = smith(0, &axis, &control, PERIOD).unwrap();
            let gain = control.kp * steepest(&model) * (model.reaction() + PERIOD);
            assert!(gain > 0.249, "{dead_time} s: {gain}");
            for law in [Law::Predictive, Law::Smith(settings)] {
                let control = Control { law, ki: 0.0, ..control };
                let positions = step_response(&control, &model, PERIOD, 0.1, 6000);
                let (left, last) = (0.1 * 0.1 / control.kp, positions[5999]);
                assert!((0.1 - last).abs() < left + 1e-3, "{dead_time} s, {law:?}: {last} m, {left} m");
            }
        }
    }

    #[test]
    fn an_axis_that_reacts_at_once_has_gains_with_which_a_load_on_a_spring_rests() {
        let period = 0.001;
        for dead_time in [0.0, 0.005] {
            let mut axis = axis(dead_time);
            let model = axis.commissioned.as_mut().unwrap();
            (model.time_constant, model.hysteresis) = (0.001, 0.01);
            axis.encoder.resolution = 1e-5;
            let bench = Bench::new(0, &axis, period).unwrap();
            let tuned = Baseline::Feedforward.tuned(0, &axis, period).unwrap();
            for plant in PLANTS {
                let (motion, _) = bench.simulated(&tuned, plant);
                assert!(motion <= RESTING_MOTION, "{dead_time} s {plant:?}: {motion} m at rest with kp {}", tuned.kp);
            }
        }
    }

    #[test]
    fn without_a_dead_time_the_gain_is_no_higher_than_the_fallbacks() {
        for (dead_time, most) in [(1e-3, 1.0), (0.01, 1.4)] {
            let axis = axis(dead_time);
            let control = Baseline::Feedforward.tuned(0, &axis, PERIOD).unwrap();
            let gain = smith(0, &axis, &control, PERIOD).map_or(1.0, |settings| settings.kp / control.kp);
            assert!(gain <= most + 1e-9, "{dead_time} s: {gain}");
        }
    }

    #[test]
    fn a_soft_load_is_left_to_the_fallback() {
        let mut axis = axis(0.15);
        let control = Baseline::Feedforward.tuned(0, &axis, PERIOD).unwrap();
        axis.commissioned.as_mut().unwrap().natural_frequency = 3.9;
        assert_eq!(smith(0, &axis, &control, PERIOD), None);
    }

    #[test]
    fn without_a_commissioned_model_there_are_no_tuned_gains() {
        assert_eq!(Baseline::Pi.tuned(0, &machine(1).axes[0], PERIOD), None);
    }
}
