//! The supply: one pump for all axes, and what they get of its flow.
//!
//! ```text
//! s = min(1, Q/(sum of q_i))          p_s' = p_s - (1 - s^2) min over i of (p_s - p_i)
//! ```
//!
//! q_i m3/s what axis i asks for at the pump's pressure p_s Pa, equation (3); Q m3/s the pump's largest flow; s the
//! part of its demand that every axis gets; p_i Pa the pressure in the chamber that is fed, p_s' what is left of the
//! supply pressure.
//!
//! That is load-independent flow sharing, LUDV: behind every metering edge a compensator keeps the pressure drop to
//! the same part s^2 of what it would be, so that every flow falls to the part s, whatever the loads are. The axis
//! with the highest load needs no compensation: it sets p_s', and the compensators of the others take up
//! (1 - s^2)(p_i of the highest - p_i), which is never less than zero. As long as the flow suffices s is 1 and (3) as
//! printed holds.
//!
//! The trap: without compensation the lightest load would take all the flow, and the boom would stand still.

use crate::{cylinder::Edges, lanes::Lanes};

/// The pump at one time.
#[derive(Debug, Clone, Copy)]
pub struct Supply {
    /// p_s, Pa.
    pub pressure: f64,
    /// Q, m3/s.
    pub flow: f64,
}

impl Supply {
    /// s for axes that ask for `demand` m3/s together.
    #[inline]
    pub fn share(&self, demand: f64) -> f64 {
        if demand > self.flow { self.flow / demand } else { 1.0 }
    }

    /// p_s', Pa, that is left for an axis with `fed` Pa in the chamber it feeds, when all get `share`; the axis with the
    /// highest load has the highest, which is the pump's.
    pub fn sagged(&self, share: f64, fed: f64) -> f64 {
        self.pressure - (1.0 - share * share) * (self.pressure - fed)
    }
}

/// Sum of the demands of four axes, m3/s.
#[inline]
pub fn demand(edges: &Edges) -> f64 {
    let demand: [f64; 4] = Lanes::to_array(edges.demand);
    (demand[0] + demand[1]) + (demand[2] + demand[3])
}

#[cfg(test)]
mod tests {
    use super::*;

    const PUMP: Supply = Supply { pressure: 25e6, flow: 8e-3 };

    #[test]
    fn everybody_gets_the_same_part_when_the_flow_does_not_suffice() {
        assert_eq!(PUMP.share(7e-3), 1.0);
        assert_eq!(PUMP.share(8e-3), 1.0);
        assert_eq!(PUMP.share(16e-3), 0.5);
    }

    #[test]
    fn the_pressure_sags_to_what_the_highest_load_still_needs() {
        assert_eq!(PUMP.sagged(1.0, 12e6), 25e6);
        // A quarter of the drop is left over the edge of the highest load.
        assert!((PUMP.sagged(0.5, 12e6) - (12e6 + 0.25 * 13e6)).abs() < 1.0);
    }
}
