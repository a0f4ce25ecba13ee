//! The control edges of one valve, and the valves that act on the same flows.
//!
//! ```text
//! feed   q_f = s k |X| max(0, f(min(dp_c, p_s - p_f)))                       (3)
//! drain  q_d = o m k |X| f(p_d - p_0)      o = clamp((p_d + R p_f - p_cb)/(0.2 p_cb), 0, 1)  (3)
//! regenerate   q_r = r k |X| max(0, f(p_d - p_f))
//! leak         q_s = C_s (p - p_0), out of either chamber
//! extend,  X >= 0:  f is side 1, d is side 2:  q1 = q_f + q_r     q2 = q_d + q_r
//! retract, X < 0:   f is side 2, d is side 1:  q1 = -(q_d + q_r)  q2 = -(q_f + q_r)
//! ```
//!
//! | symbol | unit | meaning |
//! |---|---|---|
//! | X, k | 1, m3/(s Pa^(1/2)) | opening, conductance of an open edge; f is the law of [`crate::hydraulics::orifice`] |
//! | p_f, p_d | Pa | pressures of the chamber that is fed and of the one that drains |
//! | p_s, s | Pa, 1 | pressure of the pump, part of its demand that every axis gets, [`crate::hydraulics::supply`] |
//! | dp_c | Pa | drop that a pressure compensator leaves to the edge that feeds; without a compensator unbounded |
//! | m, r | 1 | openings of the draining and of the regenerating edge, divided by that of the edge that feeds |
//! | C_s | m3/(s Pa) | leakage of the spool to the return line; 0 where a load-holding valve keeps the oil |
//! | o, R, p_cb | 1, 1, Pa | opening, pilot ratio and setting of the counterbalance valve; without one o = 1 |
//!
//! **Check valve.** The function max(0, ..) of the feed stands for the check valve before the edge: a load that is
//! stronger than the pump does not sink when the valve opens.
//!
//! **Meter-out.** Edges that drain are narrower than edges that feed, so that a load that pulls does not tear the
//! chamber that is fed apart. Openings of 0.4 of the feed are published with OpenHydraulics, for an excavator's boom.
//!
//! **Regeneration.** While a load pulls, the chamber that drains has the higher pressure. An edge with a check valve
//! lets its oil go to the chamber that is fed, which then needs less of the pump. Assumed: it opens with the spool.
//!
//! **Counterbalance.** A valve behind the chamber that drains holds a load below its setting. It opens when the
//! pressure of the chamber that is fed, times the pilot ratio, makes up the rest. A load that runs ahead of the pump
//! lowers that pressure, and the valve throttles. Assumed: it opens in proportion, fully at [`OVERRIDE`] above the
//! setting, without dynamics.
//!
//! **Leakage of the spool.** Assumed laminar, and the same for either chamber. Without it a loaded axis rises slowly,
//! because leakage across the piston evens the pressures of two different areas out; with it the axis sinks, as it does
//! on machines. A load-holding (anti-drift) valve keeps the leakage from its chamber. Assumed: it is tight and open
//! without delay while the spool is.
//!
//! Trap: a counterbalance valve closes a loop over the piston, which oscillates at high pilot ratios, as it does on
//! machines. Linearised about a steady motion it is stable without friction where R < A_d C_f/(A_f C_d), with the areas
//! A and compliances C = V/beta_e of the chambers; in the middle of the stroke that is a ratio near 1.

use pipeline::machine::{Directions, Hydraulics, Plant, SupplyKind};

use crate::{
    hydraulics::{
        orifice::{conductance, smooth_root},
        supply::Demand,
    },
    lanes::{LANES, Lanes, lanes, positive},
};

/// Part of its setting by which the pressure exceeds it when a counterbalance valve is fully open.
pub const OVERRIDE: f64 = 0.2;

/// Pressure of a chamber that no valve connects with the pump, Pa: below any load.
const SHUT: Lanes = Lanes::new([f64::NEG_INFINITY; LANES]);

/// One parameter in either direction: while extending, while retracting.
type Both<T> = [T; 2];

/// Control edges of one axis (`T = f64`) or of four (`T = Lanes`).
#[derive(Debug, Clone, Copy)]
pub struct ControlEdges<T> {
    /// k, m3/(s Pa^(1/2)).
    pub conductance: T,
    /// dp_c, Pa; infinite without a compensator.
    pub compensated_drop: T,
    /// p_0, Pa.
    pub return_pressure: T,
    /// m.
    pub meter_out: Both<T>,
    /// r.
    pub regeneration: Both<T>,
    /// 1/(0.2 p_cb), 1/Pa; 0 without a counterbalance valve.
    pub own_gain: Both<T>,
    /// R/(0.2 p_cb), 1/Pa; 0 without a counterbalance valve.
    pub pilot_gain: Both<T>,
    /// C_s of piston side and rod side, m3/(s Pa).
    pub leakage: [T; 2],
    /// o before it is limited, with both chambers empty: 1 without a counterbalance valve.
    pub pilot_offset: Both<T>,
}

/// Flows through the control edges of four axes at one time, before the pump's share is applied.
#[derive(Debug, Clone, Copy, Default)]
pub struct Edges {
    /// Mask of the axes whose valves extend the rod.
    extends: Lanes,
    /// q_f/s, flow demanded from the pump, m3/s, never negative.
    demand: Lanes,
    /// q_d, flow to the tank, m3/s.
    drain: Lanes,
    /// q_r, flow from one chamber to the other, m3/s.
    regenerated: Lanes,
    /// p_f, Pa; negative infinity while the valve is shut.
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

    /// s q_f of each axis, flow from the pump, m3/s, when every axis gets the part `share` of its demand.
    #[inline]
    pub fn from_pump(&self, share: Lanes) -> Lanes {
        share * self.demand
    }

    /// q1 into the piston side and q2 out of the rod side, m3/s, when every axis gets the part `share` of its demand.
    #[inline]
    pub fn flows(&self, share: Lanes) -> (Lanes, Lanes) {
        let (feed, drain) = (self.from_pump(share) + self.regenerated, self.drain + self.regenerated);
        (self.extends.select(feed, -drain), self.extends.select(drain, -feed))
    }
}

impl ControlEdges<f64> {
    /// Edges of `plant` with `flow_gain` times its rated flow and `leakage` times its leakage.
    pub fn new(plant: &Plant, hydraulics: &Hydraulics, flow_gain: f64, leakage: f64) -> Self {
        let both = |of: Directions| [of.extend, of.retract];
        let counterbalance = both(plant.ports.counterbalance);
        let own_gain = counterbalance.map(|setting| if setting > 0.0 { 1.0 / (OVERRIDE * setting) } else { 0.0 });
        Self {
            conductance: conductance(plant.rated_flow * flow_gain, plant.rated_pressure_drop),
            compensated_drop: match hydraulics.supply.kind {
                SupplyKind::ConstantPressure => f64::INFINITY,
                SupplyKind::LoadSensing { .. } => plant.rated_pressure_drop,
            },
            return_pressure: hydraulics.supply.return_pressure,
            meter_out: both(plant.ports.meter_out),
            regeneration: both(plant.ports.regeneration),
            leakage: plant
                .ports
                .load_holding
                .sides()
                .map(|held| if held { 0.0 } else { plant.ports.spool_leakage * leakage }),
            own_gain,
            pilot_gain: own_gain.map(|gain| plant.ports.pilot_ratio * gain),
            pilot_offset: counterbalance.map(|setting| if setting > 0.0 { -1.0 / OVERRIDE } else { 1.0 }),
        }
    }

    /// Largest slope of a flow over the pressure of its own chamber, m3/(s Pa): of all edges that are open at once, at
    /// a transition pressure of `transition` Pa.
    pub fn steepest(&self, transition: f64) -> f64 {
        let wide = |side: usize| 1.0f64.max(self.meter_out[side]) + self.regeneration[side];
        self.conductance * wide(0).max(wide(1)) / transition.sqrt()
    }

    /// Rate-giving slope of a counterbalance valve, m3/(s Pa): that over the pressure of its own chamber, which is at
    /// most 1.2 p_cb while the valve is not fully open, times max(1, R/6.75).
    ///
    /// The pilot closes a loop through the piston: with the rate r by its own chamber and the rate w of the springs,
    /// that loop is no faster than (R r w^2)^(1/3), which is at most r + w up to R = 27/4.
    pub fn piloted(&self) -> f64 {
        let slope = |side: usize| {
            let gain = self.own_gain[side];
            if gain == 0.0 {
                return 0.0;
            }
            let open = (1.0 + OVERRIDE) / (OVERRIDE * gain);
            self.meter_out[side] * open.sqrt() * gain.max(self.pilot_gain[side] / 6.75)
        };
        self.conductance * slope(0).max(slope(1))
    }
}

impl ControlEdges<Lanes> {
    /// Puts four axes side by side.
    pub fn pack(axes: &[ControlEdges<f64>; LANES]) -> Self {
        let both = |of: fn(&ControlEdges<f64>) -> &Both<f64>| [0, 1].map(|side| lanes(axes, |e| of(e)[side]));
        Self {
            conductance: lanes(axes, |e| e.conductance),
            compensated_drop: lanes(axes, |e| e.compensated_drop),
            return_pressure: lanes(axes, |e| e.return_pressure),
            meter_out: both(|e| &e.meter_out),
            regeneration: both(|e| &e.regeneration),
            leakage: both(|e| &e.leakage),
            own_gain: both(|e| &e.own_gain),
            pilot_gain: both(|e| &e.pilot_gain),
            pilot_offset: both(|e| &e.pilot_offset),
        }
    }

    /// Leakage of the spool out of piston side and rod side at the pressures p1 = `piston` and p2 = `rod`, m3/s.
    #[inline]
    pub fn leaks(&self, piston: Lanes, rod: Lanes) -> [Lanes; 2] {
        [self.leakage[0] * (piston - self.return_pressure), self.leakage[1] * (rod - self.return_pressure)]
    }

    /// Flows at the opening X = `opening` in [-1, 1], the pressures p1 = `piston` and p2 = `rod` of the chambers and
    /// the pump's pressure p_s = `supply` Pa.
    #[inline]
    pub fn at(&self, opening: Lanes, piston: Lanes, rod: Lanes, supply: f64) -> Edges {
        let extends = opening.simd_ge(Lanes::ZERO);
        let of = |[extend, retract]: Both<Lanes>| extends.select(extend, retract);
        let (fed, drained) = (extends.select(piston, rod), extends.select(rod, piston));
        let gain = self.conductance * opening.abs();
        let drop = (Lanes::splat(supply) - fed).fast_min(self.compensated_drop);
        let balanced = of(self.pilot_offset) + drained * of(self.own_gain) + fed * of(self.pilot_gain);
        let balanced = balanced.fast_max(Lanes::ZERO).fast_min(Lanes::ONE);
        Edges {
            extends,
            demand: gain * positive(smooth_root(drop)),
            drain: gain * of(self.meter_out) * balanced * smooth_root(drained - self.return_pressure),
            regenerated: gain * of(self.regeneration) * positive(smooth_root(drained - fed)),
            fed: opening.simd_ne(Lanes::ZERO).select(fed, SHUT),
        }
    }
}

#[cfg(test)]
mod tests {
    use pipeline::machine::Machine;

    use super::*;

    fn edges(change: impl Fn(&mut Plant)) -> ControlEdges<Lanes> {
        let machine = Machine::four_axes(&[("scenario".to_owned(), "nominal".to_owned())]).unwrap();
        let mut plant = machine.axes[0].plant.clone().unwrap();
        change(&mut plant);
        ControlEdges::pack(&[ControlEdges::new(&plant, &machine.hydraulics.unwrap(), 1.0, 1.0); LANES])
    }

    const PRESSURES: [f64; 6] = [-9e4, 0.0, 3e5, 8e6, 24.9e6, 31e6];

    #[test]
    fn with_everything_off_the_flows_are_those_of_one_spool_bit_for_bit() {
        let edges = edges(|_| ());
        for x in [-1.0, -0.3, 0.0, 0.02, 0.7] {
            for (p1, p2) in PRESSURES.into_iter().flat_map(|p1| PRESSURES.map(|p2| (p1, p2))) {
                let [x, p1, p2, share] = [x, p1, p2, 0.8].map(Lanes::splat);
                let extends = x.simd_ge(Lanes::ZERO);
                let gain = edges.conductance * x.abs();
                let demand = gain * positive(smooth_root(Lanes::splat(25e6) - extends.select(p1, p2)));
                let drain = gain * smooth_root(extends.select(p2, p1) - edges.return_pressure);
                let expected = (extends.select(share * demand, -drain), extends.select(drain, -(share * demand)));
                let found = edges.at(x, p1, p2, 25e6).flows(share);
                assert_eq!(found.0.to_array(), expected.0.to_array());
                assert_eq!(found.1.to_array(), expected.1.to_array());
                assert_eq!(edges.leaks(p1, p2), [Lanes::ZERO; 2]);
            }
        }
    }

    #[test]
    fn oil_that_regenerates_leaves_one_chamber_and_enters_the_other() {
        let (plain, regenerating) = (edges(|_| ()), edges(|plant| plant.ports.regeneration = Directions::both(0.5)));
        for x in [-0.6, 0.6].map(Lanes::splat) {
            for (p1, p2) in PRESSURES.into_iter().flat_map(|p1| PRESSURES.map(|p2| (p1, p2))) {
                let [p1, p2] = [p1, p2].map(Lanes::splat);
                let flows = |edges: &ControlEdges<Lanes>| edges.at(x, p1, p2, 25e6).flows(Lanes::ONE);
                let (with, without) = (flows(&regenerating), flows(&plain));
                let (into, out) = ((with.0 - without.0).to_array()[0], (with.1 - without.1).to_array()[0]);
                assert!((into - out).abs() < 1e-15, "{into} {out}");
                let towards_fed = if x.to_array()[0] > 0.0 { p2 - p1 } else { p1 - p2 }.to_array()[0];
                assert_eq!(into != 0.0, towards_fed > 0.0, "{into} at {towards_fed} Pa");
            }
        }
    }
}
