//! The cylinder: control edges, two chambers, leakage, and the force balance.
//!
//! ```text
//! extend,  X >= 0:  q1 = s k X max(0, f(p_s - p1))    q2 =  k X f(p2 - p_0)          (3)
//! retract, X < 0:   q1 = k X f(p1 - p_0)              q2 =  s k X max(0, f(p_s - p2))
//! V1/beta_e dp1/dt = q1 - A1 v - C_ip (p1 - p2) - C_ep p1 - q_o(p1)                  (6)
//! V2/beta_e dp2/dt = A2 v - q2 + C_ip (p1 - p2) - C_ep p2 - q_o(p2)                  (6)
//! m dv/dt = A1 p1 - A2 p2 - F(v, z) - F_L(y) + F_stop(y, v)                          (9)
//! ```
//!
//! q1 into the piston side, q2 out of the rod side, m3/s; f the edge's law ([`crate::orifice`]), s the part of its
//! demand that the pump can serve ([`crate::supply`]), beta_e that of oil with air at the chamber's pressure
//! ([`crate::oil`]), q_o relief and make-up ([`crate::port`]), F friction with the deflection z
//! ([`crate::friction`]), F_L load ([`crate::load`]), F_stop ([`crate::end_stop`]); V1 = V01 + A1 y and
//! V2 = V02 + A2 (L - y), m3. Pressures count from the atmosphere.
//!
//! max(0, ..) is the check valve before each section: a load that is stronger than the pump does not sink when the
//! valve opens. The traps: with V02 at full stroke, an end stop that gives way eats into the dead volume, which has
//! a floor, [`LEAST_VOLUME`].

use pipeline::machine::{Hydraulics, Plant};

use crate::{
    conditions::Conditions,
    end_stop::EndStops,
    friction::Friction,
    lanes::{LANES, Lanes, lanes, positive},
    load::Load,
    oil::Oil,
    orifice::{conductance, smooth_root},
    port::PortValves,
};

/// Least volume of a chamber, as a part of its dead volume; reached only by a soft end stop pushed far in.
pub const LEAST_VOLUME: f64 = 0.1;

/// Parameters of the cylinder and the control edges of one axis at one time, or of four; SI units.
#[derive(Debug, Clone, Copy)]
pub struct Cylinder<T> {
    /// A1, m2.
    pub piston_area: T,
    /// A2, m2.
    pub rod_area: T,
    /// V01, m3 at y = 0.
    pub piston_dead_volume: T,
    /// V02, m3 at y = L.
    pub rod_dead_volume: T,
    /// Compressible oil.
    pub oil: Oil<T>,
    /// C_ip, m3/(s Pa).
    pub internal_leakage: T,
    /// C_ep, m3/(s Pa).
    pub external_leakage: T,
    /// Relief and make-up.
    pub ports: PortValves<T>,
    /// k of every control edge, m3/(s Pa^(1/2)).
    pub conductance: T,
    /// p_s as long as the flow suffices, Pa.
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

/// y m, v m/s, p1 Pa, p2 Pa, z m.
pub type State<T> = [T; 5];

/// What the control edges do at one time, before the pump's share.
#[derive(Debug, Clone, Copy, Default)]
pub struct Edges {
    /// Whether the valve extends.
    extends: Lanes,
    /// Flow asked of the pump, m3/s, at least 0.
    pub demand: Lanes,
    /// Flow to the tank, m3/s.
    drain: Lanes,
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
            oil: Oil {
                compressibility: 1.0 / (hydraulics.oil.bulk_modulus * conditions.bulk_modulus),
                air: hydraulics.oil.air * conditions.air,
            },
            internal_leakage: plant.internal_leakage * leakage,
            external_leakage: plant.external_leakage * leakage,
            ports: PortValves::new(plant),
            conductance: conductance(plant.rated_flow * conditions.flow_gain, plant.rated_pressure_drop),
            supply_pressure,
            return_pressure: hydraulics.supply.return_pressure,
            inverse_mass: 1.0 / (plant.mass * conditions.mass),
            friction: Friction::new(plant, conditions.friction, conditions.viscosity),
            load: Load::new(plant, stroke, conditions.load_force, external),
            end_stops: EndStops::new(plant, stroke),
        }
    }

    /// Pressures (p1, p2) that hold the load at rest at `position` with the valve shut, Pa.
    ///
    /// Between two moves the rod side keeps something between return and supply pressure; it starts in the middle.
    /// Where a load pulls so hard that the piston side would need less than the return pressure, that side starts at
    /// the return pressure and the rod side holds the load.
    pub fn pressures_at_rest(&self, position: f64) -> (f64, f64) {
        let load = self.load.at(position);
        let rod = 0.5 * (self.supply_pressure + self.return_pressure);
        let piston = (load + self.rod_area * rod) / self.piston_area;
        if piston >= self.return_pressure {
            return (piston, rod);
        }
        let rod = (self.piston_area * self.return_pressure - load) / self.rod_area;
        (self.return_pressure, rod.max(self.return_pressure))
    }
}

impl Cylinder<Lanes> {
    /// Four axes side by side.
    pub fn pack(axes: &[Cylinder<f64>; LANES]) -> Self {
        Self {
            piston_area: lanes(axes, |c| c.piston_area),
            rod_area: lanes(axes, |c| c.rod_area),
            piston_dead_volume: lanes(axes, |c| c.piston_dead_volume),
            rod_dead_volume: lanes(axes, |c| c.rod_dead_volume),
            oil: Oil { compressibility: lanes(axes, |c| c.oil.compressibility), air: lanes(axes, |c| c.oil.air) },
            internal_leakage: lanes(axes, |c| c.internal_leakage),
            external_leakage: lanes(axes, |c| c.external_leakage),
            ports: PortValves::pack(&axes.map(|c| c.ports)),
            conductance: lanes(axes, |c| c.conductance),
            supply_pressure: lanes(axes, |c| c.supply_pressure),
            return_pressure: lanes(axes, |c| c.return_pressure),
            inverse_mass: lanes(axes, |c| c.inverse_mass),
            friction: Friction::pack(&axes.map(|c| c.friction)),
            load: Load::pack(&axes.map(|c| c.load)),
            end_stops: EndStops::pack(&axes.map(|c| c.end_stops)),
        }
    }

    /// Flows through the control edges at `opening` in [-1, 1], equation (3) for both directions.
    #[inline]
    pub fn edges(&self, [_, _, p1, p2, _]: &State<Lanes>, opening: Lanes) -> Edges {
        let extends = opening.simd_ge(Lanes::ZERO);
        let gain = self.conductance * opening.abs();
        Edges {
            extends,
            demand: gain * positive(smooth_root(self.supply_pressure - extends.select(*p1, *p2))),
            drain: gain * smooth_root(extends.select(*p2, *p1) - self.return_pressure),
        }
    }

    /// Flow into the piston side and out of the rod side when the pump serves `share` of the demand, m3/s.
    #[inline]
    pub fn flows(&self, edges: &Edges, share: Lanes) -> (Lanes, Lanes) {
        let feed = share * edges.demand;
        (edges.extends.select(feed, -edges.drain), edges.extends.select(edges.drain, -feed))
    }

    /// Volumes of piston and rod side at `position`, m3.
    #[inline]
    pub fn volumes(&self, position: Lanes) -> (Lanes, Lanes) {
        let piston = self.piston_dead_volume + self.piston_area * position;
        let rod = self.rod_dead_volume + self.rod_area * (self.end_stops.stroke - position);
        let least = Lanes::splat(LEAST_VOLUME);
        (piston.fast_max(least * self.piston_dead_volume), rod.fast_max(least * self.rod_dead_volume))
    }

    /// Rates of y, v, p1, p2 and z.
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
            force * self.inverse_mass,
            self.oil.pressure_rate(p1, into_piston, v1),
            self.oil.pressure_rate(p2, into_rod, v2),
            deflection_rate,
        ]
    }
}
