//! The fastest rate of an axis, which decides whether the step can integrate that axis. Used at construction only.
//!
//! ```text
//! h r <= 2.7        r = max(r_damping + r_bristles, r_leakage + max(r_port, r_orifice / 4, r_pilot)) + r_spring
//! r_spring   = sqrt((k_s + sigma_0 + K + beta (A1^2/V1 + A2^2/V2))/m)
//! r_damping  = (B_p + sigma_1 + c_s)/m
//! r_bristles = 1/tau_z
//! r_leakage  = beta (2 C_ip + C_ep + C_s) / min(V1, V2)
//! r_port     = max(beta g_r, beta_e(p_a) g_m) / min(V1, V2)
//! r_orifice  = beta k (max(1, m) + r) / (sqrt(p_tr) min(V1, V2))
//! r_pilot    = beta k m sqrt(1.2 p_cb) max(1, R/6.75) / (0.2 p_cb min(V1, V2))
//! V          = max(V0 - A F/k_s, V0/10)        F = A' p_s + |F_L|
//! ```
//!
//! h step, s; r rates, 1/s, under the worst conditions of the scenario; K stiffness including the slope of the load; V1
//! and V2 least volumes of the chambers, with the piston as deep in a stop as the load and the pump on the other side,
//! with the area A', push it. r_spring is the rate at which stored energy oscillates, the others are rates at which
//! energy is lost; the two kinds are added. The Runge-Kutta method becomes unstable at 2.79 on the real axis and at
//! 2.83 on the imaginary axis; the limit 2.7 lies a little below both.
//!
//! A quarter of r_orifice counts, because the flow law of an orifice flattens: beyond the limit the pressure of a
//! balanced chamber chatters by about (h r_orifice)^2 p_tr/4 and no more. For axes that are admitted this is at most
//! about 6 bar, and only with the edge fully open at the end of the stroke.
//!
//! Axes that a linkage couples are judged together by `coupled`.
//!
//! Trap: an unstable step does not always end in infinity. Bounded forces chatter, and dry friction that chatters is
//! too small on average.

use pipeline::machine::{Axis, Change, Hydraulics, Plant};

use crate::{
    actuator::{
        cylinder::{Cylinder, LEAST_VOLUME},
        friction::FASTEST_BRISTLES,
    },
    conditions::Conditions,
    hydraulics::{
        oil::{ADIABATIC_INDEX, ATMOSPHERE},
        orifice::TRANSITION_PRESSURE,
    },
};

/// Largest product of step and rate that is accepted.
pub const STABILITY_LIMIT: f64 = 2.7;

/// Part of the orifice's rate that counts; the chatter of an orifice is bounded.
const ORIFICE_WEIGHT: f64 = 0.25;

/// Fastest rate of the axis with the number `index`, 1/s, at its least volumes and under the worst conditions that
/// `changes` of the scenario reach.
pub fn fastest_rate(axis: &Axis, plant: &Plant, hydraulics: &Hydraulics, changes: &[Change], index: usize) -> f64 {
    let load = largest_load(axis, plant, hydraulics, changes, index);
    let parts = Parts::new(axis, plant, hydraulics, changes, index, load);
    let worst = worst(changes, hydraulics, index);
    let inverse_mass = Cylinder::new(plant, axis.stroke, hydraulics, &worst).inverse_mass;
    let mechanical = parts.damping * inverse_mass + FASTEST_BRISTLES;
    mechanical.max(parts.hydraulic) + (parts.springs * inverse_mass).sqrt()
}

/// What makes an axis fast, without its mass, under the worst conditions of the scenario.
#[derive(Debug, Clone, Copy)]
pub(super) struct Parts {
    /// Stiffness of all springs on the piston, N/m.
    pub springs: f64,
    /// Damping of the piston, N s/m.
    pub damping: f64,
    /// Rate of the pressures, 1/s.
    pub hydraulic: f64,
    /// How deep load and pump press the piston into an end stop, m.
    pub depth: f64,
}

impl Parts {
    /// Of the axis with the number `index`, on which `load` N act at most.
    pub(super) fn new(
        axis: &Axis,
        plant: &Plant,
        hydraulics: &Hydraulics,
        changes: &[Change],
        index: usize,
        load: f64,
    ) -> Self {
        let c = Cylinder::new(plant, axis.stroke, hydraulics, &worst(changes, hydraulics, index));
        let depth = |feeding: f64| (feeding * c.supply_pressure + load) / c.end_stops.stiffness;
        let least = |dead_volume: f64, area: f64, feeding: f64| {
            (dead_volume - area * depth(feeding)).max(LEAST_VOLUME * dead_volume)
        };
        let piston_volume = least(c.piston_dead_volume, c.piston_area, c.rod_area);
        let rod_volume = least(c.rod_dead_volume, c.rod_area, c.piston_area);
        let least_volume = piston_volume.min(rod_volume);
        let bulk_modulus = 1.0 / c.oil.compressibility;

        let oil = bulk_modulus * (c.piston_area.powi(2) / piston_volume + c.rod_area.powi(2) / rod_volume);
        let springs = c.end_stops.stiffness + c.friction.stiffness + c.load.steepest() + oil;
        let damping = c.friction.viscous + c.friction.damping + c.end_stops.damping;

        let compliance = least_volume / bulk_modulus;
        let spool = c.edges.leakage[0].max(c.edges.leakage[1]);
        let leakage = (2.0 * c.internal_leakage + c.external_leakage + spool) / compliance;
        let at_atmosphere = (1.0 + c.oil.air) / (c.oil.compressibility + c.oil.air / (ADIABATIC_INDEX * ATMOSPHERE));
        let port = (c.ports.relief_gain / compliance).max(c.ports.make_up_gain * at_atmosphere / least_volume);
        let orifice = c.edges.steepest(TRANSITION_PRESSURE) / compliance;
        let piloted = c.edges.piloted() / compliance;
        let hydraulic = leakage + port.max(ORIFICE_WEIGHT * orifice).max(piloted);
        Self { springs, damping, hydraulic, depth: depth(c.piston_area.max(c.rod_area)) }
    }
}

/// Largest absolute load under all conditions of the scenario, N.
fn largest_load(axis: &Axis, plant: &Plant, hydraulics: &Hydraulics, changes: &[Change], index: usize) -> f64 {
    let all = std::iter::once(Conditions::NOMINAL).chain(reached(changes, hydraulics, index));
    all.map(|now| Cylinder::new(plant, axis.stroke, hydraulics, &now).load.largest()).fold(0.0, f64::max)
}

/// Conditions at begin and end of every change: a ramp is worst at one of its ends.
fn reached(changes: &[Change], hydraulics: &Hydraulics, index: usize) -> impl Iterator<Item = Conditions> {
    let times = changes.iter().flat_map(|change| [change.start, change.end]);
    times.map(move |time| Conditions::at(changes, &hydraulics.oil, index, time))
}

/// Conditions that take for each parameter the value of the scenario that makes the axis fastest.
fn worst(changes: &[Change], hydraulics: &Hydraulics, index: usize) -> Conditions {
    let worst = reached(changes, hydraulics, index).fold(Conditions::NOMINAL, |worst, now| Conditions {
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
    // Viscous oil has the largest friction, thin oil the largest leakage. The cylinder divides leakage by viscosity, so
    // the largest viscosity is multiplied back.
    Conditions { leakage: worst.leakage * worst.viscosity, ..worst }
}
