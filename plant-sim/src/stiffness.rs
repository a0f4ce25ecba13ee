//! Which axes the step can integrate.
//!
//! ```text
//! h r <= 2.7        r = max(max(r_damping, r_bristles) + sigma_1/m, r_leakage + max(r_port, r_orifice / 4)) + r_spring
//! r_spring   = sqrt((k_s + sigma_0 + K + beta (A1^2/V1 + A2^2/V2))/m)
//! r_damping  = (B_p + c_s)/m
//! r_bristles = sigma_0 v/F_c
//! r_leakage  = beta (2 C_ip + C_ep) / min(V1, V2)
//! r_port     = max(beta g_r, beta_e(p_a) g_m) / min(V1, V2)
//! r_orifice  = beta k / (sqrt(p_tr) min(V1, V2))
//! V          = max(V0 - A F/k_s, V0/10)        F = A' p_s + F_L
//! ```
//!
//! h step s, r rates 1/s, at the worst that the scenario does; K with the slope of the load; V1 and V2 the least
//! volumes, with the piston as deep in a stop as the pump on the other side, A', and the load push it; v the largest
//! speed that pump and load reach, which is more than the pump's flow makes of it where a load presses oil through a
//! relief valve, or falls until the oil's spring catches it. In units of energy what is stored turns round in a skew
//! matrix, whose norm is r_spring, and what is lost stands on the diagonal: no eigenvalue is larger than the sum.
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
    cylinder::{Cylinder, LEAST_VOLUME},
    oil::{ADIABATIC_INDEX, ATMOSPHERE},
    orifice::TRANSITION_PRESSURE,
};

/// Largest product of step and rate that is integrated.
pub const STABILITY_LIMIT: f64 = 2.7;

/// Part of the orifice's rate that counts, because its chatter is bounded.
const ORIFICE_WEIGHT: f64 = 0.25;

/// Halvings of an interval, to the last bits.
const BISECTIONS: usize = 60;

/// Fastest rate of the axis with number `index`, 1/s, at its least volumes and the worst of the scenario's `changes`.
pub fn fastest_rate(axis: &Axis, plant: &Plant, hydraulics: &Hydraulics, changes: &[Change], index: usize) -> f64 {
    let worst = worst(changes, hydraulics, index);
    let c = Cylinder::new(plant, axis.stroke, hydraulics, &worst);
    let directions = Direction::both(&c, load_range(axis, plant, hydraulics, changes, index));
    let speed = directions.iter().map(|direction| direction.fastest(&c)).fold(0.0, f64::max);
    let [rod_volume, piston_volume] = directions.map(|direction| direction.least_volume(&c));
    let least_volume = piston_volume.min(rod_volume);
    let bulk_modulus = 1.0 / c.oil.compressibility;

    let oil = bulk_modulus * (c.piston_area.powi(2) / piston_volume + c.rod_area.powi(2) / rod_volume);
    let springs = c.end_stops.stiffness + c.friction.stiffness + c.load.steepest() + oil;
    let damping = (c.friction.viscous + c.end_stops.damping) * c.inverse_mass;
    let bristles = c.friction.stiffness * speed / c.friction.coulomb;
    let mechanical = damping.max(bristles) + c.friction.damping * c.inverse_mass;

    let compliance = least_volume / bulk_modulus;
    let leakage = (2.0 * c.internal_leakage + c.external_leakage) / compliance;
    let at_atmosphere = (1.0 + c.oil.air) / (c.oil.compressibility + c.oil.air / (ADIABATIC_INDEX * ATMOSPHERE));
    let port = (c.ports.relief_gain / compliance).max(c.ports.make_up_gain * at_atmosphere / least_volume);
    let orifice = c.conductance / (TRANSITION_PRESSURE.sqrt() * compliance);
    let hydraulic = leakage + port.max(ORIFICE_WEIGHT * orifice);

    mechanical.max(hydraulic) + (springs * c.inverse_mass).sqrt()
}

/// One direction of motion.
struct Direction {
    /// Area of the chamber that is fed, m2.
    feeding: f64,
    /// Area of the one that is pushed empty, m2, and its dead volume, m3.
    pushed: f64,
    dead_volume: f64,
    /// What the load adds to the push at the most, N; less than zero where it always resists.
    pull: f64,
}

impl Direction {
    /// Extension and retraction under a load from `least` to `most` N.
    fn both(c: &Cylinder<f64>, (least, most): (f64, f64)) -> [Self; 2] {
        let (piston, rod) = (c.piston_area, c.rod_area);
        [
            Self { feeding: piston, pushed: rod, dead_volume: c.rod_dead_volume, pull: -least },
            Self { feeding: rod, pushed: piston, dead_volume: c.piston_dead_volume, pull: most },
        ]
    }

    /// Largest force of pump and load, N, at `speed` m/s: what the feeding edge takes of the pressure is missing.
    fn force(&self, c: &Cylinder<f64>, speed: f64) -> f64 {
        let fed = c.supply_pressure - (self.feeding * speed / c.conductance).powi(2);
        (self.feeding * fed.max(0.0) + self.pull).max(0.0)
    }

    /// Least volume of the chamber that is pushed empty, m3: with the piston as deep in the stop as it is pushed.
    fn least_volume(&self, c: &Cylinder<f64>) -> f64 {
        let depth = self.force(c, 0.0) / c.end_stops.stiffness;
        (self.dead_volume - self.pushed * depth).max(LEAST_VOLUME * self.dead_volume)
    }

    /// Largest speed, m/s: that at which the pushed chamber lets out what the piston displaces, and what the force adds
    /// before the oil's spring catches it; at most what the force reaches over the stroke.
    fn fastest(&self, c: &Cylinder<f64>) -> f64 {
        let (force, stroke) = (self.force(c, 0.0), c.end_stops.stroke);
        // The one falls with the speed, the other rises.
        let (mut steady, mut over) = (0.0, self.let_out(c, force));
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (steady + over);
            if self.let_out(c, self.force(c, middle)) > middle { steady = middle } else { over = middle }
        }
        let caught = force * (c.inverse_mass / self.spring(c, force / self.pushed)).sqrt();
        (over + caught).min((2.0 * force * stroke * c.inverse_mass).sqrt())
    }

    /// Speed, m/s, at which edge, relief valve and gaps let out of the pushed chamber what `force` N presses.
    fn let_out(&self, c: &Cylinder<f64>, force: f64) -> f64 {
        let pressure = force / self.pushed;
        let relief = c.ports.relief_gain * (pressure - c.ports.relief_pressure).max(0.0);
        let leakage = (c.internal_leakage + c.external_leakage) * pressure;
        (c.conductance * pressure.sqrt() + relief + leakage) / self.pushed
    }

    /// Spring of the pushed chamber at its largest volume and at `pressure` Pa, N/m.
    fn spring(&self, c: &Cylinder<f64>, pressure: f64) -> f64 {
        let absolute = pressure + ATMOSPHERE;
        let air = c.oil.air * (ATMOSPHERE / absolute).powf(1.0 / ADIABATIC_INDEX);
        let softness = c.oil.compressibility + air / (ADIABATIC_INDEX * absolute);
        (1.0 + air) * self.pushed.powi(2) / (softness * (self.dead_volume + self.pushed * c.end_stops.stroke))
    }
}

/// Least and largest load, N, of all that the scenario does.
fn load_range(axis: &Axis, plant: &Plant, hydraulics: &Hydraulics, changes: &[Change], index: usize) -> (f64, f64) {
    let all = std::iter::once(Conditions::NOMINAL).chain(reached(changes, hydraulics, index));
    let ranges = all.map(|now| Cylinder::new(plant, axis.stroke, hydraulics, &now).load.range());
    ranges.fold((f64::INFINITY, f64::NEG_INFINITY), |all, now| (all.0.min(now.0), all.1.max(now.1)))
}

/// Conditions at the ends of every change: a ramp is worst at one of its ends.
fn reached(changes: &[Change], hydraulics: &Hydraulics, index: usize) -> impl Iterator<Item = Conditions> {
    let times = changes.iter().flat_map(|change| [change.start, change.end]);
    times.map(move |time| Conditions::at(changes, &hydraulics.oil, index, time))
}

/// For each condition the value of the scenario that makes the axis fastest, all at once.
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
    // Thick oil makes friction worse, thin oil leakage; the cylinder divides by the first.
    Conditions { leakage: worst.leakage * worst.viscosity, ..worst }
}
