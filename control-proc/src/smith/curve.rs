//! The adapted curve, as a shift of the commissioned one.
//!
//! ```text
//! s(v) = N^-1(v/V) - c_h^-1(v)          -0.15 <= s <= 0.15,  fading to 0 for |v| < v_s
//! ```
//!
//! v speed in m/s, N and V curve and speed per unit of x of the adapted model, c_h the commissioned curve at the knots
//! that the adapted model has; v_s [`STILL`]. The adapted curve has few hinges, the commissioned one many points: what
//! the hinges leave out cancels in the difference, and without adaptation s is 0.

use pipeline::machine::{Commissioned, MAX_RESPONSE};

use crate::{
    fallback::feedforward::STILL,
    model::{judge::Approved, response::Ramp},
};

/// Largest shift: more is no change of a machine that may still be driven by its model.
const MOST: f64 = 0.15;
/// Step response that the speed is taken from, in time constants and in ticks.
const SETTLED: f64 = 12.0;
const LEAST_TICKS: f64 = 8.0;

/// The adapted curve of one axis.
#[derive(Debug, Clone)]
pub struct AdaptedCurve {
    /// c_h.
    commissioned: Commissioned,
    /// Ticks after which the step response is a straight line.
    settled: usize,
    period: f64,
}

impl AdaptedCurve {
    /// Of an axis with this commissioned model; `period` in s.
    pub fn new(model: &Commissioned, period: f64) -> Self {
        let ticks = (SETTLED * model.time_constant / period).max(LEAST_TICKS);
        Self { commissioned: model.at_knots(), settled: (ticks as usize).min(MAX_RESPONSE), period }
    }

    /// s for a speed in m/s; 0 for a model that does not move.
    pub fn shift(&self, adapted: &Approved<'_>, speed: f64) -> f64 {
        let gain = Ramp::of(adapted.model, self.settled).slope / self.period;
        let wanted = speed / gain;
        let command = adapted.model.nonlinearity().invert(wanted, adapted.range);
        let shift = command - self.commissioned.command(speed);
        if !wanted.is_finite() || !shift.is_finite() {
            return 0.0;
        }
        shift.clamp(-MOST, MOST) * (speed.abs() / STILL).min(1.0)
    }
}
