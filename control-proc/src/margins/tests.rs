use std::collections::VecDeque;

use pipeline::machine::DeadBand;
use rand_pcg::{Pcg64, rand_core::Rng};

use super::*;
use crate::{
    fallback::{Fallback, learning_time},
    smith::{LastBy, Smith},
    tests::models::commissioned,
};

const GAIN: f64 = 0.8;

/// A straight curve without dead band and hysteresis.
fn straight(dead_time: f64, time_constant: f64, natural_frequency: f64) -> Commissioned {
    Commissioned {
        dead_time,
        time_constant,
        dead_band: DeadBand { extend: 0.0, retract: 0.0 },
        natural_frequency,
        damping: 0.15,
        openings: vec![0.5],
        speeds_extend: vec![0.5 * GAIN],
        speeds_retract: vec![0.5 * GAIN],
        ..commissioned()
    }
}

/// Settings whose limits are never met.
fn control(kp: f64, ki: f64) -> Control {
    let free = Control { command_limit: 1e300, command_rate: 1e300, ..crate::tests::machine(1).axes[0].control };
    Control {
        kp,
        ki,
        feedforward: false,
        dead_band: DeadBand { extend: 0.0, retract: 0.0 },
        law: Law::Predictive,
        ..free
    }
}

fn near(found: f64, expected: f64, part: f64) {
    assert!((found / expected - 1.0).abs() < part, "found {found}, expected {expected}");
}

#[test]
fn an_integrator_with_dead_time_has_the_margins_of_the_textbook() {
    // K g exp(-s L) / s with L = t_d + T/2, the hold: gain margin pi / (2 K g L), crossover K g, phase margin pi/2 -
    // K g L.
    for kp in [1.0, 3.0, 6.0] {
        let (dead_time, period) = (0.2, 1e-3);
        let lag = dead_time + 0.5 * period;
        let margins = Loop::new(&control(kp, 0.0), &straight(dead_time, 0.0, 0.0), GAIN, period).margins();
        near(margins.gain, 0.5 * PI / (kp * GAIN * lag), 2e-3);
        near(margins.phase, 0.5 * PI - kp * GAIN * lag, 2e-3);
        near(margins.delay, margins.phase / (kp * GAIN), 2e-3);
        near(margins.delay_part, margins.delay / dead_time, 1e-9);
        near(margins.crossover, kp * GAIN / TAU, 2e-3);
        assert_eq!(margins.least_gain, 0.0);
    }
}

#[test]
fn a_held_integrator_with_a_delay_of_one_period_is_exact() {
    // y(k+1) = y(k) + g T u(k-1), u = -k y: z^2 - z + k g T = 0, on the unit circle at k g T = 1.
    // Without the delay z - 1 + k g T = 0, on the unit circle at k g T = 2.
    let period = 0.05;
    for (dead_time, edge) in [(0.0, 2.0), (period, 1.0)] {
        let margins = Loop::new(&control(4.0, 0.0), &straight(dead_time, 0.0, 0.0), GAIN, period).margins();
        near(margins.gain, edge / (4.0 * GAIN * period), 1e-3);
    }
}

#[test]
fn a_lag_and_an_integrator_without_dead_time_have_the_sensitivity_of_a_second_order_system() {
    // L = w^2 / (s (s + 2 d w)): |S|^2 = (x^4 + 4 d^2 x^2) / ((1 - x^2)^2 + 4 d^2 x^2), x = frequency by w.
    let (lag, kp) = (0.1, 12.5);
    let (w, d) = ((kp * GAIN / lag).sqrt(), 0.5 / (kp * GAIN * lag).sqrt());
    let square = |x: f64| {
        let damped = 4.0 * d * d * x * x;
        (x.powi(4) + damped) / ((1.0 - x * x).powi(2) + damped)
    };
    let largest = (1..100_000).map(|i| square(1e-3 * f64::from(i))).fold(0.0, f64::max).sqrt();
    let margins = Loop::new(&control(kp, 0.0), &straight(0.0, lag, 0.0), GAIN, 1e-5).margins();
    near(margins.sensitivity, largest, 1e-3);
    // -3 dB of the closed loop: w (1 - 2 d^2 + (4 d^4 - 4 d^2 + 2)^(1/2))^(1/2).
    near(margins.bandwidth * TAU, w * (1.0 - 2.0 * d * d + (4.0 * d.powi(4) - 4.0 * d * d + 2.0).sqrt()).sqrt(), 0.02);
    assert_eq!(margins.delay_part, f64::INFINITY);
}

#[test]
fn an_unstable_loop_has_a_gain_margin_below_one_and_no_delay_margin() {
    let model = straight(0.2, 0.0, 0.0);
    let edge = 0.5 * PI / (GAIN * 0.2005);
    for part in [1.5, 4.0, 20.0] {
        let margins = Loop::new(&control(part * edge, 0.0), &model, GAIN, 1e-3).margins();
        near(margins.gain, 1.0 / part, 2e-3);
        assert!(!margins.is_stable() && margins.delay == 0.0 && margins.sensitivity == f64::INFINITY);
    }
}

#[test]
fn gains_are_reduced_until_the_loop_passes_and_no_further() {
    let (model, period) = (straight(0.2, 0.0, 0.0), 1e-3);
    let edge = 0.5 * PI / (GAIN * 0.2005);
    let smith = |part: f64| {
        let settings = SmithSettings { kp: part * 40.0 * edge, ki: part * 4.0 * edge, observer_time: 0.2 };
        Control { law: Law::Smith(settings), ..control(1.0, 0.0) }
    };
    let fallback = |part: f64| control(part * 4.0 * edge, part * 0.1 * edge);
    for with in [&fallback as &dyn Fn(f64) -> Control, &smith] {
        let is_kept = |control: &Control| Loop::new(control, &model, GAIN, period).margins().is_kept();
        let (part, chosen) = reduced(&with(1.0), &model, GAIN, period, Margins::is_kept).unwrap();
        assert!(part < 1.0 && is_kept(&chosen) && !is_kept(&with(part / REDUCTION)), "{part}");
    }
    let kept = control(0.1 * edge, 0.0);
    assert_eq!(reduced(&kept, &model, GAIN, period, Margins::is_kept), Some((1.0, kept)));
    assert_eq!(reduced(&kept, &model, GAIN, period, |_| false), None);
}

/// Plant in small steps, with a gain and a dead time of its own, and the controller as it runs in the loop.
struct Simulated<'a> {
    control: &'a Control,
    model: &'a Commissioned,
    period: f64,
}

impl Simulated<'_> {
    /// Whether a push grows with `gain` times the gain of the plant and `late` s more of dead time.
    fn swings(&self, gain: f64, late: f64) -> bool {
        let shortest = [self.period, self.model.time_constant, self.model.dead_time].into_iter().fold(1.0, f64::min);
        let substeps = (self.period / (0.05 * shortest).clamp(1e-4, 1e-3)).ceil();
        let step = self.period / substeps;
        let (w, damping) = (TAU * self.model.natural_frequency, self.model.damping);
        let lag = self.model.time_constant - if w > 0.0 { 2.0 * damping / w } else { 0.0 };
        let decay = if lag > 0.0 { (-step / lag).exp() } else { 0.0 };
        let underway = ((self.model.dead_time + late) / step).round() as usize;
        let mut underway: VecDeque<f64> = std::iter::repeat_n(0.0, underway).collect();
        let mut law = Running::new(self);
        let (mut x, mut speed, mut acceleration, mut y, mut command) = (0.0, 0.0, 0.0, 1.0, 0.0);
        let reaction = self.model.reaction() + late + self.period;
        let ticks = (400.0 * reaction / self.period) as usize;
        let mut motion = [0.0f64; 4];
        for tick in 0..ticks {
            command = law.command(y, command);
            let before = y;
            for _ in 0..substeps as usize {
                underway.push_back(command);
                x += (underway.pop_front().unwrap_or(0.0) - x) * (1.0 - decay);
                if w > 0.0 {
                    acceleration += (w * (gain * GAIN * x - speed) - 2.0 * damping * acceleration) * w * step;
                    speed += acceleration * step;
                } else {
                    speed = gain * GAIN * x;
                }
                y += speed * step;
            }
            let part = 4 * tick / ticks;
            motion[part] = motion[part].max((y - before).abs());
            if y.abs() > 1e6 {
                return true;
            }
        }
        motion[3] > motion[2]
    }

    /// Least `at` from which on `swings(at)`, by halving between 0 and `most`; `most` where none does.
    fn edge(&self, most: f64, swings: impl Fn(&Self, f64) -> bool) -> f64 {
        let (mut quiet, mut swinging) = (0.0, most);
        for _ in 0..12 {
            let middle = 0.5 * (quiet + swinging);
            *(if swings(self, middle) { &mut swinging } else { &mut quiet }) = middle;
        }
        0.5 * (quiet + swinging)
    }
}

/// The controllers of the loop, for a reference of 0.
enum Running {
    Fallback(Box<Fallback>),
    Smith(Box<Smith>),
}

impl Running {
    fn new(of: &Simulated) -> Self {
        match Smith::new(of.control, of.model, of.period) {
            Some(smith) => Self::Smith(Box::new(smith)),
            None => Self::Fallback(Box::new(Fallback::new(of.control, Some(of.model), of.period))),
        }
    }

    fn command(&mut self, position: f64, last: f64) -> f64 {
        match self {
            Self::Fallback(fallback) => fallback.update(-position, 0.0, last),
            Self::Smith(smith) => {
                smith.observe(1, position, last);
                smith.update(None, &[0.0], (last, LastBy::Law)).unwrap()
            }
        }
    }
}

/// Loops drawn at random: model, settings and period. Every second one is a Smith predictor, and half of each swing.
fn drawn(count: usize) -> Vec<(Commissioned, Control, f64)> {
    let mut random = Pcg64::new(7, 11);
    let mut draw = |low: f64, high: f64| low * (high / low).powf(random.next_u64() as f64 / u64::MAX as f64);
    let one = |number: usize| {
        let (period, dead_time, lag) = (draw(1e-3, 50e-3), draw(5e-3, 0.5), draw(5e-3, 0.2));
        let swing = draw(3.0, 30.0);
        let mut model = straight(dead_time, lag, if number % 4 < 2 { 0.0 } else { swing });
        if model.natural_frequency > 0.0 {
            model.time_constant += 2.0 * model.damping / (TAU * swing);
        }
        let reaction = model.reaction() + period;
        let (kp, rate) = (draw(0.05, 3.0) / (GAIN * reaction), draw(0.003, 0.2) / reaction);
        let settings = if number.is_multiple_of(2) {
            control(kp, rate * kp)
        } else {
            let settings = SmithSettings { kp, ki: rate * kp, observer_time: model.observer_time(period) };
            Control { law: Law::Smith(settings), ..control(kp, 0.0) }
        };
        (model, settings, period)
    };
    (0..count).map(one).collect()
}

/// Margins by raising gain and dead time until the simulation swings, against those that are computed.
#[test]
fn margins_are_those_at_which_the_simulated_loop_begins_to_swing() {
    let (mut errors, mut unstable) = (Vec::new(), 0);
    for (number, (model, control, period)) in drawn(80).into_iter().enumerate() {
        let of = Loop::new(&control, &model, GAIN, period);
        let margins = of.margins();
        let simulated = Simulated { control: &control, model: &model, period };
        if (0.97..1.03).contains(&margins.gain) {
            continue;
        }
        assert_eq!(simulated.swings(1.0, 0.0), !margins.is_stable(), "{number}: {margins:?}");
        let gain = simulated.edge(2.0 * margins.gain, |loop_, gain| loop_.swings(gain, 0.0));
        errors.push((margins.gain / gain - 1.0, number, "gain"));
        if !margins.is_stable() {
            unstable += 1;
            continue;
        }
        let delay = simulated.edge(2.0 * margins.delay, |loop_, late| loop_.swings(1.0, late));
        errors.push((margins.delay / delay - 1.0, number, "delay"));
    }
    errors.sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    let (middle, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
    println!("{} margins, {unstable} unstable loops: median {middle:?}, worst {worst:?}", errors.len());
    assert!(errors.len() > 140 && unstable >= 5, "{} {unstable}", errors.len());
    assert!(middle.0.abs() < 0.005 && worst.0.abs() < 0.05, "{middle:?} {worst:?}");
}

/// What the fallback learns in motion is an integral with the gain kp/T_l. A loop that keeps the margins that
/// commissioning asks for without it keeps nearly all of them with it.
#[test]
fn learning_in_motion_leaves_nearly_all_of_the_margins() {
    let mut left = Vec::new();
    for (model, with, period) in drawn(400).into_iter().filter(|(_, with, _)| with.law == Law::Predictive) {
        let learns = control(with.kp, with.ki + with.kp / learning_time(&model, period));
        let [without, with] = [with, learns].map(|control| Loop::new(&control, &model, GAIN, period).margins());
        if without.is_kept() {
            left.push((with.gain / LEAST_GAIN_MARGIN, with.delay_part / LEAST_DELAY_MARGIN));
        }
    }
    let least = left.iter().fold((f64::INFINITY, f64::INFINITY), |least, of| (least.0.min(of.0), least.1.min(of.1)));
    println!("{} loops: at least {:.3} of the gain and {:.3} of the delay asked for", left.len(), least.0, least.1);
    assert!(left.len() > 50 && least.0 > 0.95 && least.1 > 0.9, "{} {least:?}", left.len());
}
