//! What the forces of a coming motion take of the speed of an axis that stands on its oil.
//!
//! ```text
//! F   = M(q) dv/dt + h(q, v)          G = F_i - m dv_i/dt          T_F dG_s/dt + G_s = G
//! v_F = dF_i/dt / (m w^2) + 2 zeta_p / (m w) (G - G_s)
//! ```
//!
//! q, v and dv/dt positions in m, speeds and accelerations of the references of all axes at t + t_d + tau + T/2, when a
//! command of now acts; M mass matrix and h load of the mechanism, F forces of the cylinders in N, i number of the
//! axis; m mass in kg, w natural frequency in rad/s and zeta_p pressure damping of the axis, T_F [`SLOW`]. A force that
//! rises presses the oil together, and what goes into that is missing in the speed. And the pressure feedback takes the
//! forces that the other axes need for their motion for a swing. Those of its own acceleration are in the delay of the
//! swing, 2 (zeta + zeta_p) / w, by which the feed-forward leads.
//!
//! Trap: the damping ratio that commissioning finds has part of the valve's lag in it. It must not be counted like
//! zeta_p: an arm that begins to move without a load then starts late.
//!
//! Runs in the loop: nothing here allocates after construction.

use std::f64::consts::TAU;

use mechanism::{AXES, CylinderDynamics};
use pipeline::machine::Axis;

use super::SLOW;

/// The forces of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forces {
    /// t_d + tau + T/2 in ticks.
    lead: f64,
    /// m w^2, N/m.
    stiffness: f64,
    /// 2 zeta_p / (m w), m/(s N).
    damping: f64,
    /// m, kg.
    mass: f64,
    /// G_s, N; none before the first force.
    slow: Option<f64>,
    /// Part of a new force in G_s.
    new: f64,
    /// T, s.
    period: f64,
}

impl Forces {
    /// Of an axis with feed-forward of which a swing was found; `period` in s.
    pub fn of(axis: &Axis, period: f64) -> Option<Self> {
        let control = &axis.control;
        let model = axis.commissioned.as_ref().filter(|_| control.feedforward && !control.without.load)?;
        if model.natural_frequency <= 0.0 || !model.mass.is_finite() {
            return None;
        }
        let w = TAU * model.natural_frequency;
        let ratio = control.damping_in_use();
        Some(Self {
            lead: model.damped(ratio).reaction() / period + 0.5,
            stiffness: model.mass * w * w,
            damping: model.opposing_speed(ratio),
            mass: model.mass,
            slow: None,
            new: 1.0 - (-period / SLOW).exp(),
            period,
        })
    }

    /// Number of coming ticks whose references are used.
    pub fn ahead(&self) -> usize {
        self.lead as usize + 3
    }

    /// v_F of axis `i`, m/s, from references (m) that begin with the last tick, and the mechanism at positions (m) and
    /// speeds (m/s) of its cylinders; 0 while those of one axis are not known.
    pub fn update(
        &mut self,
        i: usize,
        references: &[Option<&[f64]>; AXES],
        dynamics: impl Fn(&[f64; AXES], &[f64; AXES]) -> CylinderDynamics,
    ) -> f64 {
        if references.iter().any(Option::is_none) {
            self.slow = None;
            return 0.0;
        }
        let at = |j: usize, tick: usize| {
            references[j].and_then(|of| of.get(tick).or(of.last())).copied().unwrap_or_default()
        };
        let forces = |tick: usize| {
            let positions = std::array::from_fn(|j| at(j, tick));
            let speeds = std::array::from_fn(|j| (at(j, tick + 1) - at(j, tick - 1)) / (2.0 * self.period));
            let acceleration =
                |j: usize| (at(j, tick + 1) - 2.0 * at(j, tick) + at(j, tick - 1)) / (self.period * self.period);
            let CylinderDynamics { mass, load } = dynamics(&positions, &speeds);
            let force = load[i] + (0..AXES).map(|j| mass[i][j] * acceleration(j)).sum::<f64>();
            (force, force - self.mass * acceleration(i))
        };
        // The present tick is the second one of these references.
        let tick = self.lead as usize + 1;
        let ((force, other), (next_force, next_other)) = (forces(tick), forces(tick + 1));
        let other = other + self.lead.fract() * (next_other - other);
        let slow = self.slow.get_or_insert(other);
        *slow += self.new * (other - *slow);
        let fast = other - *slow;
        let speed = (next_force - force) / (self.period * self.stiffness) + self.damping * fast;
        if !speed.is_finite() {
            self.slow = None;
            return 0.0;
        }
        speed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::machine::Machine;

    const PERIOD: f64 = 0.01;

    /// The forces of the boom of the built-in excavator.
    fn boom(change: impl Fn(&mut Axis)) -> Option<Forces> {
        let mut axis = Machine::load(None, &[]).unwrap().axes.remove(0);
        change(&mut axis);
        Forces::of(&axis, PERIOD)
    }

    /// v_F of the boom in every tick while it moves by `own` m and the arm by `other` m, of tick numbers. It feels
    /// its own mass, a tenth of that from the arm, and a spring of so many N/m.
    fn speeds(forces: &mut Forces, spring: f64, own: impl Fn(f64) -> f64, other: impl Fn(f64) -> f64) -> Vec<f64> {
        let mass = forces.mass;
        let dynamics = |positions: &[f64; AXES], _: &[f64; AXES]| {
            let mut all = CylinderDynamics { mass: [[0.0; AXES]; AXES], load: [spring * positions[0], 0.0, 0.0, 0.0] };
            (all.mass[0][0], all.mass[0][1]) = (mass, 0.1 * mass);
            all
        };
        let ahead = forces.ahead();
        let ticks =
            |of: &dyn Fn(f64) -> f64, k: usize| -> Vec<f64> { (0..=ahead).map(|i| of((k + i) as f64)).collect() };
        (0..300)
            .map(|k| {
                let (one, two) = (ticks(&own, k), ticks(&other, k));
                forces.update(0, &[Some(&one), Some(&two), Some(&[0.0]), Some(&[0.0])], dynamics)
            })
            .collect()
    }

    #[test]
    fn forces_that_rise_press_the_oil_together() {
        let mut forces = boom(|_| {}).unwrap();
        assert_eq!(forces.damping, 0.0, "without transducers");
        // A steady speed against a spring: dF/dt = 1e5 N/m 0.2 m/s.
        let steady = speeds(&mut forces, 1e5, |tick| 0.002 * tick, |_| 0.5);
        let expected = 1e5 * 0.2 / forces.stiffness;
        assert!(steady.iter().all(|speed| (speed / expected - 1.0).abs() < 1e-6), "{steady:?}");
        // The arm is accelerated more and more, by 1 m/s3.
        let jerk = speeds(&mut forces, 0.0, |_| 0.5, |tick| (tick * PERIOD).powi(3) / 6.0);
        let expected = 0.1 * forces.mass / forces.stiffness;
        assert!(jerk.iter().all(|speed| (speed / expected - 1.0).abs() < 1e-6), "{jerk:?}");
    }

    #[test]
    fn what_the_pressure_feedback_takes_for_a_swing_of_other_axes_is_made_good() {
        let forces = boom(|axis| axis.control.pressure_damping = 0.3).unwrap();
        assert!(forces.damping > 0.0);
        // From tick 100 on with 1 m/s2: first G is all fast, 0.5 s later a third of it.
        let begins = |tick: f64| 0.5 * (PERIOD * (tick - 100.0).max(0.0)).powi(2);
        let by_arm = speeds(&mut { forces }, 0.0, |_| 0.5, begins);
        let (tick, whole) = (100 - forces.lead as usize, forces.damping * 0.1 * forces.mass);
        assert!((by_arm[tick] / whole - 1.0).abs() < 0.1, "{} {whole}", by_arm[tick]);
        assert!((by_arm[tick + 50] / whole - (-1.0f64).exp()).abs() < 0.02, "{} {whole}", by_arm[tick + 50]);
        // Its own acceleration is not among these.
        let by_itself = speeds(&mut { forces }, 0.0, begins, |_| 0.5);
        assert!(by_itself[tick + 50].abs() < 0.02 * whole, "{}", by_itself[tick + 50]);
    }

    #[test]
    fn without_a_swing_a_reference_or_a_pose_nothing_is_taken() {
        let swing = |axis: &mut Axis, frequency: f64| axis.commissioned.as_mut().unwrap().natural_frequency = frequency;
        assert_eq!(boom(|axis| swing(axis, 0.0)), None);
        assert_eq!(boom(|axis| axis.control.without.load = true), None);
        assert_eq!(boom(|axis| axis.control.feedforward = false), None);
        let mut forces = boom(|_| {}).unwrap();
        let none = |_: &[f64; AXES], _: &[f64; AXES]| panic!("nothing to work out");
        assert_eq!(forces.update(0, &[None, Some(&[0.1]), Some(&[0.1]), Some(&[0.1])], none), 0.0);
        let all = [Some([0.1].as_slice()); AXES];
        let open =
            |_: &[f64; AXES], _: &[f64; AXES]| CylinderDynamics { mass: [[f64::NAN; AXES]; AXES], load: [0.0; AXES] };
        assert_eq!(forces.update(0, &all, open), 0.0);
        assert_eq!(forces.slow, None);
    }
}
