//! The load on its spring of oil, between the speed of the curve and the speed of the axis.
//!
//! ```text
//! d2v/dt2 + 2 zeta w dv/dt + w^2 v = w^2 v_c          v(t+s) = v_c + e (v - v_c) + f dv/dt,  both for constant v_c
//! ```
//!
//! v_c speed of the static curve and v that of the axis, m/s; w natural frequency rad/s, zeta damping ratio below 1.
//! Source: Merritt, Hydraulic Control Systems (1967); the step is the exact solution of the equation.
//!
//! Trap: without the spring a search explains an axis that overshoots by a dead time that is too long and a lag that is
//! too short.

use std::f64::consts::TAU;

use pipeline::machine::Commissioned;

/// Shortest period that is told from a stiff load, s, and longest one that is searched.
const PERIODS: std::ops::RangeInclusive<f64> = 0.04..=1.0;
/// Damping ratios that are searched.
const DAMPINGS: std::ops::RangeInclusive<f64> = 0.01..=0.9;

/// Natural period and damping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Spring {
    /// 2 pi / w, s; 0 for a stiff load.
    pub period: f64,
    /// zeta.
    pub damping: f64,
}

/// Several loads on equal springs: their ways, speeds and accelerations.
pub(super) struct Motion<const N: usize> {
    /// Speed and acceleration a step later, of a unit of v - v_c and of a unit of dv/dt; none for stiff loads.
    spring: Option<[[f64; 2]; 2]>,
    /// Half a step, s.
    half: f64,
    ways: [f64; N],
    speeds: [f64; N],
    accelerations: [f64; N],
    /// Stiff loads whose speeds are 0.
    stand: bool,
}

impl Spring {
    /// Whether it is in the ranges that are searched.
    pub fn is_allowed(self) -> bool {
        self.period == 0.0 || (PERIODS.contains(&self.period) && DAMPINGS.contains(&self.damping))
    }

    /// That of a commissioned model.
    pub fn of_model(model: &Commissioned) -> Self {
        Self { period: model.swing_period(), damping: model.damping }
    }

    /// w / 2 pi, Hz; 0 for a stiff load.
    pub fn frequency(self) -> f64 {
        if self.period > 0.0 { 1.0 / self.period } else { 0.0 }
    }

    /// By how much the way lags behind that of a stiff load at a steady rise of the speed, 2 zeta / w, s.
    pub fn delay(self) -> f64 {
        2.0 * self.damping * self.period / TAU
    }

    /// Loads at rest that are moved in steps of `step` s.
    pub fn motion<const N: usize>(self, step: f64) -> Motion<N> {
        let spring = (self.period > 0.0).then(|| {
            let w = TAU / self.period;
            let (decay, damped) = (self.damping * w, w * (1.0 - self.damping * self.damping).sqrt());
            let (sin, cos) = (damped * step).sin_cos();
            let (e, s) = ((-decay * step).exp(), sin / damped);
            [[e * (cos + decay * s), e * s], [-e * w * w * s, e * (cos - decay * s)]]
        });
        let zeros = [0.0; N];
        Motion { spring, half: 0.5 * step, ways: zeros, speeds: zeros, accelerations: zeros, stand: spring.is_none() }
    }
}

impl<const N: usize> Motion<N> {
    /// The ways so far.
    pub fn ways(&self) -> &[f64; N] {
        &self.ways
    }

    /// Moves on for a step with these speeds of the curve; none where the valve is shut.
    #[inline]
    pub fn advance(&mut self, curve: Option<&[f64; N]>) {
        let Self { half, ways, speeds, accelerations, .. } = self;
        let is_shut = curve.is_none();
        if is_shut && self.stand {
            return;
        }
        let curve = curve.unwrap_or(&[0.0; N]);
        // One lap for all: what is kept between two of them costs more than what is worked out.
        if let Some([[vv, va], [av, aa]]) = self.spring {
            for i in 0..N {
                let (lacking, before) = (speeds[i] - curve[i], accelerations[i]);
                let now = curve[i] + vv * lacking + va * before;
                ways[i] += *half * (speeds[i] + now);
                (speeds[i], accelerations[i]) = (now, av * lacking + aa * before);
            }
        } else {
            for ((way, speed), curve) in ways.iter_mut().zip(speeds).zip(curve) {
                *way += *half * (*speed + curve);
                *speed = *curve;
            }
            self.stand = is_shut;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_overshoots_by_the_closed_form_and_settles() {
        let mut motion = Spring { period: 0.2, damping: 0.2 }.motion::<1>(0.001);
        let speeds: Vec<f64> = (0..5000)
            .map(|_| {
                motion.advance(Some(&[1.0]));
                motion.speeds[0]
            })
            .collect();
        let highest = speeds.iter().copied().fold(0.0, f64::max);
        let overshoot = (-0.2 * std::f64::consts::PI / (1.0f64 - 0.04).sqrt()).exp();
        assert!((highest - 1.0 - overshoot).abs() < 1e-3, "{highest}");
        assert!((speeds[4999] - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_stiff_load_moves_as_the_curve_says() {
        let mut motion = Spring { period: 0.0, damping: 0.2 }.motion::<2>(0.001);
        for (curve, ways) in [(Some([0.3, -0.1]), [1.5e-4, -5e-5]), (None, [3e-4, -1e-4]), (None, [3e-4, -1e-4])] {
            motion.advance(curve.as_ref());
            for (way, expected) in motion.ways().iter().zip(ways) {
                assert!((way - expected).abs() < 1e-15, "{curve:?} {way} {expected}");
            }
        }
    }
}
