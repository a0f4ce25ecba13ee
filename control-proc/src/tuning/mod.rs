//! Gains of the fallback, by simulation of what commissioning has found: not for the loop, it allocates.
//!
//! ```text
//! l tau dx/dt + x = u(t - m t_d)                (g, m, l) in (0.7, 1, 1), (1, 1, 1), (1.4, 1.2, 2)
//! d2v/dt2 + 2 zeta w dv/dt + w^2 v = w^2 g c(x)         dy/dt = v
//! J(kp, ki) = mean of (y_r - y)^2 over the judged part of the course, over the three plants
//! ```
//!
//! u command that the fallback makes of the encoder's counts, x spool, v speed in m/s, y position in m, c static curve,
//! tau and t_d of [`Commissioned`], y_r the [`mod@course`] in m; g gain, m dead time and l lag of a plant over those
//! of the commissioned one: with cold oil a valve's lag doubles. w and zeta, [`SPRING`], are the load on its spring of
//! oil, which a static curve behind a lag leaves out: at little dead time it is what limits the gains.
//!
//! The gains are those with the least J among those with which none of the three plants moves by more than [`REST`]
//! while the target stands for long. A grid of factors of two is searched first, then finer and finer around the best.
//!
//! It is fair: a baseline gets the gains that somebody with the same model and much patience would find, on the same
//! course. It is robust: a fast plant with a long dead time asks for low gains, a slow one for high ones, and at rest
//! all three are quiet. It knows nothing of the scenarios.
//!
//! Traps: tuned for the nominal plant alone, gains come out so high that a little more dead time makes them cycle; and
//! tuned without the spring, so high that every heavy axis rings.

pub mod course;

use std::{collections::VecDeque, f64::consts::TAU};

use pipeline::machine::{Axis, COMPENSATED, Commissioned, Control, DeadBand, ModelChoice};

use course::{END, TRAINING, course};

use crate::fallback::Fallback;

/// Motion at rest that is taken for a cycle, peak to peak, m.
pub const REST: f64 = 0.5e-3;
/// Gain, dead time and lag of the plants over those of the model.
pub const PLANTS: [(f64, f64, f64); 3] = [(0.7, 1.0, 1.0), (1.0, 1.0, 1.0), (1.4, 1.2, 2.0)];
/// Natural frequency in Hz and damping ratio of load and oil. A loaded boom of a 20 t machine has some 4 to 6 Hz,
/// lighter axes more; damping of 0.1 to 0.2 is what is usually measured (Merritt, Hydraulic Control Systems, 1967).
pub const SPRING: (f64, f64) = (5.0, 0.15);
/// The last rest goes on for this long, s: slow cycles need time to show.
const LONG_REST: f64 = 20.0;
/// The part of it that is watched for motion, s.
const WATCHED: f64 = 10.0;
/// Longest step of the simulation, s: a small part of the spring's period.
const LONGEST_STEP: f64 = 2.5e-3;

/// What a machine has in the place of a predictive controller.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Baseline {
    /// PI alone.
    Pi,
    /// PI with dead-band compensation.
    DeadBand,
    /// The same with velocity feed-forward.
    Feedforward,
}

impl Baseline {
    /// The settings of `axis` number `index` with this baseline and its tuned gains, for a command every `period` s;
    /// `None` for an axis that nobody has commissioned.
    pub fn tuned(self, index: usize, axis: &Axis, period: f64) -> Option<Control> {
        let bench = Bench::new(index, axis, period)?;
        let control = self.untuned(&axis.control, bench.model);
        // Of a linear loop with the gain of the steepest piece: kp of a fifth to four times of what dead time allows.
        let start = 0.5 / (bench.steepest() * (bench.model.dead_time + bench.model.time_constant + period));
        let mut best = (bench.rated(&control), control);
        let mut consider = |kp: f64, ki: f64| {
            let candidate = Control { kp, ki, ..control };
            let verdict = bench.rated(&candidate);
            if verdict < best.0 {
                best = (verdict, candidate);
            }
            best.1
        };
        let mut at = control;
        for i in -4..=2 {
            let kp = start * 2f64.powi(i);
            for rate in [0.0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6] {
                at = consider(kp, rate * kp);
            }
        }
        for factor in [2f64.powf(0.5), 2f64.powf(0.25), 2f64.powf(0.125)] {
            for (kp, ki) in [(factor, 1.0), (1.0 / factor, 1.0), (1.0, factor), (1.0, 1.0 / factor)] {
                // On in a direction for as long as it is better.
                loop {
                    let before = at;
                    at = consider(before.kp * kp, before.ki * ki);
                    if at == before {
                        break;
                    }
                }
            }
        }
        Some(at)
    }

    /// What it is but for its gains, which are 0.
    fn untuned(self, control: &Control, model: &Commissioned) -> Control {
        let part = if self == Self::Pi { 0.0 } else { COMPENSATED };
        let DeadBand { extend, retract } = model.dead_band;
        Control {
            kp: 0.0,
            ki: 0.0,
            feedforward: self == Self::Feedforward,
            dead_band: DeadBand { extend: part * extend, retract: part * retract },
            model: ModelChoice::None,
            ..*control
        }
    }
}

/// How good gains are; less is better. First comes what moves too much at rest, m, then J, m2.
type Verdict = (f64, f64);

/// The course and the model that gains are tried on.
struct Bench<'a> {
    model: &'a Commissioned,
    resolution: f64,
    period: f64,
    /// y_r tick by tick.
    targets: Vec<f64>,
}

impl<'a> Bench<'a> {
    fn new(index: usize, axis: &'a Axis, period: f64) -> Option<Self> {
        let model = axis.commissioned.as_ref()?;
        let points = course(index, axis.soft_limits, reached(model, axis.control.command_limit));
        let round = crate::target::trajectory::Trajectory::through(points);
        let ticks = ((END - TRAINING + LONG_REST) / period) as usize;
        let targets = (0..ticks).map(|tick| round.position(TRAINING + tick as f64 * period)).collect();
        Some(Self { model, resolution: axis.encoder.resolution, period, targets })
    }

    /// Largest slope of c, m/s.
    fn steepest(&self) -> f64 {
        let slopes = |speeds: &[f64]| {
            let points = self.model.openings.iter().copied().zip(speeds.iter().copied());
            let before = std::iter::once((0.0, 0.0)).chain(points.clone());
            points.zip(before).map(|((x, v), (x_0, v_0))| (v - v_0) / (x - x_0)).fold(0.0, f64::max)
        };
        slopes(&self.model.speeds_extend).max(slopes(&self.model.speeds_retract))
    }

    fn rated(&self, control: &Control) -> Verdict {
        let verdicts = PLANTS.map(|plant| self.simulated(control, plant));
        let excess = verdicts.iter().map(|(motion, _)| (motion - REST).max(0.0)).fold(0.0, f64::max);
        (excess, verdicts.iter().map(|(_, square)| square).sum::<f64>() / PLANTS.len() as f64)
    }

    /// Motion at rest, m, and mean square of the error, m2, of one plant.
    fn simulated(&self, control: &Control, (gain, later, slower): (f64, f64, f64)) -> (f64, f64) {
        let substeps = (self.period / LONGEST_STEP).ceil().max(1.0);
        let step = self.period / substeps;
        let (frequency, damping) = (TAU * SPRING.0, SPRING.1);
        let lag = slower * self.model.time_constant;
        let decay = if lag > 0.0 { (-step / lag).exp() } else { 0.0 };
        let underway = (later * self.model.dead_time / step).round() as usize;
        let mut underway: VecDeque<f64> = std::iter::repeat_n(0.0, underway).collect();
        let mut fallback = Fallback::new(control, Some(self.model), self.period);
        let judged = ((END - TRAINING) / self.period) as usize;
        let watched = self.targets.len() - (WATCHED / self.period) as usize;
        let (mut x, mut speed, mut acceleration) = (0.0, 0.0, 0.0);
        let (mut y, mut command, mut squares) = (self.targets[0], 0.0, 0.0);
        let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
        for (tick, target) in self.targets.iter().enumerate() {
            if tick < judged {
                squares += (target - y) * (target - y);
            }
            if tick >= watched {
                (lowest, highest) = (lowest.min(y), highest.max(y));
            }
            let seen = (y / self.resolution).round() * self.resolution;
            command = fallback.update(target - seen, &self.targets[tick..], command);
            for _ in 0..substeps as usize {
                underway.push_back(command);
                let acting = underway.pop_front().unwrap_or(command);
                x = acting + (x - acting) * decay;
                let lacking = gain * self.model.speed(x) - speed;
                acceleration += (frequency * lacking - 2.0 * damping * acceleration) * frequency * step;
                speed += acceleration * step;
                y += speed * step;
            }
        }
        (highest - lowest, squares / judged as f64)
    }
}

/// The speed that an axis reaches both ways with commands up to `limit`, m/s.
pub fn reached(model: &Commissioned, limit: f64) -> f64 {
    model.speed(limit).min(-model.speed(-limit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{machine, models::commissioned};

    const PERIOD: f64 = 0.01;
    const ALL: [Baseline; 3] = [Baseline::Pi, Baseline::DeadBand, Baseline::Feedforward];

    fn axis(dead_time: f64) -> Axis {
        let mut axis = machine(1).axes.remove(0);
        axis.commissioned = Some(Commissioned { dead_time, ..commissioned() });
        axis
    }

    /// kp and ki by the rules of Skogestad (SIMC, 2003) for an integrator with gain k (m/s per command), dead time and
    /// lag: kp = 1 / (2 k (t_d + T/2 + tau)), ki = kp / (8 (t_d + T/2 + tau)).
    fn by_hand(bench: &Bench) -> (f64, f64) {
        let delay = bench.model.dead_time + 0.5 * PERIOD + bench.model.time_constant;
        let kp = 0.5 / (bench.steepest() * delay);
        (kp, kp / (8.0 * delay))
    }

    #[test]
    fn all_three_plants_are_quiet_at_rest_and_follow_better_than_by_hand() {
        for dead_time in [0.01, 0.15] {
            let axis = axis(dead_time);
            for baseline in ALL {
                let bench = Bench::new(0, &axis, PERIOD).unwrap();
                let tuned = baseline.tuned(0, &axis, PERIOD).unwrap();
                for plant in PLANTS {
                    let (motion, square) = bench.simulated(&tuned, plant);
                    assert!(motion <= REST, "{baseline:?} {dead_time} s {plant:?}: {motion} m at rest");
                    assert!(square.sqrt() < 0.04, "{baseline:?} {dead_time} s {plant:?}: {} m", square.sqrt());
                }
                let (kp, ki) = by_hand(&bench);
                let (tuned, hand) = (bench.rated(&tuned), bench.rated(&Control { kp, ki, ..tuned }));
                println!(
                    "{baseline:?} {dead_time} s: {:.3} mm, by hand {:.3} mm",
                    1e3 * tuned.1.sqrt(),
                    1e3 * hand.1.sqrt()
                );
                assert!(tuned < hand, "{baseline:?} {dead_time} s: {tuned:?}, by hand {hand:?}");
            }
        }
    }

    #[test]
    fn tuning_is_deterministic_and_feed_forward_pays() {
        let axis = axis(0.15);
        let bench = Bench::new(0, &axis, PERIOD).unwrap();
        let errors = ALL.map(|baseline| {
            let tuned = baseline.tuned(0, &axis, PERIOD).unwrap();
            assert_eq!(baseline.tuned(0, &axis, PERIOD), Some(tuned));
            bench.rated(&tuned).1.sqrt()
        });
        assert!(errors[1] < 0.9 * errors[0] && errors[2] < 0.5 * errors[1], "{errors:?}");
    }

    #[test]
    fn gains_that_cycle_are_known_as_such() {
        let axis = axis(0.15);
        let bench = Bench::new(0, &axis, PERIOD).unwrap();
        let tuned = Baseline::DeadBand.tuned(0, &axis, PERIOD).unwrap();
        let (excess, _) = bench.rated(&Control { kp: 4.0 * tuned.kp, ..tuned });
        assert!(excess > 1e-3, "{excess}");
    }

    #[test]
    fn without_a_commissioned_model_there_is_nothing_to_tune_by() {
        assert_eq!(Baseline::Pi.tuned(0, &machine(1).axes[0], PERIOD), None);
    }
}
