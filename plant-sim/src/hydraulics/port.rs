//! The relief valve and the make-up valve at the port of a chamber.
//!
//! ```text
//! q_out = g_r max(0, p - p_r) - g_m max(0, -p)
//! ```
//!
//! q_out flow out of the chamber, m3/s; p pressure above the atmosphere, Pa; p_r pressure at which the relief valve
//! opens, Pa; g_r and g_m slopes of the valves, m3/(s Pa). With g_r the rated flow of the axis passes at 1.05 p_r, with
//! g_m at half a bar of vacuum.
//!
//! The relief valve limits the pressure that a load can cause. The make-up valve draws oil from the tank before a
//! chamber that is pulled apart cavitates.
//!
//! Trap: both valves are stiff. Steeper slopes need a smaller step ([`crate::plant::stiffness`]).

use pipeline::machine::Plant;

use crate::lanes::{LANES, Lanes, lanes, positive};

/// Part of the opening pressure by which the pressure exceeds it when the relief valve passes the rated flow.
const RELIEF_OVERRIDE: f64 = 0.05;

/// Vacuum at which the make-up valve passes the rated flow, Pa.
const MAKE_UP_VACUUM: f64 = 5e4;

/// Relief and make-up valve of either chamber, of one axis (`T = f64`) or of four (`T = Lanes`).
#[derive(Debug, Clone, Copy)]
pub struct PortValves<T> {
    /// p_r, Pa.
    pub relief_pressure: T,
    /// g_r, m3/(s Pa).
    pub relief_gain: T,
    /// g_m, m3/(s Pa).
    pub make_up_gain: T,
}

impl PortValves<f64> {
    /// Valves of `plant`.
    pub fn new(plant: &Plant) -> Self {
        Self {
            relief_pressure: plant.relief_pressure,
            relief_gain: plant.rated_flow / (RELIEF_OVERRIDE * plant.relief_pressure),
            make_up_gain: plant.rated_flow / MAKE_UP_VACUUM,
        }
    }
}

impl PortValves<Lanes> {
    /// Puts four axes side by side.
    pub fn pack(axes: &[PortValves<f64>; LANES]) -> Self {
        Self {
            relief_pressure: lanes(axes, |valves| valves.relief_pressure),
            relief_gain: lanes(axes, |valves| valves.relief_gain),
            make_up_gain: lanes(axes, |valves| valves.make_up_gain),
        }
    }

    /// Flow out of a chamber at `pressure` Pa above the atmosphere, m3/s; negative where oil is drawn in.
    #[inline]
    pub fn outflow(&self, pressure: Lanes) -> Lanes {
        self.relief_gain * positive(pressure - self.relief_pressure) - self.make_up_gain * positive(-pressure)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_valves_open_only_above_relief_pressure_and_below_the_atmosphere() {
        let machine = pipeline::machine::Machine::four_axes(&[]).unwrap();
        let plant = machine.axes[0].plant.clone().unwrap();
        let valves = PortValves::pack(&[PortValves::new(&plant); LANES]);
        let outflow = |pressure| valves.outflow(Lanes::splat(pressure)).to_array()[0];
        for shut in [0.0, 1e5, 2.5e7, plant.relief_pressure] {
            assert_eq!(outflow(shut), 0.0);
        }
        assert!((outflow(1.05 * plant.relief_pressure) / plant.rated_flow - 1.0).abs() < 1e-9);
        assert!((outflow(-5e4) / plant.rated_flow + 1.0).abs() < 1e-9);
    }
}
