//! The cylinder: two chambers, leakage and force balance give the rates of change of one axis.
//!
//! ```text
//! (V1/beta_e + C_w1) dp1/dt = q1 - A1 v - C_ip (p1 - p2) - C_ep p1 - q_o(p1) - q_s1  (6)
//! (V2/beta_e + C_w2) dp2/dt = A2 v - q2 + C_ip (p1 - p2) - C_ep p2 - q_o(p2) - q_s2  (6)
//! m dv/dt = A1 p1 - A2 p2 - F(v, z) - F_L(y) + F_stop(y, v)                          (9)
//! ```
//!
//! | symbol | unit | meaning |
//! |---|---|---|
//! | q1, q2 | m3/s | flow into the piston side, flow out of the rod side, [`super::edges`] |
//! | q_s1, q_s2 | m3/s | leakage of the spool, [`super::edges`] |
//! | beta_e | Pa | bulk modulus of oil with air at the pressure of the chamber, [`crate::hydraulics::oil`] |
//! | q_o | m3/s | relief and make-up valve, [`crate::hydraulics::port`] |
//! | F, z | N, m | friction and deflection of its bristles, [`super::friction`] |
//! | F_L | N | load, [`super::load`] |
//! | F_stop | N | end stops, [`super::end_stop`] |
//! | V1, V2 | m3 | volumes V01 + A1 y and V02 + A2 (L - y), with the hose of the chamber |
//! | C_w1, C_w2 | m3/Pa | by which the hoses widen: their volume divided by their modulus |
//!
//! Pressures are above the atmosphere. A hose adds its oil and its yielding wall to the chamber; assumed: oil moves in
//! it without inertia and without loss of pressure.
//!
//! With the valve shut the oil is a spring, of the stiffness
//!
//! ```text
//! k = A1^2/(V1/beta_e(p1) + C_w1) + A2^2/(V2/beta_e(p2) + C_w2)
//! ```
//!
//! Trap: V02 is the volume left at full stroke. An end stop that yields therefore takes from the dead volume; the
//! volume of a chamber has the lower bound [`LEAST_VOLUME`].

use pipeline::machine::{Hydraulics, Plant};

use super::{
    edges::{ControlEdges, Edges},
    end_stop::EndStops,
    friction::Friction,
    load::Load,
};
use crate::{
    conditions::Conditions,
    hydraulics::{oil::OilMixture, port::PortValves},
    lanes::{LANES, Lanes, lanes},
};

/// Least volume of a chamber as a part of its dead volume. Only a piston that is pushed deep into a soft end stop
/// reaches it.
pub const LEAST_VOLUME: f64 = 0.1;

/// Parameters of the cylinder and of its valve's edges at one time, of one axis (`T = f64`) or of four (`T = Lanes`);
/// SI units.
#[derive(Debug, Clone, Copy)]
pub struct Cylinder<T> {
    /// A1, m2.
    pub piston_area: T,
    /// A2, m2.
    pub rod_area: T,
    /// V01, volume at y = 0 with the hose, m3.
    pub piston_dead_volume: T,
    /// V02, volume at y = L with the hose, m3.
    pub rod_dead_volume: T,
    /// C_w1 and C_w2, m3/Pa.
    pub walls: [T; 2],
    /// Compressible oil with air.
    pub oil: OilMixture<T>,
    /// C_ip, m3/(s Pa).
    pub internal_leakage: T,
    /// C_ep, m3/(s Pa).
    pub external_leakage: T,
    /// Relief and make-up valves.
    pub ports: PortValves<T>,
    /// Edges of the valve.
    pub edges: ControlEdges<T>,
    /// Largest p_s, Pa.
    pub supply_pressure: T,
    /// 1/m, 1/kg.
    pub inverse_mass: T,
    /// F.
    pub friction: Friction<T>,
    /// F_L.
    pub load: Load<T>,
    /// F_stop and L.
    pub end_stops: EndStops<T>,
}

/// State of an axis: y m, v m/s, p1 Pa, p2 Pa, z m.
pub type State<T> = [T; 5];

impl Cylinder<f64> {
    /// The cylinder of `plant` under `conditions`.
    pub fn new(plant: &Plant, stroke: f64, hydraulics: &Hydraulics, conditions: &Conditions) -> Self {
        let supply_pressure = hydraulics.supply.pressure * conditions.supply_pressure;
        let external = conditions.external_force * hydraulics.supply.pressure * plant.piston_area;
        let leakage = conditions.leakage / conditions.viscosity;
        Self {
            piston_area: plant.piston_area,
            rod_area: plant.rod_area,
            piston_dead_volume: plant.piston_dead_volume + plant.ports.piston_hose_volume,
            rod_dead_volume: plant.rod_dead_volume + plant.ports.rod_hose_volume,
            walls: [plant.ports.piston_hose_volume, plant.ports.rod_hose_volume]
                .map(|volume| volume / plant.ports.hose_modulus),
            oil: OilMixture {
                compressibility: 1.0 / (hydraulics.oil.bulk_modulus * conditions.bulk_modulus),
                air: hydraulics.oil.air * conditions.air,
            },
            internal_leakage: plant.internal_leakage * leakage,
            external_leakage: plant.external_leakage * leakage,
            ports: PortValves::new(plant),
            edges: ControlEdges::new(plant, hydraulics, conditions.flow_gain, leakage),
            supply_pressure,
            inverse_mass: 1.0 / (plant.mass * conditions.mass),
            friction: Friction::new(plant, conditions.friction, conditions.viscosity),
            load: Load::new(plant, stroke, conditions.load_force, external),
            end_stops: EndStops::new(plant, stroke),
        }
    }

    /// Pressures (p1, p2), Pa, that hold the force `load`, N, against extension at rest with the valve shut, when the
    /// pump idles at `idle` Pa.
    ///
    /// Between two moves the pressure of the rod side lies between return and supply pressure; it starts in the middle.
    /// A load may pull so hard that the piston side would need less than the return pressure. Then the piston side
    /// starts at the return pressure, and the rod side holds the load.
    pub fn pressures_at_rest(&self, load: f64, idle: f64) -> (f64, f64) {
        let rod = 0.5 * (idle + self.edges.return_pressure);
        let piston = (load + self.rod_area * rod) / self.piston_area;
        if piston >= self.edges.return_pressure {
            return (piston, rod);
        }
        let rod = (self.piston_area * self.edges.return_pressure - load) / self.rod_area;
        (self.edges.return_pressure, rod.max(self.edges.return_pressure))
    }

    /// k, N/m, at `position` m with the pressures (p1, p2), Pa. For reports: its last bits depend on the computer's
    /// library.
    pub fn oil_stiffness(&self, position: f64, (p1, p2): (f64, f64)) -> f64 {
        let piston = self.piston_dead_volume + self.piston_area * position;
        let rod = self.rod_dead_volume + self.rod_area * (self.end_stops.stroke - position);
        let spring = |area: f64, volume: f64, pressure: f64, walls: f64| {
            area * area / (volume / self.oil.bulk_modulus(pressure) + walls)
        };
        spring(self.piston_area, piston, p1, self.walls[0]) + spring(self.rod_area, rod, p2, self.walls[1])
    }
}

impl Cylinder<Lanes> {
    /// Puts four axes side by side.
    pub fn pack(axes: &[Cylinder<f64>; LANES]) -> Self {
        Self {
            piston_area: lanes(axes, |c| c.piston_area),
            rod_area: lanes(axes, |c| c.rod_area),
            piston_dead_volume: lanes(axes, |c| c.piston_dead_volume),
            rod_dead_volume: lanes(axes, |c| c.rod_dead_volume),
            walls: [0, 1].map(|side| lanes(axes, |c| c.walls[side])),
            oil: OilMixture::pack(&axes.map(|c| c.oil)),
            internal_leakage: lanes(axes, |c| c.internal_leakage),
            external_leakage: lanes(axes, |c| c.external_leakage),
            ports: PortValves::pack(&axes.map(|c| c.ports)),
            edges: ControlEdges::pack(&axes.map(|c| c.edges)),
            supply_pressure: lanes(axes, |c| c.supply_pressure),
            inverse_mass: lanes(axes, |c| c.inverse_mass),
            friction: Friction::pack(&axes.map(|c| c.friction)),
            load: Load::pack(&axes.map(|c| c.load)),
            end_stops: EndStops::pack(&axes.map(|c| c.end_stops)),
        }
    }

    /// Flows through the edges of the valve at the opening X = `opening` in [-1, 1] and the pump's pressure p_s =
    /// `supply` Pa.
    #[inline]
    pub fn edges(&self, [_, _, p1, p2, _]: &State<Lanes>, opening: Lanes, supply: f64) -> Edges {
        self.edges.at(opening, *p1, *p2, supply)
    }

    /// V1 and V2, volumes of piston side and rod side at `position`, m3.
    #[inline]
    pub fn volumes(&self, position: Lanes) -> (Lanes, Lanes) {
        let piston = self.piston_dead_volume + self.piston_area * position;
        let rod = self.rod_dead_volume + self.rod_area * (self.end_stops.stroke - position);
        let least = Lanes::splat(LEAST_VOLUME);
        (piston.fast_max(least * self.piston_dead_volume), rod.fast_max(least * self.rod_dead_volume))
    }

    /// Rates of change of y, p1, p2 and z by equation (6), and in the place of the rate of v the force on the piston in
    /// (9), m dv/dt in N, of which the mass makes an acceleration.
    #[inline]
    pub fn rates(&self, &[position, velocity, p1, p2, z]: &State<Lanes>, edges: &Edges, share: Lanes) -> State<Lanes> {
        let (q1, q2) = edges.flows(share);
        let (v1, v2) = self.volumes(position);
        let internal = self.internal_leakage * (p1 - p2);
        let [spool1, spool2] = self.edges.leaks(p1, p2);
        let into_piston =
            q1 - self.piston_area * velocity - internal - self.external_leakage * p1 - self.ports.outflow(p1) - spool1;
        let into_rod =
            self.rod_area * velocity - q2 + internal - self.external_leakage * p2 - self.ports.outflow(p2) - spool2;
        let (friction, deflection_rate) = self.friction.force(velocity, z);
        let force = self.piston_area * p1 - self.rod_area * p2 - friction - self.load.at(position)
            + self.end_stops.force(position, velocity);
        [
            velocity,
            force,
            self.oil.pressure_rate(p1, into_piston, v1, self.walls[0]),
            self.oil.pressure_rate(p2, into_rod, v2, self.walls[1]),
            deflection_rate,
        ]
    }
}
