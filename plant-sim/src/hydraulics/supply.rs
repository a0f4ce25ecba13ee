//! The pump that feeds all axes, and the part of its flow that each axis gets.
//!
//! ```text
//! s = min(1, Q/(sum of q_i))          p_s' = p_s - (1 - s^2) min over i of (p_s - p_i)
//! ```
//!
//! q_i flow that axis i demands at the pump's pressure p_s, m3/s, equation (3); Q largest flow of the pump, m3/s; s
//! part of its demand that every axis gets; p_i pressure in the chamber of axis i that is fed, Pa; p_s' supply pressure
//! that is left, Pa.
//!
//! This is load-independent flow sharing (LUDV). A compensator behind each metering edge reduces the pressure drop over
//! that edge to the part s^2 of what the drop would be with enough flow. All flows therefore fall to the part s,
//! whatever the loads are. The axis with the highest load needs no compensation and determines p_s'. The compensators
//! of the other axes take up (1 - s^2)(p_i of the highest load - p_i), which is never negative. While the flow
//! suffices, s is 1 and equation (3) holds as printed.
//!
//! Trap: without compensation the axis with the lightest load would take all the flow, and the boom would stand still.

/// The pump at one time.
#[derive(Debug, Clone, Copy)]
pub struct Pump {
    /// p_s, Pa.
    pub pressure: f64,
    /// Q, m3/s.
    pub flow: f64,
}

impl Pump {
    /// s for axes that together demand `demand` m3/s.
    #[inline]
    pub fn share(&self, demand: f64) -> f64 {
        if demand > self.flow { self.flow / demand } else { 1.0 }
    }

    /// p_s - (1 - s^2)(p_s - p_i) for one axis, Pa, with s = `share` and p_i = `fed` Pa. The largest of these values
    /// over all axes is p_s'.
    pub fn sagged(&self, share: f64, fed: f64) -> f64 {
        self.pressure - (1.0 - share * share) * (self.pressure - fed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PUMP: Pump = Pump { pressure: 25e6, flow: 8e-3 };

    #[test]
    fn all_axes_get_the_same_part_when_the_flow_does_not_suffice() {
        assert_eq!(PUMP.share(7e-3), 1.0);
        assert_eq!(PUMP.share(8e-3), 1.0);
        assert_eq!(PUMP.share(16e-3), 0.5);
    }

    #[test]
    fn the_pressure_sags_to_what_the_highest_load_needs() {
        assert_eq!(PUMP.sagged(1.0, 12e6), 25e6);
        // A quarter of the pressure drop is left over the edge of the axis with the highest load.
        assert!((PUMP.sagged(0.5, 12e6) - (12e6 + 0.25 * 13e6)).abs() < 1.0);
    }
}
