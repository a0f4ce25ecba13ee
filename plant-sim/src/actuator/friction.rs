//! Friction of the piston: the LuGre model.
//!
//! ```text
//! dz/dt = c (v - r z)         r = sigma_0 |v|/g(v)         g(v) = F_c + (F_s - F_c)/(1 + (v/v_s)^2)
//! F     = sigma_0 z + sigma_1 dz/dt + B_p v                c    = min(1, 1/(r tau_z))
//! ```
//!
//! z mean deflection of the bristles, m; v speed, m/s; F force against the motion, N; sigma_0 stiffness of the
//! bristles, N/m; sigma_1 damping of the bristles, N s/m; F_c Coulomb friction, N; F_s static friction, N; v_s Stribeck
//! speed, m/s; B_p viscous friction as in equation (9), N s/m; r rate at which the bristles forget their deflection,
//! 1/s. In steady motion sigma_0 z = g sign(v).
//!
//! The factor c is not part of the LuGre model. It limits r to 1/tau_z = 10 000 1/s, which the built-in boom reaches at
//! 1.3 m/s. Up to that rate c is 1. At that rate the bristles have turned over after a tenth of a millimetre; faster
//! bristles would only need a shorter step.
//!
//! Sources: Canudas de Wit, Olsson, Astrom and Lischinsky, 1995, for the model; Hess and Soom, 1990, for g. Other
//! authors have exp(-(v/v_s)^2) in place of the fraction in g. Both agree at rest and at high speed, and the fraction
//! needs no exponential.
//!
//! Traps: at rest the bristles hold the load like a spring, so the piston does not creep; with a sign function smoothed
//! by tanh it would. Friction must not add energy to the motion: F v >= d/dt (sigma_0 z^2/2) holds for every motion if
//! sigma_1 (F_s - F_c) <= B_p F_c (Barabanov and Ortega, 2000). The machine file is refused where that is violated.

use pipeline::machine::Plant;

use crate::lanes::{LANES, Lanes, lanes};

/// Least value of F_c and F_s, N: it prevents a division by zero for an axis without friction.
const LEAST_FRICTION: f64 = 1e-6;

/// 1/tau_z, 1/s: the largest rate at which bristles follow the motion.
pub const FASTEST_BRISTLES: f64 = 1e4;

/// Friction of one axis (`T = f64`) or of four (`T = Lanes`).
#[derive(Debug, Clone, Copy)]
pub struct Friction<T> {
    /// F_c, N.
    pub coulomb: T,
    /// F_s, N.
    pub static_friction: T,
    /// 1/v_s^2, s2/m2.
    pub stribeck: T,
    /// sigma_0, N/m.
    pub stiffness: T,
    /// sigma_1, N s/m.
    pub damping: T,
    /// B_p, N s/m.
    pub viscous: T,
}

impl Friction<f64> {
    /// Friction of `plant`. All of it is multiplied by `dry`, viscous friction by `viscous` as well.
    ///
    /// sigma_1 is multiplied by `viscous` only where that is less than 1, so that friction stays passive.
    pub fn new(plant: &Plant, dry: f64, viscous: f64) -> Self {
        Self {
            coulomb: (plant.coulomb_friction * dry).max(LEAST_FRICTION),
            static_friction: (plant.static_friction * dry).max(LEAST_FRICTION),
            stribeck: plant.stribeck_speed.powi(-2),
            stiffness: plant.bristle_stiffness * dry,
            damping: plant.bristle_damping * dry * viscous.min(1.0),
            viscous: plant.viscous_friction * dry * viscous,
        }
    }
}

impl Friction<Lanes> {
    /// Puts four axes side by side.
    pub fn pack(axes: &[Friction<f64>; LANES]) -> Self {
        Self {
            coulomb: lanes(axes, |f| f.coulomb),
            static_friction: lanes(axes, |f| f.static_friction),
            stribeck: lanes(axes, |f| f.stribeck),
            stiffness: lanes(axes, |f| f.stiffness),
            damping: lanes(axes, |f| f.damping),
            viscous: lanes(axes, |f| f.viscous),
        }
    }

    /// F, force against the motion, N, and dz/dt, rate of the bristles' deflection, m/s.
    #[inline]
    pub fn force(&self, velocity: Lanes, deflection: Lanes) -> (Lanes, Lanes) {
        let e = velocity * velocity * self.stribeck;
        // r, where 1/g is written as one fraction.
        let forgetting = self.stiffness * velocity.abs() * (Lanes::ONE + e) / (self.static_friction + self.coulomb * e);
        // c. At rest the quotient is infinite, and c is 1.
        let limit = (Lanes::splat(FASTEST_BRISTLES) / forgetting).fast_min(Lanes::ONE);
        let rate = limit * (velocity - forgetting * deflection);
        (self.stiffness * deflection + self.damping * rate + self.viscous * velocity, rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOOM: Friction<f64> =
        Friction { coulomb: 4e3, static_friction: 7e3, stribeck: 1e4, stiffness: 3e7, damping: 2e4, viscous: 20e3 };

    fn force(velocity: f64, deflection: f64) -> (f64, f64) {
        let (force, rate) = Friction::pack(&[BOOM; LANES]).force(Lanes::splat(velocity), Lanes::splat(deflection));
        (force.to_array()[0], rate.to_array()[0])
    }

    /// Force in steady motion, after the deflection has reached the value at which it no longer changes.
    fn steady(velocity: f64) -> f64 {
        let mut z = 0.0;
        for _ in 0..100_000 {
            z += 1e-6 / velocity.abs() * force(velocity, z).1;
        }
        force(velocity, z).0
    }

    #[test]
    fn steady_motion_meets_the_stribeck_curve_in_both_directions() {
        for v in [1e-4f64, 0.003, 0.01, 0.03, 0.5] {
            let expected = 4e3 + 3e3 / (1.0 + (v / 0.01).powi(2)) + 20e3 * v;
            assert!((steady(v) / expected - 1.0).abs() < 1e-9, "{v}: {} for {expected}", steady(v));
            assert!((steady(-v) / expected + 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn bristles_at_rest_hold_their_force() {
        for z in [-2e-4, 0.0, 1e-4] {
            assert_eq!(force(0.0, z), (3e7 * z, 0.0));
        }
    }

    #[test]
    fn friction_never_adds_energy_to_the_motion() {
        // sigma_1 at the bound of passivity, B_p F_c/(F_s - F_c), and a motion with many speeds.
        let worst = Friction { damping: 20e3 * 4e3 / 3e3, ..BOOM };
        let packed = Friction::pack(&[worst; LANES]);
        let (mut z, mut work, mut least, step) = (0.0, 0.0, 0.0f64, 1e-5);
        for i in 0..2_000_000 {
            let t = f64::from(i) * step;
            let v = 0.05 * (37.0 * t).sin() * (1.3 * t).sin() + 0.002 * (211.0 * t).sin();
            let (force, rate) = packed.force(Lanes::splat(v), Lanes::splat(z));
            work += step * force.to_array()[0] * v;
            z += step * rate.to_array()[0];
            least = least.min(work - 0.5 * worst.stiffness * z * z);
        }
        // The sum above has an error of first order in its step, hence the small negative bound.
        println!("work {work} J, least difference of work and stored energy {least} J");
        assert!(work > 1e3 && least > -1e-3, "{least}");
    }

    #[test]
    fn a_plant_without_friction_gives_no_force() {
        let plant = |machine: pipeline::machine::Machine| machine.axes[0].plant.clone().unwrap();
        let mut boom = plant(pipeline::machine::Machine::four_axes(&[]).unwrap());
        (boom.coulomb_friction, boom.static_friction, boom.viscous_friction) = (0.0, 0.0, 0.0);
        (boom.bristle_stiffness, boom.bristle_damping) = (0.0, 0.0);
        let none = Friction::pack(&[Friction::new(&boom, 1.0, 1.0); LANES]);
        let (force, rate) = none.force(Lanes::splat(0.3), Lanes::splat(5.0));
        assert_eq!((force.to_array()[0], rate.to_array()[0]), (0.0, 0.3));
    }
}
