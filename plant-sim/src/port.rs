//! The valves at the ports of a chamber: relief and make-up.
//!
//! ```text
//! q_out = g_r max(0, p - p_r) - g_m max(0, -p)
//! ```
//!
//! q_out m3/s out of the chamber; p Pa above the atmosphere, p_r Pa where the relief valve opens; g_r and g_m
//! m3/(s Pa), such that the rated flow of the axis passes 5 % above p_r, and at half a bar of vacuum.
//!
//! The relief valve bounds what a load can do to the oil, the make-up valve draws oil from the tank before a chamber
//! that is pulled cavitates. The trap: both are stiff; a steeper one needs a smaller step ([`crate::stiffness`]).

use pipeline::machine::Plant;

use crate::lanes::{LANES, Lanes, lanes, positive};

/// Part of its pressure by which a relief valve is overridden at the rated flow.
const RELIEF_OVERRIDE: f64 = 0.05;

/// Vacuum at which the make-up valve passes the rated flow, Pa.
const MAKE_UP_VACUUM: f64 = 5e4;

/// Relief and make-up valve of either chamber of one axis, or of four.
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
    /// The valves of `plant`.
    pub fn new(plant: &Plant) -> Self {
        Self {
            relief_pressure: plant.relief_pressure,
            relief_gain: plant.rated_flow / (RELIEF_OVERRIDE * plant.relief_pressure),
            make_up_gain: plant.rated_flow / MAKE_UP_VACUUM,
        }
    }
}

impl PortValves<Lanes> {
    /// Four axes side by side.
    pub fn pack(axes: &[PortValves<f64>; LANES]) -> Self {
        Self {
            relief_pressure: lanes(axes, |valves| valves.relief_pressure),
            relief_gain: lanes(axes, |valves| valves.relief_gain),
            make_up_gain: lanes(axes, |valves| valves.make_up_gain),
        }
    }

    /// Flow out of a chamber at `pressure` Pa above the atmosphere, m3/s; less than zero where oil is drawn in.
    #[inline]
    pub fn outflow(&self, pressure: Lanes) -> Lanes {
        self.relief_gain * positive(pressure - self.relief_pressure) - self.make_up_gain * positive(-pressure)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_valves_open_at_relief_pressure_and_at_vacuum_only() {
        let machine = pipeline::machine::Machine::load(None, &[]).unwrap();
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
