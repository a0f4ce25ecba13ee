//! The pump by the equations in `plant_sim::hydraulics::supply`, written again in plain numbers.

use pipeline::machine::{Parameter, Supply, SupplyKind};

use super::conditions::Conditions;

pub struct Pump {
    supply: Supply,
    largest_pressure: f64,
    flow: f64,
    power: f64,
}

impl Pump {
    pub fn new(supply: &Supply, conditions: &Conditions) -> Self {
        let engine = conditions.factor(Parameter::PumpFlow);
        Self {
            supply: *supply,
            largest_pressure: supply.pressure * conditions.factor(Parameter::SupplyPressure),
            flow: supply.flow * engine,
            power: supply.power.unwrap_or(f64::INFINITY) * engine,
        }
    }

    /// The pressure without open valves, Pa.
    pub fn idle(&self) -> f64 {
        match self.supply.kind {
            SupplyKind::ConstantPressure => self.largest_pressure,
            SupplyKind::LoadSensing { margin, .. } => (self.supply.return_pressure + margin).min(self.largest_pressure),
        }
    }

    /// p_s, when the state of the pump is `state` Pa. A constant-pressure pump has no state.
    pub fn pressure(&self, state: f64) -> f64 {
        match self.supply.kind {
            SupplyKind::ConstantPressure => self.largest_pressure,
            SupplyKind::LoadSensing { .. } => state,
        }
    }

    /// Rate of the state while the highest load is `load` Pa, if a valve is open, Pa/s.
    pub fn rate(&self, state: f64, load: Option<f64>) -> f64 {
        let SupplyKind::LoadSensing { margin, response_time } = self.supply.kind else { return 0.0 };
        let lowest = self.supply.return_pressure;
        let wanted = load.map_or(lowest, |load| load.max(lowest)) + margin;
        (wanted.min(self.largest_pressure) - state) / response_time
    }

    /// s for `demand` m3/s at the pressure `supply` Pa: by bisection where the power decides.
    pub fn share(&self, demand: f64, supply: f64, load: Option<f64>) -> f64 {
        let by_flow = if demand > self.flow { self.flow / demand } else { 1.0 };
        let load = load.unwrap_or(0.0).clamp(0.0, supply);
        let power = |share: f64| share * demand * (load + share * share * (supply - load));
        if power(by_flow) <= self.power {
            return by_flow;
        }
        let (mut low, mut high) = (0.0, by_flow);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if power(middle) > self.power {
                high = middle;
            } else {
                low = middle;
            }
        }
        0.5 * (low + high)
    }
}
