//! Which axes the step can integrate.
//!
//! ```text
//! h r <= 2.7        r = max(r_mechanical, r_bristles, r_leakage, r_port, r_orifice / 4)
//! r_mechanical = (B_p + sigma_1 + c_s)/m + sqrt((k_s + sigma_0 + K + beta (A1^2/V01 + A2^2/V02))/m)
//! r_bristles   = sigma_0 v/F_c          v = k sqrt(p_s) / min(A1, A2)
//! r_leakage    = beta (2 C_ip + C_ep) / min(V01, V02)
//! r_port       = max(beta g_r, beta_e(p_a) g_m) / min(V01, V02)
//! r_orifice    = beta k / (sqrt(p_tr) min(V01, V02))
//! ```
//!
//! h step s, r rates 1/s, at the least volumes and at the worst that the scenario does; K with the slope of the load.
//! 2.7 is a little less than where the Runge-Kutta method becomes unstable on the real axis (2.79) and on the
//! imaginary one (2.83).
//!
//! The orifice counts a quarter: its law flattens, so beyond the limit a balanced chamber chatters by about
//! (h r_orifice)^2 p_tr/4 and no more, at the worst admitted by some 6 bar, and only with its edge fully open at
//! the end of the stroke.
//!
//! The trap: an unstable step does not always show as infinity; bounded forces chatter, and dry friction that
//! chatters is too small on average.

use pipeline::machine::{Axis, Change, Hydraulics, Plant};

use crate::{
    conditions::Conditions,
    cylinder::Cylinder,
    oil::{ADIABATIC_INDEX, ATMOSPHERE},
    orifice::TRANSITION_PRESSURE,
};

/// Largest product of step and rate that is integrated.
pub const STABILITY_LIMIT: f64 = 2.7;

/// Part of the orifice's rate that counts, because its chatter is bounded.
const ORIFICE_WEIGHT: f64 = 0.25;

/// Fastest rate of the axis with number `index`, 1/s, at its least volumes and the worst of the scenario's `changes`.
pub fn fastest_rate(axis: &Axis, plant: &Plant, hydraulics: &Hydraulics, changes: &[Change], index: usize) -> f64 {
    let worst = worst(changes, hydraulics, index);
    let c = Cylinder::new(plant, axis.stroke, hydraulics, &worst);
    let bulk_modulus = 1.0 / c.oil.compressibility;
    let mechanical = {
        let oil = bulk_modulus
            * (c.piston_area * c.piston_area / c.piston_dead_volume + c.rod_area * c.rod_area / c.rod_dead_volume);
        let springs = c.end_stops.stiffness + c.friction.stiffness + c.load.steepest(axis.stroke) + oil;
        let damping = c.friction.viscous + c.friction.damping + c.end_stops.damping;
        damping * c.inverse_mass + (springs * c.inverse_mass).sqrt()
    };
    let fastest = c.conductance * c.supply_pressure.sqrt() / c.piston_area.min(c.rod_area);
    let bristles = c.friction.stiffness * fastest / c.friction.coulomb;
    let least_volume = c.piston_dead_volume.min(c.rod_dead_volume);
    let compliance = least_volume / bulk_modulus;
    let leakage = (2.0 * c.internal_leakage + c.external_leakage) / compliance;
    let at_atmosphere = (1.0 + c.oil.air) / (c.oil.compressibility + c.oil.air / (ADIABATIC_INDEX * ATMOSPHERE));
    let port = (c.ports.relief_gain / compliance).max(c.ports.make_up_gain * at_atmosphere / least_volume);
    let orifice = c.conductance / (TRANSITION_PRESSURE.sqrt() * compliance);
    [mechanical, bristles, leakage, port, ORIFICE_WEIGHT * orifice].into_iter().fold(0.0, f64::max)
}

/// For each condition the value of the scenario that makes the axis fastest, all at once.
fn worst(changes: &[Change], hydraulics: &Hydraulics, index: usize) -> Conditions {
    // A ramp is worst at one of its ends.
    let times = changes.iter().flat_map(|change| [change.start, change.end]);
    let reached = times.map(|time| Conditions::at(changes, &hydraulics.oil, index, time));
    let worst = reached.fold(Conditions::NOMINAL, |worst, now| Conditions {
        flow_gain: worst.flow_gain.max(now.flow_gain),
        friction: worst.friction.max(now.friction),
        mass: worst.mass.min(now.mass),
        load_force: worst.load_force.max(now.load_force),
        leakage: worst.leakage.max(now.leakage / now.viscosity),
        supply_pressure: worst.supply_pressure.max(now.supply_pressure),
        bulk_modulus: worst.bulk_modulus.max(now.bulk_modulus),
        air: worst.air.min(now.air),
        viscosity: worst.viscosity.max(now.viscosity),
        ..worst
    });
    // Thick oil makes friction worse, thin oil leakage; the cylinder divides by the first.
    Conditions { leakage: worst.leakage * worst.viscosity, ..worst }
}
