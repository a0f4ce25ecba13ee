//! The pump that feeds all axes, and the part of its flow that each axis gets.
//!
//! ```text
//! constant pressure:  p_s = p_max
//! load-sensing:       tau dp_s/dt = min(p_max, max(p_LS, p_0) + margin) - p_s
//! demand:             q_i = k X max(0, f(min(dp_c, p_s - p_i)))
//! s = min(1, Q/D, s_P)      s_P D (p_m + s_P^2 (p_s - p_m)) = P      D = sum of q_i      p_m = min(p_LS, p_s)
//! p_s' = p_s - (1 - s^2) min over i of (p_s - p_i)
//! ```
//!
//! p_s pressure that the pump is controlled to, p_max its largest, Pa; p_i pressure in the chamber that the open valve
//! of axis i connects with the pump, Pa; p_LS the highest p_i of all open valves, which shuttle valves report to the
//! pump; p_0 pressure of the return line; tau response time, s; dp_c pressure drop that a compensator leaves to its
//! edge, Pa, without a bound on a constant-pressure pump; q_i flow that axis i demands, m3/s, equation (3); Q largest
//! flow, m3/s; P largest power, W; s part of its demand that every axis gets; p_s' supply pressure that is left, Pa.
//!
//! **Load-sensing.** A pressure compensator before each spool keeps the drop over the edge that feeds at dp_c, the
//! rated pressure drop of the valve, while the pump is at least dp_c above the chamber. Then the flow depends on the
//! opening alone: a payload changes the pressure, not the speed. After a load has risen, the flow is less until the
//! pump has followed. With all valves shut the pump idles at p_0 + margin.
//!
//! **Short of flow or power.** Load-independent flow sharing (LUDV): the compensators reduce the pressure drop over
//! each metering edge to the part s^2 of what the drop would be otherwise. All flows therefore fall to the part s,
//! whatever the loads are. The axis with the highest load needs no compensation and determines p_s'. The compensators
//! of the other axes take up (1 - s^2)(p_i of the highest load - p_i), which is never negative. While flow and power
//! suffice, s is 1. With s_P the pump delivers the power P, at the flow s D and the pressure p_s'.
//!
//! Sources: LUDV by its definition. Assumed: the first order of the response (a swash plate and its controller are of
//! higher order), compensators without dynamics, dp_c equal to the rated pressure drop, no pump leakage.
//!
//! Traps: without compensation the axis with the lightest load would take all the flow, and the boom would stand still.
//! Before the pump has passed the pressure of a load, that load does not move: a valve that opens on a load of 12 MPa
//! waits for about 1.7 response times at a margin of 2 MPa.

use pipeline::machine::{Supply, SupplyKind};

/// Largest number of Newton steps to the share of the power; they come from above and may end before.
const NEWTON_STEPS: usize = 40;

/// What the axes ask of the pump at one time.
#[derive(Debug, Clone, Copy)]
pub struct Demand {
    /// D, m3/s.
    pub flow: f64,
    /// p_LS, Pa; negative infinity while all valves are shut.
    pub load_pressure: f64,
}

impl Demand {
    /// No valve is open.
    pub const NONE: Self = Self { flow: 0.0, load_pressure: f64::NEG_INFINITY };

    /// What two groups of axes ask together.
    #[inline]
    pub fn and(self, other: Self) -> Self {
        Self { flow: self.flow + other.flow, load_pressure: self.load_pressure.max(other.load_pressure) }
    }
}

/// The pump: its limits at this time, its pressure, and the step that is being made.
#[derive(Debug, Clone, Copy)]
pub struct Pump {
    /// p_s, Pa.
    pub pressure: f64,
    /// p_max, Pa.
    largest_pressure: f64,
    /// Q, m3/s.
    flow: f64,
    /// P, W.
    power: f64,
    /// p_0, Pa.
    return_pressure: f64,
    /// Pa; infinite on a constant-pressure pump, which therefore always is at its largest pressure.
    margin: f64,
    /// 1/tau, 1/s; 0 on a constant-pressure pump.
    rate: f64,
    /// p_s at the present stage of the step, Pa.
    stage: f64,
    /// Weighted sum of the rates of the stages so far, Pa/s.
    sum: f64,
}

impl Pump {
    /// The idling pump of `supply` with its largest pressure, and with its flow and power, multiplied by a factor each.
    pub fn new(supply: &Supply, pressure_factor: f64, flow_factor: f64) -> Self {
        let (margin, rate) = match supply.kind {
            SupplyKind::ConstantPressure => (f64::INFINITY, 0.0),
            SupplyKind::LoadSensing { margin, response_time } => (margin, 1.0 / response_time),
        };
        let mut pump = Self {
            pressure: 0.0,
            largest_pressure: supply.pressure * pressure_factor,
            flow: supply.flow * flow_factor,
            power: supply.power.map_or(f64::INFINITY, |power| power * flow_factor),
            return_pressure: supply.return_pressure,
            margin,
            rate,
            stage: 0.0,
            sum: 0.0,
        };
        pump.pressure = pump.target(Demand::NONE.load_pressure);
        pump
    }

    /// Takes the limits of `other`. A load-sensing pump keeps its pressure, a constant-pressure pump has the new one.
    pub fn limit(&mut self, other: Self) {
        let pressure = if self.rate > 0.0 { self.pressure } else { other.pressure };
        *self = Self { pressure, ..other };
    }

    /// The pressure that the pump approaches while the highest load is `load_pressure` Pa, Pa.
    #[inline]
    fn target(&self, load_pressure: f64) -> f64 {
        (load_pressure.max(self.return_pressure) + self.margin).min(self.largest_pressure)
    }

    /// Begins a step.
    #[inline]
    pub fn begin(&mut self) {
        (self.stage, self.sum) = (self.pressure, 0.0);
    }

    /// p_s at the present stage of the step, Pa.
    #[inline]
    pub fn stage_pressure(&self) -> f64 {
        self.stage
    }

    /// Adds the rate of p_s under `demand` to the sum with `weight`, and moves to the next stage, `ahead` s after the
    /// begin of the step.
    #[inline]
    pub fn take_rate(&mut self, demand: &Demand, weight: f64, ahead: f64) {
        let rate = self.rate * (self.target(demand.load_pressure) - self.stage);
        self.sum += weight * rate;
        self.stage = self.pressure + ahead * rate;
    }

    /// Ends a step of `step` s.
    #[inline]
    pub fn end(&mut self, step: f64) {
        self.pressure += step * self.sum;
    }

    /// s at the pressure p_s = `pressure` Pa.
    #[inline]
    pub fn share(&self, demand: &Demand, pressure: f64) -> f64 {
        let by_flow = if demand.flow > self.flow { self.flow / demand.flow } else { 1.0 };
        if demand.flow * pressure <= self.power { by_flow } else { by_flow.min(self.share_of_power(demand, pressure)) }
    }

    /// s_P, for a demand beyond the power: Newton's method on a convex function, from above.
    fn share_of_power(&self, demand: &Demand, pressure: f64) -> f64 {
        let load = demand.load_pressure.clamp(0.0, pressure);
        let (drop, mean) = (pressure - load, self.power / demand.flow);
        let mut share = 1.0;
        for _ in 0..NEWTON_STEPS {
            let square = share * share;
            let next = share - (share * (load + square * drop) - mean) / (load + 3.0 * square * drop);
            if next >= share {
                break;
            }
            share = next;
        }
        share
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

    const CONSTANT: Supply =
        Supply { kind: SupplyKind::ConstantPressure, pressure: 25e6, return_pressure: 3e5, flow: 8e-3, power: None };

    const MARGIN: f64 = 2e6;
    const RESPONSE: f64 = 0.1;

    fn load_sensing() -> Pump {
        let kind = SupplyKind::LoadSensing { margin: MARGIN, response_time: RESPONSE };
        Pump::new(&Supply { kind, ..CONSTANT }, 1.0, 1.0)
    }

    fn demand(flow: f64) -> Demand {
        Demand { flow, load_pressure: 12e6 }
    }

    /// Makes `steps` steps of 0.1 ms under one demand.
    fn advance(pump: &mut Pump, demand: &Demand, steps: usize) {
        let step = 1e-4;
        for _ in 0..steps {
            pump.begin();
            for (weight, ahead) in [(1.0 / 6.0, 0.5), (1.0 / 3.0, 0.5), (1.0 / 3.0, 1.0), (1.0 / 6.0, 0.0)] {
                pump.take_rate(demand, weight, ahead * step);
            }
            pump.end(step);
        }
    }

    #[test]
    fn all_axes_get_the_same_part_when_the_flow_does_not_suffice() {
        let pump = Pump::new(&CONSTANT, 1.0, 1.0);
        assert_eq!(pump.share(&demand(7e-3), 25e6), 1.0);
        assert_eq!(pump.share(&demand(8e-3), 25e6), 1.0);
        assert_eq!(pump.share(&demand(16e-3), 25e6), 0.5);
    }

    #[test]
    fn the_pressure_sags_to_what_the_highest_load_needs() {
        let pump = Pump::new(&CONSTANT, 1.0, 1.0);
        assert_eq!(pump.sagged(1.0, 12e6), 25e6);
        // A quarter of the pressure drop is left over the edge of the axis with the highest load.
        assert!((pump.sagged(0.5, 12e6) - (12e6 + 0.25 * 13e6)).abs() < 1.0);
    }

    #[test]
    fn a_constant_pressure_pump_holds_its_pressure_bit_for_bit() {
        let mut pump = Pump::new(&CONSTANT, 0.7, 1.0);
        for demand in [demand(8e-3), Demand::NONE] {
            advance(&mut pump, &demand, 1000);
            assert_eq!(pump.pressure.to_bits(), (25e6 * 0.7f64).to_bits());
        }
        pump.limit(Pump::new(&CONSTANT, 0.5, 1.0));
        assert_eq!(pump.pressure, 12.5e6);
    }

    #[test]
    fn a_load_sensing_pump_follows_the_load_by_its_closed_form() {
        let mut pump = load_sensing();
        assert_eq!(pump.pressure, 3e5 + MARGIN, "it idles");
        advance(&mut pump, &demand(1e-3), 500);
        let (idle, target) = (3e5 + MARGIN, 12e6 + MARGIN);
        let expected = target + (idle - target) * (-0.05 / RESPONSE).exp();
        assert!((pump.pressure - expected).abs() < 1e-3, "{} for {expected}", pump.pressure);
        advance(&mut pump, &demand(1e-3), 30_000);
        assert!((pump.pressure - target).abs() < 1e-3);
        // Close to its largest pressure it is left with less than the margin.
        advance(&mut pump, &Demand { flow: 1e-3, load_pressure: 24e6 }, 30_000);
        assert!((pump.pressure - 25e6).abs() < 1e-3);
        advance(&mut pump, &Demand::NONE, 30_000);
        assert!((pump.pressure - idle).abs() < 1e-3);
    }

    #[test]
    fn a_change_of_the_limits_leaves_a_load_sensing_pump_its_pressure() {
        let mut pump = load_sensing();
        advance(&mut pump, &demand(1e-3), 30_000);
        let before = pump.pressure;
        let kind = SupplyKind::LoadSensing { margin: MARGIN, response_time: RESPONSE };
        pump.limit(Pump::new(&Supply { kind, ..CONSTANT }, 0.4, 1.0));
        assert_eq!(pump.pressure, before);
        advance(&mut pump, &demand(1e-3), 30_000);
        assert!((pump.pressure - 10e6).abs() < 1e-3);
    }

    #[test]
    fn beyond_the_power_the_pump_delivers_exactly_the_power() {
        for power in [2e3, 30e3, 80e3, 109e3] {
            for load in [-1e5, 0.0, 2e6, 12e6, 25e6, 30e6] {
                let pump = Pump::new(&Supply { power: Some(power), ..CONSTANT }, 1.0, 1.0);
                let demand = Demand { flow: 4.5e-3, load_pressure: load };
                let share = pump.share(&demand, 25e6);
                let delivered = share * demand.flow * pump.sagged(share, load.clamp(0.0, 25e6));
                assert!((delivered / power - 1.0).abs() < 1e-12, "{power} W at {load} Pa: {delivered} W");
            }
        }
        let pump = Pump::new(&Supply { power: Some(100e3), ..CONSTANT }, 1.0, 1.0);
        assert_eq!(pump.share(&demand(3.9e-3), 25e6), 1.0);
        // A slow engine has less power as well as less flow.
        let slow = Pump::new(&Supply { power: Some(100e3), ..CONSTANT }, 1.0, 0.5);
        assert!(slow.share(&demand(3.9e-3), 25e6) < 1.0);
    }
}
