//! The axis at one slope of its curve, sampled.
//!
//! ```text
//! G(s) = g exp(-s t_d) / (s (tau_v s + 1)) w^2 / (s^2 + 2 zeta w s + w^2)          tau_v = tau - 2 zeta / w
//! P(z) = sum_i r_i z^-n (exp(p_i (T - d)) f(p_i, d) / z + f(p_i, T - d)) / (z - exp(p_i T))
//! f(p, t) = (exp(p t) - 1) / p,  t for p = 0          t_d = n T + d,  0 <= d < T
//! ```
//!
//! g slope of the static curve in m/s per command, t_d dead time and tau time constant in s, w natural frequency in
//! rad/s and zeta damping of the load, of [`Commissioned`]; the swing's delay 2 zeta / w is a part of tau, and without
//! a swing G ends after the lag. p_i and r_i poles and residues of G without its dead time. The command is held for a
//! period of T s, and P is exact at the samples. Source: K. J. Astrom and B. Wittenmark, Computer-Controlled Systems
//! (1997), section 2.3 (sampling of a system with a delay).

use std::f64::consts::TAU;

use nalgebra::Complex;
use pipeline::machine::{Commissioned, Control, Law};

/// Largest damping ratio: at 1 both poles of the swing are equal and have no residues.
const MOST_DAMPING: f64 = 0.999;

/// P.
#[derive(Debug, Clone)]
pub struct Plant {
    modes: Vec<Mode>,
    /// n.
    ticks: i32,
}

/// One pole of G as a part of P.
#[derive(Debug, Clone, Copy)]
struct Mode {
    /// exp(p T).
    pole: Complex<f64>,
    /// r f(p, T - d).
    first: Complex<f64>,
    /// r exp(p (T - d)) f(p, d).
    second: Complex<f64>,
}

/// The axis as the law of `control` moves it: the fallback damps its load.
pub fn moved(control: &Control, model: &Commissioned) -> Commissioned {
    model.damped(if control.law == Law::Predictive { control.pressure_damping } else { 0.0 })
}

/// Largest slope of the static curve beyond the dead bands, m/s per command.
pub fn steepest(model: &Commissioned) -> f64 {
    let slopes = |speeds: &[f64]| {
        let points = model.openings.iter().copied().zip(speeds.iter().copied());
        let before = std::iter::once((0.0, 0.0)).chain(points.clone());
        points.zip(before).map(|((x, v), (x_0, v_0))| (v - v_0) / (x - x_0)).fold(0.0, f64::max)
    };
    slopes(&model.speeds_extend).max(slopes(&model.speeds_retract))
}

/// Mean slope of the static curve, m/s per command: the line from the dead band to the largest tested opening, in the
/// mean of both directions. It is the gain for a swing around rest that uses all of the tested range.
pub fn mean_slope(model: &Commissioned) -> f64 {
    let last = |values: &[f64]| values.last().copied().unwrap_or_default();
    0.5 * (last(&model.speeds_extend) + last(&model.speeds_retract)) / last(&model.openings)
}

impl Plant {
    /// Of this model where its curve has the slope `gain` m/s per command, with a command every `period` s.
    pub fn new(model: &Commissioned, gain: f64, period: f64) -> Self {
        let poles = poles(model);
        let ticks = (model.dead_time / period).floor();
        let late = model.dead_time - ticks * period;
        let mode = |pole: Complex<f64>| {
            let others = || poles.iter().filter(|other| **other != pole);
            let at_rest = pole.norm() == 0.0;
            let scale = others().filter(|other| other.norm() > 0.0).map(|other| -other).product::<Complex<f64>>();
            let own = if at_rest { Complex::from(1.0) } else { -pole };
            let residue = scale * own * gain / others().map(|other| pole - other).product::<Complex<f64>>();
            let held = |time: f64| if at_rest { Complex::from(time) } else { ((pole * time).exp() - 1.0) / pole };
            Mode {
                pole: (pole * period).exp(),
                first: residue * held(period - late),
                second: residue * (pole * (period - late)).exp() * held(late),
            }
        };
        Self { modes: poles.iter().map(|pole| mode(*pole)).collect(), ticks: ticks as i32 }
    }

    /// P(z).
    pub fn at(&self, z: Complex<f64>) -> Complex<f64> {
        let sum: Complex<f64> = self.modes.iter().map(|mode| (mode.second / z + mode.first) / (z - mode.pole)).sum();
        sum * z.powi(-self.ticks)
    }
}

/// The poles of G without its dead time, 1/s.
fn poles(model: &Commissioned) -> Vec<Complex<f64>> {
    let (frequency, damping) = (TAU * model.natural_frequency, model.damping.min(MOST_DAMPING));
    let mut poles = vec![Complex::from(0.0)];
    let mut lag = model.time_constant;
    if frequency > 0.0 {
        let swing = Complex::new(-damping, (1.0 - damping * damping).sqrt()) * frequency;
        poles.extend([swing, swing.conj()]);
        lag -= 2.0 * damping / frequency;
    }
    if lag > 0.0 {
        poles.push(Complex::from(-1.0 / lag));
    }
    poles
}
