//! Which axes the step can integrate.
//!
//! ```text
//! h r <= 2.7        r = max(r_mechanical, r_leakage, r_orifice / 4)
//! r_mechanical = (B_p + c_s + max(F_c, F_s)/v_e)/m + sqrt((k_s + K + beta_e (A1^2/V01 + A2^2/V02))/m)
//! r_leakage    = beta_e (2 C_ip + C_ep) / min(V01, V02)
//! r_orifice    = beta_e k / (sqrt(p_tr) min(V01, V02))
//! ```
//!
//! h step s, r rates 1/s, at the least volumes and at the worst that the schedules do. 2.7 is a little less than where
//! the Runge-Kutta method becomes unstable on the real axis (2.79) and on the imaginary one (2.83).
//!
//! The orifice counts a quarter: its law flattens, so beyond the limit a balanced chamber chatters by about
//! (h r_orifice)^2 p_tr/4 and no more, at the worst admitted by some 6 bar, and only with its edge fully open at
//! the end of the stroke.
//!
//! The trap: an unstable step does not always show as infinity; bounded forces chatter, and dry friction that
//! chatters is too small on average.

use pipeline::machine::{Axis, Plant};

use crate::{cylinder::Cylinder, friction::REGULARISATION_SPEED, orifice::TRANSITION_PRESSURE, schedule::Factors};

/// Largest product of step and rate that is integrated.
pub const STABILITY_LIMIT: f64 = 2.7;

/// Part of the orifice's rate that counts, because its chatter is bounded.
const ORIFICE_WEIGHT: f64 = 0.25;

/// Fastest rate of an axis, 1/s, at its least volumes and the worst of its schedules.
pub fn fastest_rate(axis: &Axis, plant: &Plant) -> f64 {
    let (mut least, mut most) = (Factors::ONE, Factors::ONE);
    for schedule in &plant.schedule {
        *least.of(schedule.parameter) *= schedule.factor.min(1.0);
        *most.of(schedule.parameter) *= schedule.factor.max(1.0);
    }
    let c = Cylinder::new(plant, axis.stroke, &Factors { mass: least.mass, ..most });

    let oil = c.bulk_modulus
        * (c.piston_area * c.piston_area / c.piston_dead_volume + c.rod_area * c.rod_area / c.rod_dead_volume);
    let dry = c.friction.coulomb.max(c.friction.static_friction) / REGULARISATION_SPEED;
    let damping = c.friction.viscous + c.end_stop_damping + dry;
    let mechanical = damping / c.mass + ((c.end_stop_stiffness + c.load_stiffness + oil) / c.mass).sqrt();
    let compliance = c.piston_dead_volume.min(c.rod_dead_volume) / c.bulk_modulus;
    let leakage = (2.0 * c.internal_leakage + c.external_leakage) / compliance;
    let orifice = c.conductance / (TRANSITION_PRESSURE.sqrt() * compliance);
    mechanical.max(leakage).max(ORIFICE_WEIGHT * orifice)
}
