//! The cylinder: two chambers, leakage, the force balance and the end stops.
//!
//! ```text
//! V1/beta_e dp1/dt = q1 - A1 v - C_ip (p1 - p2) - C_ep p1              (6)
//! V2/beta_e dp2/dt = A2 v - q2 + C_ip (p1 - p2) - C_ep p2              (6)
//! m dv/dt = A1 p1 - A2 p2 - F(v) - K (y - L/2) - F_L + F_stop          (9)
//! F_stop = max(0, -k_s y - c_s v) for y < 0,  -max(0, k_s (y - L) + c_s v) for y > L
//! ```
//!
//! Symbols and units as at the fields below; q1 into the piston side, q2 out of the rod side, m3/s, by equation (3);
//! V1 = V01 + A1 y and V2 = V02 + A2 (L - y), m3; F friction with its viscous part, N.
//!
//! The traps: oil cannot pull, so the pressure has a floor, [`LOWEST_PRESSURE`]. A chamber that would fall below it
//! takes up what it lacks without resistance, as through an ideal anti-cavitation valve; only there the balance of
//! oil is not kept. And with V02 at full stroke, an end stop that gives way eats into the dead volume, which has a
//! floor as well, [`LEAST_VOLUME`].

use pipeline::machine::Plant;

use crate::{
    friction::Friction,
    integrate::State,
    orifice::{conductance, smooth_root},
    schedule::Factors,
};

/// Least chamber pressure, Pa, on the scale on which the tank is at 0 by default.
pub const LOWEST_PRESSURE: f64 = 0.0;

/// Least volume of a chamber, as a part of its dead volume; reached only by a soft end stop pushed far in.
pub const LEAST_VOLUME: f64 = 0.1;

/// Parameters of one cylinder and its control edges at one time, SI units.
#[derive(Debug, Clone, Copy)]
pub struct Cylinder {
    /// L, m.
    pub stroke: f64,
    /// A1, m2.
    pub piston_area: f64,
    /// A2, m2.
    pub rod_area: f64,
    /// V01, m3 at y = 0.
    pub piston_dead_volume: f64,
    /// V02, m3 at y = L.
    pub rod_dead_volume: f64,
    /// beta_e, Pa.
    pub bulk_modulus: f64,
    /// C_ip, m3/(s Pa).
    pub internal_leakage: f64,
    /// C_ep, m3/(s Pa).
    pub external_leakage: f64,
    /// k of every control edge, m3/(s Pa^(1/2)).
    pub conductance: f64,
    /// p_s, Pa.
    pub supply_pressure: f64,
    /// p_0, Pa.
    pub return_pressure: f64,
    /// m, kg.
    pub mass: f64,
    /// F(v).
    pub friction: Friction,
    /// F_L, N.
    pub load_force: f64,
    /// K, N/m.
    pub load_stiffness: f64,
    /// k_s, N/m.
    pub end_stop_stiffness: f64,
    /// c_s, N s/m.
    pub end_stop_damping: f64,
}

impl Cylinder {
    /// The cylinder of `plant` with its parameters multiplied by `factors`.
    pub fn new(plant: &Plant, stroke: f64, factors: &Factors) -> Self {
        Self {
            stroke,
            piston_area: plant.piston_area,
            rod_area: plant.rod_area,
            piston_dead_volume: plant.piston_dead_volume,
            rod_dead_volume: plant.rod_dead_volume,
            bulk_modulus: plant.bulk_modulus * factors.bulk_modulus,
            internal_leakage: plant.internal_leakage * factors.leakage,
            external_leakage: plant.external_leakage * factors.leakage,
            conductance: conductance(plant.rated_flow * factors.flow_gain, plant.rated_pressure_drop),
            supply_pressure: plant.supply_pressure * factors.supply_pressure,
            return_pressure: plant.return_pressure,
            mass: plant.mass * factors.mass,
            friction: Friction {
                coulomb: plant.coulomb_friction * factors.friction,
                static_friction: plant.static_friction * factors.friction,
                stribeck_speed: plant.stribeck_speed,
                viscous: plant.viscous_friction * factors.friction,
            },
            load_force: plant.load_force * factors.load_force,
            load_stiffness: plant.load_stiffness,
            end_stop_stiffness: plant.end_stop_stiffness,
            end_stop_damping: plant.end_stop_damping,
        }
    }

    /// Pressures (p1, p2) that hold the load at rest at `position` with the valve shut, Pa.
    ///
    /// Between two moves the rod side keeps something between return and supply pressure; it starts in the middle.
    /// Where a load pulls so hard that the piston side would need less than the return pressure, that side starts at
    /// the return pressure and the rod side holds the load.
    pub fn pressures_at_rest(&self, position: f64) -> (f64, f64) {
        let load = self.load_force + self.load_stiffness * (position - 0.5 * self.stroke);
        let rod = 0.5 * (self.supply_pressure + self.return_pressure);
        let piston = (load + self.rod_area * rod) / self.piston_area;
        if piston >= self.return_pressure {
            return (piston, rod);
        }
        let rod = (self.piston_area * self.return_pressure - load) / self.rod_area;
        (self.return_pressure, rod.max(LOWEST_PRESSURE))
    }

    /// Flow into the piston side and out of the rod side at `opening`, m3/s, equation (3) for both directions.
    #[inline]
    pub fn flows(&self, opening: f64, piston_pressure: f64, rod_pressure: f64) -> (f64, f64) {
        let gain = self.conductance * opening;
        if opening > 0.0 {
            (
                gain * smooth_root(self.supply_pressure - piston_pressure),
                gain * smooth_root(rod_pressure - self.return_pressure),
            )
        } else if opening < 0.0 {
            (
                gain * smooth_root(piston_pressure - self.return_pressure),
                gain * smooth_root(self.supply_pressure - rod_pressure),
            )
        } else {
            (0.0, 0.0)
        }
    }

    /// Volumes of piston and rod side at `position`, m3.
    #[inline]
    pub fn volumes(&self, position: f64) -> (f64, f64) {
        let piston = self.piston_dead_volume + self.piston_area * position;
        let rod = self.rod_dead_volume + self.rod_area * (self.stroke - position);
        (piston.max(LEAST_VOLUME * self.piston_dead_volume), rod.max(LEAST_VOLUME * self.rod_dead_volume))
    }

    /// Force of the end stops on the piston, N; they only push.
    #[inline]
    pub fn end_stop_force(&self, position: f64, velocity: f64) -> f64 {
        let force = |depth: f64, speed: f64| {
            (self.end_stop_stiffness * depth + self.end_stop_damping * speed).max(0.0) // no pull on the way out
        };
        if position < 0.0 {
            force(-position, -velocity)
        } else if position > self.stroke {
            -force(position - self.stroke, velocity)
        } else {
            0.0
        }
    }

    /// Rates of y, v, p1 and p2 at `opening`.
    #[inline]
    pub fn rates(&self, [position, velocity, p1, p2]: State, opening: f64) -> State {
        let (p1, p2) = (p1.max(LOWEST_PRESSURE), p2.max(LOWEST_PRESSURE));
        let (q1, q2) = self.flows(opening, p1, p2);
        let (v1, v2) = self.volumes(position);
        let internal = self.internal_leakage * (p1 - p2);
        let into_piston = q1 - self.piston_area * velocity - internal - self.external_leakage * p1;
        let into_rod = self.rod_area * velocity - q2 + internal - self.external_leakage * p2;
        let force = self.piston_area * p1
            - self.rod_area * p2
            - self.friction.force(velocity)
            - self.load_stiffness * (position - 0.5 * self.stroke)
            - self.load_force
            + self.end_stop_force(position, velocity);
        [
            velocity,
            force / self.mass,
            at_floor(p1, self.bulk_modulus * into_piston / v1),
            at_floor(p2, self.bulk_modulus * into_rod / v2),
        ]
    }
}

/// The pressure's rate, but none downwards at the floor.
#[inline]
fn at_floor(pressure: f64, rate: f64) -> f64 {
    if pressure <= LOWEST_PRESSURE { rate.max(0.0) } else { rate }
}
