//! The cylinder: control edges, two chambers, leakage and force balance give the rates of change of one axis.
//!
//! ```text
//! extend,  X >= 0:  q1 = s k X max(0, f(min(dp_c, p_s - p1)))    q2 =  k X f(p2 - p_0)          (3)
//! retract, X < 0:   q1 = k X f(p1 - p_0)              q2 =  s k X max(0, f(min(dp_c, p_s - p2)))
//! V1/beta_e dp1/dt = q1 - A1 v - C_ip (p1 - p2) - C_ep p1 - q_o(p1)                  (6)
//! V2/beta_e dp2/dt = A2 v - q2 + C_ip (p1 - p2) - C_ep p2 - q_o(p2)                  (6)
//! m dv/dt = A1 p1 - A2 p2 - F(v, z) - F_L(y) + F_stop(y, v)                          (9)
//! ```
//!
//! | symbol | unit | meaning |
//! |---|---|---|
//! | q1, q2 | m3/s | flow into the piston side, flow out of the rod side |
//! | f | Pa^(1/2) | flow law of a control edge, [`crate::hydraulics::orifice`] |
//! | p_s, s | Pa, 1 | pressure of the pump, part of its demand that every axis gets, [`crate::hydraulics::supply`] |
//! | dp_c | Pa | drop that a pressure compensator leaves to the edge that feeds; without a compensator unbounded |
//! | beta_e | Pa | bulk modulus of oil with air at the pressure of the chamber, [`crate::hydraulics::oil`] |
//! | q_o | m3/s | relief and make-up valve, [`crate::hydraulics::port`] |
//! | F, z | N, m | friction and deflection of its bristles, [`super::friction`] |
//! | F_L | N | load, [`super::load`] |
//! | F_stop | N | end stops, [`super::end_stop`] |
//! | V1, V2 | m3 | volumes V01 + A1 y and V02 + A2 (L - y) |
//!
//! Pressures are above the atmosphere. The function max(0, ..) stands for the check valve before the edge that feeds:
//! a load that is stronger than the pump does not sink when the valve opens.
//!
//! Trap: V02 is the volume left at full stroke. An end stop that yields therefore takes from the dead volume; the
//! volume of a chamber has the lower bound [`LEAST_VOLUME`].

use pipeline::machine::{Hydraulics, Plant, SupplyKind};

use super::{end_stop::EndStops, friction::Friction, load::Load};
use crate::{
    conditions::Conditions,
    hydraulics::{
        oil::OilMixture,
        orifice::{conductance, smooth_root},
        port::PortValves,
        supply::Demand,
    },
    lanes::{LANES, Lanes, lanes, positive},
};

/// Least volume of a chamber as a part of its dead volume. Only a piston that is pushed deep into a soft end stop
/// reaches it.
pub const LEAST_VOLUME: f64 = 0.1;

/// Parameters of the cylinder and of the control edges at one time, of one axis (`T = f64`) or of four (`T = Lanes`);
/// SI units.
#[derive(Debug, Clone, Copy)]
pub struct Cylinder<T> {
    /// A1, m2.
    pub piston_area: T,
    /// A2, m2.
    pub rod_area: T,
    /// V01, volume at y = 0, m3.
    pub piston_dead_volume: T,
    /// V02, volume at y = L, m3.
    pub rod_dead_volume: T,
    /// Compressible oil with air.
    pub oil: OilMixture<T>,
    /// C_ip, m3/(s Pa).
    pub internal_leakage: T,
    /// C_ep, m3/(s Pa).
    pub external_leakage: T,
    /// Relief and make-up valves.
    pub ports: PortValves<T>,
    /// k of every control edge, m3/(s Pa^(1/2)).
    pub conductance: T,
    /// dp_c, Pa; infinite without a compensator.
    pub compensated_drop: T,
    /// Largest p_s, Pa.
    pub supply_pressure: T,
    /// p_0, Pa.
    pub return_pressure: T,
    /// 1/m, 1/kg.
    pub inverse_mass: T,
    /// F.
    pub friction: Friction<T>,
    /// F_L.
    pub load: Load<T>,
    /// F_stop and L.
    pub end_stops: EndStops<T>,
}

/// Pressure of a chamber that no valve connects with the pump, Pa: below any load.
const SHUT: Lanes = Lanes::new([f64::NEG_INFINITY; LANES]);

/// State of an axis: y m, v m/s, p1 Pa, p2 Pa, z m.
pub type State<T> = [T; 5];

/// Flows through the control edges of four axes at one time, before the pump's share is applied.
#[derive(Debug, Clone, Copy, Default)]
pub struct Edges {
    /// Mask of the axes whose valves extend the rod.
    extends: Lanes,
    /// Flow demanded from the pump, m3/s, never negative.
    pub demand: Lanes,
    /// Flow to the tank, m3/s.
    drain: Lanes,
    /// Pressure in the chamber that the valve connects with the pump, Pa; negative infinity while it is shut.
    fed: Lanes,
}

impl Edges {
    /// What the four axes together ask of the pump.
    #[inline]
    pub fn total_demand(&self) -> Demand {
        let (demand, fed): ([f64; LANES], [f64; LANES]) = (self.demand.to_array(), self.fed.to_array());
        let flow = (demand[0] + demand[1]) + (demand[2] + demand[3]);
        Demand { flow, load_pressure: fed[0].max(fed[1]).max(fed[2].max(fed[3])) }
    }

    /// Pressures in the chambers to which the pump delivers, Pa; negative infinity where it delivers nothing.
    pub fn delivered_to(&self) -> Lanes {
        self.demand.simd_gt(Lanes::ZERO).select(self.fed, SHUT)
    }
}

impl Cylinder<f64> {
    /// The cylinder of `plant` under `conditions`.
    pub fn new(plant: &Plant, stroke: f64, hydraulics: &Hydraulics, conditions: &Conditions) -> Self {
        let supply_pressure = hydraulics.supply.pressure * conditions.supply_pressure;
        let external = conditions.external_force * hydraulics.supply.pressure * plant.piston_area;
        let leakage = conditions.leakage / conditions.viscosity;
        Self {
            piston_area: plant.piston_area,
            rod_area: plant.rod_area,
            piston_dead_volume: plant.piston_dead_volume,
            rod_dead_volume: plant.rod_dead_volume,
            oil: OilMixture {
                compressibility: 1.0 / (hydraulics.oil.bulk_modulus * conditions.bulk_modulus),
                air: hydraulics.oil.air * conditions.air,
            },
            internal_leakage: plant.internal_leakage * leakage,
            external_leakage: plant.external_leakage * leakage,
            ports: PortValves::new(plant),
            conductance: conductance(plant.rated_flow * conditions.flow_gain, plant.rated_pressure_drop),
            compensated_drop: match hydraulics.supply.kind {
                SupplyKind::ConstantPressure => f64::INFINITY,
                SupplyKind::LoadSensing { .. } => plant.rated_pressure_drop,
            },
            supply_pressure,
            return_pressure: hydraulics.supply.return_pressure,
            inverse_mass: 1.0 / (plant.mass * conditions.mass),
            friction: Friction::new(plant, conditions.friction, conditions.viscosity),
            load: Load::new(plant, stroke, conditions.load_force, external),
            end_stops: EndStops::new(plant, stroke),
        }
    }

    /// Pressures (p1, p2), Pa, that hold the force `load`, N, against extension at rest with the valve shut, when the pump
    /// idles at `idle` Pa.
    ///
    /// Between two moves the pressure of the rod side lies between return and supply pressure; it starts in the middle.
    /// A load may pull so hard that the piston side would need less than the return pressure. Then the piston side
    /// starts at the return pressure, and the rod side holds the load.
    pub fn pressures_at_rest(&self, load: f64, idle: f64) -> (f64, f64) {
        let rod = 0.5 * (idle + self.return_pressure);
        let piston = (load + self.rod_area * rod) / self.piston_area;
        if piston >= self.return_pressure {
            return (piston, rod);
        }
        let rod = (self.piston_area * self.return_pressure - load) / self.rod_area;
        (self.return_pressure, rod.max(self.return_pressure))
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
            oil: OilMixture::pack(&axes.map(|c| c.oil)),
            internal_leakage: lanes(axes, |c| c.internal_leakage),
            external_leakage: lanes(axes, |c| c.external_leakage),
            ports: PortValves::pack(&axes.map(|c| c.ports)),
            conductance: lanes(axes, |c| c.conductance),
            compensated_drop: lanes(axes, |c| c.compensated_drop),
            supply_pressure: lanes(axes, |c| c.supply_pressure),
            return_pressure: lanes(axes, |c| c.return_pressure),
            inverse_mass: lanes(axes, |c| c.inverse_mass),
            friction: Friction::pack(&axes.map(|c| c.friction)),
            load: Load::pack(&axes.map(|c| c.load)),
            end_stops: EndStops::pack(&axes.map(|c| c.end_stops)),
        }
    }

    /// Flows through the control edges at the opening X = `opening` in [-1, 1] and the pump's pressure p_s = `supply`
    /// Pa, equation (3) for both directions.
    #[inline]
    pub fn edges(&self, [_, _, p1, p2, _]: &State<Lanes>, opening: Lanes, supply: f64) -> Edges {
        let extends = opening.simd_ge(Lanes::ZERO);
        let gain = self.conductance * opening.abs();
        let (fed, drained) = (extends.select(*p1, *p2), extends.select(*p2, *p1));
        let drop = (Lanes::splat(supply) - fed).fast_min(self.compensated_drop);
        Edges {
            extends,
            demand: gain * positive(smooth_root(drop)),
            drain: gain * smooth_root(drained - self.return_pressure),
            fed: opening.simd_ne(Lanes::ZERO).select(fed, SHUT),
        }
    }

    /// q1 into the piston side and q2 out of the rod side, m3/s, when every axis gets the part `share` of its demand.
    #[inline]
    pub fn flows(&self, edges: &Edges, share: Lanes) -> (Lanes, Lanes) {
        let feed = share * edges.demand;
        (edges.extends.select(feed, -edges.drain), edges.extends.select(edges.drain, -feed))
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
        let (q1, q2) = self.flows(edges, share);
        let (v1, v2) = self.volumes(position);
        let internal = self.internal_leakage * (p1 - p2);
        let into_piston =
            q1 - self.piston_area * velocity - internal - self.external_leakage * p1 - self.ports.outflow(p1);
        let into_rod = self.rod_area * velocity - q2 + internal - self.external_leakage * p2 - self.ports.outflow(p2);
        let (friction, deflection_rate) = self.friction.force(velocity, z);
        let force = self.piston_area * p1 - self.rod_area * p2 - friction - self.load.at(position)
            + self.end_stops.force(position, velocity);
        [
            velocity,
            force,
            self.oil.pressure_rate(p1, into_piston, v1),
            self.oil.pressure_rate(p2, into_rod, v2),
            deflection_rate,
        ]
    }
}
