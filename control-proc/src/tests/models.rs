//! Models and a machine file for the tests.

use std::time::Duration;

use pipeline::{
    hammerstein::{Coefficients, Structure},
    machine::{Axis, Commissioned, DeadBand},
};

/// A linear model, N(u) = u.
pub fn linear(a: &[f64], b: &[f64], nk: usize) -> Coefficients {
    let mut model = Coefficients::zero(Structure { na: a.len(), nb: b.len() - 1, nk, order: 1, ..Structure::PAPER });
    model.a[..a.len()].copy_from_slice(a);
    model.b[..b.len()].copy_from_slice(b);
    (model.f[0], model.g[0]) = (1.0, 1.0);
    model
}

/// The model of [`super::plant::Actuator`] without a dead band: (1 - z^-1)(1 - 0.8 z^-1), nk = 5, 0.6 m/s at full
/// command.
pub fn actuator() -> Coefficients {
    let mut model = Coefficients::zero(Structure { na: 2, nb: 0, nk: 5, order: 3, ..Structure::PAPER });
    model.a[..2].copy_from_slice(&[-1.8, 0.8]);
    model.b[0] = 0.6 * 0.01 * 0.2;
    (model.f[0], model.g[0]) = (1.0, 1.0);
    model
}

/// The model that a grey box starts from, every `period` s.
pub fn at_knots(commissioned: &Commissioned, period: f64) -> Coefficients {
    let structure =
        commissioned.structure(Structure { na: 2, nb: 0, ..Structure::PAPER }, Duration::from_secs_f64(period));
    let kept = (-period / commissioned.time_constant).exp();
    let mut model = Coefficients::zero(structure);
    model.a[..2].copy_from_slice(&[-1.0 - kept, kept]);
    model.b[0] = period * (1.0 - kept);
    let few = commissioned.at_knots();
    for (slopes, speeds) in [(&mut model.f, &few.speeds_extend), (&mut model.g, &few.speeds_retract)] {
        let (mut x, mut v, mut before) = (0.0, 0.0, 0.0);
        for (i, (opening, speed)) in few.openings.iter().zip(speeds).enumerate() {
            let slope = (speed - v) / (opening - x);
            slopes[i] = slope - before;
            (x, v, before) = (*opening, *speed, slope);
        }
    }
    model
}

/// The commissioned model of an axis with 0.6 m/s at full command, 50 ms of dead time and 45 ms of lag.
pub fn commissioned() -> Commissioned {
    Commissioned {
        dead_time: 0.05,
        time_constant: 0.045,
        dead_band: DeadBand { extend: 0.1, retract: 0.08 },
        hysteresis: 0.0,
        natural_frequency: 0.0,
        damping: 0.2,
        openings: vec![0.1, 0.9],
        speeds_extend: vec![0.06, 0.6],
        speeds_retract: vec![0.07, 0.6],
        largest_tested: [f64::INFINITY; 2],
        overrun: pipeline::machine::Overrun::NONE,
        mass: f64::INFINITY,
        noise: 0.0,
        fit_percent: 100.0,
    }
}

/// Gives an axis a commissioned model without a dead band, with these speeds in m/s at a tenth of the command and at
/// all of it, either way; and feed-forward by it.
pub fn commission_without_dead_band(axis: &mut Axis, speeds: [f64; 2]) {
    let none = DeadBand { extend: 0.0, retract: 0.0 };
    axis.commissioned = Some(Commissioned {
        dead_band: none,
        openings: vec![0.1, 1.0],
        speeds_extend: speeds.to_vec(),
        speeds_retract: speeds.to_vec(),
        ..commissioned()
    });
    (axis.control.dead_band, axis.control.feedforward) = (none, true);
}
