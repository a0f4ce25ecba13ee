//! Pressure feedback: damps the swing of a load on its spring of oil.
//!
//! ```text
//! F = A_p p_p - A_r p_r          T_F dF_s/dt + F_s = F          v_p = k (F - F_s)          k = 2 zeta_p / (w m)
//! m dv/dt = F - F_load           dF/dt = m w^2 (v_c - v_p - v)
//! ```
//!
//! F force of the cylinder N, of the areas A_p and A_r m2 and the pressures Pa of its chambers; F_s its slow part, which
//! holds the load; v_p speed m/s that is taken off the command; w natural frequency rad/s and m mass kg of the
//! commissioned load, zeta_p `pressure_damping`; v_c speed of the curve and v that of the axis m/s. What accelerates a
//! load shows in the pressures before it shows in its position. The damping ratio is greater by zeta_p, and the load
//! follows the curve by 2 zeta_p / w later. Source: dynamic pressure feedback, Merritt, Hydraulic Control Systems
//! (1967).
//!
//! It never opens a valve: v_p changes an opening by that opening at most ([`super::Fallback::damp`]). Without readings
//! the gains of the fallback are reduced to the gain margin that they have with it.
//!
//! Runs in the loop: nothing here allocates after construction.

use std::f64::consts::TAU;

use pipeline::{
    machine::{Axis, Commissioned, Control, Law},
    message::AxisSample,
};

use crate::margins::{Loop, mean_slope};

/// T_F, s: long beside a swing of 1 Hz, and short beside a change of posture.
const SLOW: f64 = 0.5;

/// What the pressures change in one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Damping {
    /// v_p, m/s.
    pub speed: f64,
    /// Part of kp and ki that is left.
    pub gain: f64,
}

impl Damping {
    /// Of an axis that is not damped by its pressures.
    pub const NONE: Self = Self { speed: 0.0, gain: 1.0 };
}

/// The pressure feedback of one axis.
#[derive(Debug, Clone, PartialEq)]
pub struct PressureFeedback {
    /// A_p and A_r.
    areas: [f64; 2],
    /// k, m/(s N).
    gain: f64,
    /// Part of a new force in F_s.
    new: f64,
    /// F_s; none before the first reading.
    slow: Option<f64>,
    /// Part of the gains without readings.
    without: f64,
}

impl PressureFeedback {
    /// Of an axis whose `pressure_damping` is not 0; `period` in s.
    pub fn of(axis: &Axis, period: f64) -> Option<Self> {
        let (control, plant) = (&axis.control, axis.plant.as_ref()?);
        let model = axis.commissioned.as_ref().filter(|_| control.pressure_damping > 0.0)?;
        Some(Self {
            areas: [plant.piston_area, plant.rod_area],
            gain: 2.0 * control.pressure_damping / (TAU * model.natural_frequency * model.mass),
            new: 1.0 - (-period / SLOW).exp(),
            slow: None,
            without: part_without(control, model, period),
        })
        .map(|feedback| if control.without.damping { Self { areas: [f64::NAN; 2], ..feedback } } else { feedback })
    }

    /// Takes in a sample.
    pub fn update(&mut self, sample: Option<&AxisSample>) -> Damping {
        let pressures = sample.and_then(AxisSample::pressures);
        let force = pressures.map(|(piston, rod)| piston * self.areas[0] - rod * self.areas[1]);
        let Some(force) = force.filter(|force| force.is_finite()) else {
            self.slow = None;
            return Damping { speed: 0.0, gain: self.without };
        };
        let slow = self.slow.get_or_insert(force);
        *slow += self.new * (force - *slow);
        Damping { speed: self.gain * (force - *slow), gain: 1.0 }
    }
}

/// Part of the gains of the fallback that leaves its gain margin where nothing damps the load.
fn part_without(control: &Control, model: &Commissioned, period: f64) -> f64 {
    let margin = |pressure_damping: f64| {
        let fallback = Control { pressure_damping, law: Law::Predictive, ..*control };
        Loop::new(&fallback, model, mean_slope(model), period).margins().gain
    };
    let part = margin(0.0) / margin(control.pressure_damping);
    if part.is_finite() { part.min(1.0) } else { 1.0 }
}
