//! Where the work of the pump goes: power terms and stored energy of the whole machine, for checks and reports.
//!
//! ```text
//! dE/dt = P_pump + P_oil - P_valves - P_leakage - P_ports - P_friction - P_stops - P_external - P_soil
//! E      = T + U + sum V_i u(p_i) + sum C_wi (p_i^2/2 + p_i u(p_i)/3)               P_oil = sum u(p_i) q_i
//! P_pump = p_s sum q_feed                           P_valves   = P_pump - sum (p1 q1 - p2 q2)
//! P_leakage = C_ip (p1 - p2)^2 + C_ep (p1^2 + p2^2) + p1 q_s1 + p2 q_s2
//! P_ports = p1 q_o(p1) + p2 q_o(p2)
//! P_friction = F v   P_stops = -F_stop v   P_external = F_ext v
//! du/dp  = (u + p)/beta_e(p),  u(0) = 0
//! ```
//!
//! T and U kinetic and potential energy of the mechanism, J ([`crate::coupling`]); V_i and p_i volume, m3, and
//! pressure, Pa, of a chamber; C_wi and q_si as in [`crate::actuator::cylinder`]; q_i flow of oil into it, less what
//! leaves it, m3/s; u energy of compression by volume, J/m3; the other symbols as in [`crate::actuator`]. P_valves is
//! all that is lost between pump, chambers and tank. P_oil is the energy that oil carries into a chamber because it is
//! compressed there. P_friction and P_stops contain what bristles and stops store and give back.
//!
//! Trap: V p^2/(2 beta) is not the energy of a chamber: its oil comes and goes, and air makes beta_e depend on p.

use mechanism::AXES;

use super::PlantSim;
use crate::{
    actuator::cylinder::Cylinder,
    hydraulics::oil::{ADIABATIC_INDEX, ATMOSPHERE, LOWEST_PRESSURE, OilMixture},
    integration::FourAxes,
    lanes::{LANES, Lanes},
};

/// Power terms, W; all but `pump` and `oil` are taken from the machine.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Power {
    /// Work of the pump.
    pub pump: f64,
    /// Energy of compression that oil carries into the chambers.
    pub oil: f64,
    /// Lost between pump, chambers and tank.
    pub valves: f64,
    /// Lost by leakage.
    pub leakage: f64,
    /// Lost in relief and make-up valves.
    pub ports: f64,
    /// Taken by friction.
    pub friction: f64,
    /// Taken by the end stops.
    pub stops: f64,
    /// Taken by external forces.
    pub external: f64,
    /// Lost in the soil.
    pub soil: f64,
}

impl Power {
    /// dE/dt, W.
    pub fn growth(&self) -> f64 {
        let lost = self.valves + self.leakage + self.ports + self.friction + self.stops + self.external + self.soil;
        self.pump + self.oil - lost
    }
}

/// Stored energy, J.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stored {
    /// T.
    pub kinetic: f64,
    /// U.
    pub potential: f64,
    /// In the compressed oil of all chambers and in the walls of their hoses.
    pub oil: f64,
}

impl Stored {
    /// E, J.
    pub fn total(&self) -> f64 {
        self.kinetic + self.potential + self.oil
    }
}

/// Observes the energy of a machine whose first four axes a mechanism couples.
#[derive(Debug, Clone)]
pub struct EnergyObserver {
    compression: Compression,
}

impl EnergyObserver {
    /// An observer for the oil that `plant` has now; a scenario that changes its stiffness or its air needs a new one.
    pub fn new(plant: &PlantSim) -> Self {
        let oil = plant.axes.first().map(|four| {
            let oil = four.cylinder().oil;
            OilMixture { compressibility: oil.compressibility.to_array()[0], air: oil.air.to_array()[0] }
        });
        Self { compression: Compression::new(oil.unwrap_or(OilMixture { compressibility: 1e-9, air: 0.0 })) }
    }

    /// Power terms and stored energy of `plant` now, of its first four axes.
    pub fn observe(&self, plant: &PlantSim) -> (Power, Stored) {
        let Some(four) = plant.axes.first() else {
            return <(Power, Stored)>::default();
        };
        let mut power = Power::default();
        let mut stored = Stored::default();
        let state = four.state().map(Lanes::to_array);
        let chambers = Chambers::new(four);
        for (lane, axis) in plant.axes().iter().enumerate().take(AXES) {
            let (p1, p2, q1, q2) = (axis.piston_pressure, axis.rod_pressure, axis.piston_flow, axis.rod_flow);
            let pump = plant.supply_pressure() * axis.pump_flow;
            power.pump += pump;
            power.valves += pump - (p1 * q1 - p2 * q2);
            let c = &chambers;
            power.leakage += c.internal[lane] * (p1 - p2) + c.external[0][lane] * p1 + c.external[1][lane] * p2;
            power.ports += c.ports[0][lane] * p1 + c.ports[1][lane] * p2;
            power.friction += c.friction[lane] * axis.velocity;
            power.stops -= c.stops[lane] * axis.velocity;
            power.external += c.load[lane] * axis.velocity;

            let into_piston = q1 - c.internal[lane] - c.external[0][lane] - c.ports[0][lane];
            let into_rod = c.internal[lane] - q2 - c.external[1][lane] - c.ports[1][lane];
            let (u1, u2) = (self.compression.at(p1), self.compression.at(p2));
            power.oil += u1 * into_piston + u2 * into_rod;
            stored.oil += u1 * c.volumes[0][lane] + u2 * c.volumes[1][lane];
            // The last term, of the oil in the widened hose, is exact for oil without air.
            let wall = |side: usize, p: f64, u: f64| c.walls[side][lane] * p * (0.5 * p + u / 3.0);
            stored.oil += wall(0, p1, u1) + wall(1, p2, u2);
        }
        if let Some(coupling) = four.coupling() {
            (stored.kinetic, stored.potential) = coupling.energy(&state[0], &state[1]);
            power.soil = coupling.soil_power(&state[0], &state[1]);
        }
        (power, stored)
    }
}

/// Flows out of the chambers beside the valve, m3/s, forces on the pistons, N, and volumes, m3, of four axes now.
struct Chambers {
    internal: [f64; LANES],
    external: [[f64; LANES]; 2],
    ports: [[f64; LANES]; 2],
    volumes: [[f64; LANES]; 2],
    /// m3/Pa.
    walls: [[f64; LANES]; 2],
    friction: [f64; LANES],
    stops: [f64; LANES],
    load: [f64; LANES],
}

impl Chambers {
    fn new(four: &FourAxes) -> Self {
        let (cylinder, [y, v, p1, p2, z]): (&Cylinder<Lanes>, _) = (four.cylinder(), *four.state());
        let (v1, v2) = cylinder.volumes(y);
        let [spool1, spool2] = cylinder.edges.leaks(p1, p2);
        Self {
            internal: (cylinder.internal_leakage * (p1 - p2)).to_array(),
            external: [(p1, spool1), (p2, spool2)].map(|(p, spool)| (cylinder.external_leakage * p + spool).to_array()),
            ports: [p1, p2].map(|p| cylinder.ports.outflow(p).to_array()),
            volumes: [v1, v2].map(Lanes::to_array),
            walls: cylinder.walls.map(Lanes::to_array),
            friction: cylinder.friction.force(v, z).0.to_array(),
            stops: cylinder.end_stops.force(y, v).to_array(),
            load: cylinder.load.at(y).to_array(),
        }
    }
}

/// u(p), as a table over the logarithm of the absolute pressure with cubic pieces between its knots.
#[derive(Debug, Clone)]
struct Compression {
    oil: OilMixture<f64>,
    /// u below the atmosphere and from it on, J/m3, each with [`SPACING`] between its knots.
    below: Vec<f64>,
    above: Vec<f64>,
}

/// Distance of two knots in the logarithm of the absolute pressure.
const SPACING: f64 = 0.002;

/// Highest pressure of the table, Pa above the atmosphere.
const HIGHEST_PRESSURE: f64 = 2e8;

impl Compression {
    fn new(oil: OilMixture<f64>) -> Self {
        let mut compression = Self { oil, below: Vec::new(), above: Vec::new() };
        compression.below = compression.knots(-SPACING, LOWEST_PRESSURE);
        compression.above = compression.knots(SPACING, HIGHEST_PRESSURE);
        compression
    }

    /// du/ds with s = ln(absolute pressure/p_a).
    fn slope(&self, s: f64, u: f64) -> f64 {
        let absolute = ATMOSPHERE * s.exp();
        let air = self.oil.air * (-s / ADIABATIC_INDEX).exp();
        let compressibility = (self.oil.compressibility + air / (ADIABATIC_INDEX * absolute)) / (1.0 + air);
        (u + absolute - ATMOSPHERE) * absolute * compressibility
    }

    /// u at the knots from p = 0 to beyond `last` Pa, by the Runge-Kutta method.
    fn knots(&self, spacing: f64, last: f64) -> Vec<f64> {
        let count = (((last + ATMOSPHERE) / ATMOSPHERE).ln() / spacing).ceil() as usize + 2;
        let (mut u, mut knots) = (0.0, Vec::with_capacity(count));
        for knot in 0..count {
            knots.push(u);
            let (s, half) = (knot as f64 * spacing, 0.5 * spacing);
            let k1 = self.slope(s, u);
            let k2 = self.slope(s + half, u + half * k1);
            let k3 = self.slope(s + half, u + half * k2);
            let k4 = self.slope(s + spacing, u + spacing * k3);
            u += spacing / 6.0 * (k1 + 2.0 * (k2 + k3) + k4);
        }
        knots
    }

    /// u at `pressure` Pa above the atmosphere, J/m3.
    fn at(&self, pressure: f64) -> f64 {
        let s = (pressure.clamp(LOWEST_PRESSURE, HIGHEST_PRESSURE) / ATMOSPHERE).ln_1p();
        let (knots, spacing) = if s < 0.0 { (&self.below, -SPACING) } else { (&self.above, SPACING) };
        let place = s / spacing;
        let knot = place as usize;
        let (x, begin) = (place - knot as f64, knot as f64 * spacing);
        let (u0, u1) = (knots[knot], knots[knot + 1]);
        let (m0, m1) = (spacing * self.slope(begin, u0), spacing * self.slope(begin + spacing, u1));
        let (x2, rest) = (x * x, 1.0 - x);
        rest * rest * ((1.0 + 2.0 * x) * u0 + x * m0) + x2 * ((3.0 - 2.0 * x) * u1 - rest * m1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_energy_of_compression_is_that_of_an_elastic_oil_without_air() {
        // Without air the density is exp(p/beta), and u = beta (exp(p/beta) - 1) - p.
        let beta = 1.4e9;
        let compression = Compression::new(OilMixture { compressibility: 1.0 / beta, air: 0.0 });
        for pressure in [-9e4, 1e3, 1e5, 2e6, 1e7, 3e7, 9e7] {
            let expected = beta * f64::exp_m1(pressure / beta) - pressure;
            let found = compression.at(pressure);
            assert!((found / expected - 1.0).abs() < 1e-6, "{pressure} Pa: {found} for {expected}");
        }
    }

    #[test]
    fn its_slope_is_energy_and_pressure_by_the_modulus() {
        let compression = Compression::new(OilMixture { compressibility: 1.0 / 1.4e9, air: 0.01 });
        for pressure in [-9e4, -2e4, 3e4, 7e5, 2e6, 1.1e7, 3.3e7] {
            let step = 1e-3 * (pressure + ATMOSPHERE);
            let found = (compression.at(pressure + step) - compression.at(pressure - step)) / (2.0 * step);
            let s = (pressure / ATMOSPHERE).ln_1p();
            let expected = compression.slope(s, compression.at(pressure)) / (pressure + ATMOSPHERE);
            assert!((found / expected - 1.0).abs() < 1e-5, "{pressure} Pa: {found} for {expected}");
        }
    }
}
