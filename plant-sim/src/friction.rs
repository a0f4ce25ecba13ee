//! Friction of the piston, after LuGre.
//!
//! ```text
//! dz/dt = c (v - r z)         r = sigma_0 |v|/g(v)         g(v) = F_c + (F_s - F_c)/(1 + (v/v_s)^2)
//! F     = sigma_0 z + sigma_1 dz/dt + B_p v                c    = min(1, 1/(r tau_z))
//! ```
//!
//! z mean deflection of the bristles m, v speed m/s, F force against the motion N; sigma_0 N/m and sigma_1 N s/m
//! stiffness and damping of the bristles, F_c Coulomb and F_s static friction N, v_s Stribeck speed m/s, B_p N s/m
//! as in equation (9). In steady motion sigma_0 z = g sign(v). r 1/s is how fast the bristles forget; c is 1 and the
//! model LuGre's as printed up to 1/tau_z, 10 000 1/s, which the built-in boom reaches at 1.3 m/s. There the bristles
//! have turned over after a tenth of a millimetre; faster ones would only ask for a shorter step.
//!
//! Sources: Canudas de Wit, Olsson, Astrom and Lischinsky, 1995, for the model; Hess and Soom, 1990, for g. Theirs is
//! a fraction where others have exp(-(v/v_s)^2): the same at rest and at speed, and it needs no exponential.
//!
//! The traps: at rest the bristles hold the load like a spring, so nothing creeps; a sign function smoothed by tanh
//! would creep. And friction must not feed the motion: F v >= d/dt (sigma_0 z^2/2) holds for every motion if
//! sigma_1 (F_s - F_c) <= B_p F_c (Barabanov and Ortega, 2000), which the machine file has to keep.

use pipeline::machine::Plant;

use crate::lanes::{LANES, Lanes, lanes};

/// Least g, N: keeps an axis without friction from dividing by zero.
const LEAST_FRICTION: f64 = 1e-6;

/// 1/tau_z, 1/s: the fastest that bristles follow.
pub const FASTEST_BRISTLES: f64 = 1e4;

/// Friction of one axis, or of four.
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
    /// Friction of `plant`, its dry part times `dry` and its viscous part times `viscous` as well.
    ///
    /// sigma_1 shrinks with whichever is less, so that friction stays passive.
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
    /// Four axes side by side.
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

    /// Force against the motion, N, and rate of the bristles' deflection, m/s.
    #[inline]
    pub fn force(&self, velocity: Lanes, deflection: Lanes) -> (Lanes, Lanes) {
        let e = velocity * velocity * self.stribeck;
        // r, with 1/g as one fraction.
        let forgetting = self.stiffness * velocity.abs() * (Lanes::ONE + e) / (self.static_friction + self.coulomb * e);
        let limit = (Lanes::splat(FASTEST_BRISTLES) / forgetting).fast_min(Lanes::ONE); // 1/0 is infinite, and 1 less
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

    /// Force in steady motion: the deflection at which the bristles slip as fast as they are dragged.
    fn steady(velocity: f64) -> f64 {
        let mut z = 0.0;
        for _ in 0..100_000 {
            z += 1e-6 / velocity.abs() * force(velocity, z).1;
        }
        force(velocity, z).0
    }

    #[test]
    fn steady_motion_meets_stribecks_curve_with_its_sign() {
        for v in [1e-4f64, 0.003, 0.01, 0.03, 0.5] {
            let expected = 4e3 + 3e3 / (1.0 + (v / 0.01).powi(2)) + 20e3 * v;
            assert!((steady(v) / expected - 1.0).abs() < 1e-9, "{v}: {} for {expected}", steady(v));
            assert!((steady(-v) / expected + 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn bristles_at_rest_hold_their_force_for_good() {
        for z in [-2e-4, 0.0, 1e-4] {
            assert_eq!(force(0.0, z), (3e7 * z, 0.0));
        }
    }

    #[test]
    fn no_motion_takes_energy_out_of_friction() {
        // The worst of the passivity's bound, sigma_1 = B_p F_c/(F_s - F_c), and motions of many speeds.
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
        // Ten times the stored energy is the scale; the sum above is of first order in its step.
        println!("work {work} J, least of work less stored energy {least} J");
        assert!(work > 1e3 && least > -1e-3, "{least}");
    }

    #[test]
    fn an_axis_without_friction_has_none() {
        let plant = |machine: pipeline::machine::Machine| machine.axes[0].plant.clone().unwrap();
        let mut boom = plant(pipeline::machine::Machine::load(None, &[]).unwrap());
        (boom.coulomb_friction, boom.static_friction, boom.viscous_friction) = (0.0, 0.0, 0.0);
        (boom.bristle_stiffness, boom.bristle_damping) = (0.0, 0.0);
        let none = Friction::pack(&[Friction::new(&boom, 1.0, 1.0); LANES]);
        let (force, rate) = none.force(Lanes::splat(0.3), Lanes::splat(5.0));
        assert_eq!((force.to_array()[0], rate.to_array()[0]), (0.0, 0.3));
    }
}
