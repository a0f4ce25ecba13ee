//! The reference: all axes of a machine as one system of differential equations.
//!
//! The right-hand side is smooth except when conditions are updated, every 0.1 ms to their value in the middle of that
//! time, and when a command has passed the dead time of its valve. The integrator starts anew at each of these times.

use pipeline::machine::{Hydraulics, Machine, Scenario};

use super::{conditions::Conditions, cylinder::Cylinder, dormand_prince::DormandPrince, pump::Pump, valve::Valve};

/// Errors of y m, v m/s, p1 Pa, p2 Pa and z m that are allowed in one step.
const TOLERANCE: [f64; 5] = [1e-10, 1e-7, 10.0, 10.0, 1e-10];

/// Error of the pump's pressure that is allowed in one step, Pa.
const PUMP_TOLERANCE: f64 = 10.0;

/// Period at which conditions are updated, ns.
const UPDATE_PERIOD: u64 = 100_000;

pub struct Reference {
    hydraulics: Hydraulics,
    scenario: Scenario,
    axes: Vec<pipeline::machine::Axis>,
    valves: Vec<Valve>,
    cylinders: Vec<Cylinder>,
    /// y, v, p1, p2, z of one axis after the other, then the pressure of the pump.
    state: Vec<f64>,
    integrator: DormandPrince,
    pump: Pump,
    time_ns: u64,
}

impl Reference {
    /// `machine` at rest; the tolerances are divided by `tightened`.
    pub fn new(machine: &Machine, tightened: f64) -> Self {
        let tolerance = machine.axes.iter().flat_map(|_| TOLERANCE).chain([PUMP_TOLERANCE]);
        let tolerance = tolerance.map(|tolerance| tolerance / tightened).collect();
        let hydraulics = machine.hydraulics.unwrap();
        let start = Conditions { changes: &machine.scenario.changes, axis: 0, time: 0.0 };
        let mut reference = Self {
            pump: Pump::new(&hydraulics.supply, &start),
            hydraulics,
            scenario: machine.scenario.clone(),
            valves: machine.axes.iter().map(|axis| Valve::new(axis.plant.as_ref().unwrap())).collect(),
            axes: machine.axes.clone(),
            cylinders: Vec::new(),
            state: Vec::new(),
            integrator: DormandPrince::new(tolerance, 1e-5),
            time_ns: 0,
        };
        reference.update();
        let plants = machine.axes.iter().map(|axis| axis.plant.as_ref().unwrap());
        let idle = reference.pump.idle();
        let axes = plants.zip(&reference.cylinders);
        let at_rest = axes.flat_map(|(plant, axis)| axis.at_rest(plant.initial_position, idle));
        reference.state = at_rest.chain([idle]).collect();
        reference
    }

    /// Gives each axis its command.
    pub fn command(&mut self, commands: &[f64]) {
        for (valve, command) in self.valves.iter_mut().zip(commands) {
            valve.command(self.time_ns, *command);
        }
    }

    /// Updates conditions and commands to this time.
    fn update(&mut self) {
        let period = self.time_ns - self.time_ns % UPDATE_PERIOD;
        let time = (period + UPDATE_PERIOD / 2) as f64 * 1e-9;
        let at = |axis| Conditions { changes: &self.scenario.changes, axis, time };
        let conditions_change = !self.scenario.changes.is_empty() && self.time_ns == period;
        if self.cylinders.is_empty() || conditions_change {
            let axes = self.axes.iter().enumerate();
            let cylinders = axes.map(|(index, axis)| {
                let viscosity = at(index).viscosity(&self.hydraulics.oil);
                Cylinder::new(axis.plant.as_ref().unwrap(), axis.stroke, &self.hydraulics, &at(index), viscosity)
            });
            self.cylinders = cylinders.collect();
            self.pump = Pump::new(&self.hydraulics.supply, &at(0));
        }
        for (index, valve) in self.valves.iter_mut().enumerate() {
            valve.update(self.time_ns, &at(index), at(index).viscosity(&self.hydraulics.oil));
        }
    }

    /// The next time at which conditions are updated, ns: every 1 ms while nothing changes.
    fn next_update(&self) -> u64 {
        let (now, next) = (self.time_ns as f64 * 1e-9, (self.time_ns / UPDATE_PERIOD + 1) * UPDATE_PERIOD);
        let soon = (next + UPDATE_PERIOD) as f64 * 1e-9;
        let mut changes = self.scenario.changes.iter();
        let is_changing = changes.any(|change| change.start <= soon && now <= change.end + 1e-3);
        if is_changing { next } else { next.next_multiple_of(10 * UPDATE_PERIOD) }
    }

    /// Advances by `duration` ns.
    pub fn advance(&mut self, duration: u64) {
        let end = self.time_ns + duration;
        while self.time_ns < end {
            self.update();
            let commands = self.valves.iter().filter_map(Valve::next_change);
            let next = commands.fold(end.min(self.next_update()), u64::min);
            let length = (next - self.time_ns) as f64 * 1e-9;
            let Self { valves, cylinders, pump, .. } = self;
            let mut asked = vec![(0.0, 0.0); cylinders.len()];
            let last = 5 * cylinders.len();
            self.integrator.advance(length, &mut self.state, |after, state, rates| {
                let supply = pump.pressure(state[last]);
                let mut load: Option<f64> = None;
                for (i, (opening, demand)) in asked.iter_mut().enumerate() {
                    let (p1, p2) = (state[5 * i + 2], state[5 * i + 3]);
                    *opening = valves[i].opening(after);
                    *demand = cylinders[i].demand(*opening, p1, p2, supply);
                    if *opening != 0.0 {
                        let fed = if *opening > 0.0 { p1 } else { p2 };
                        load = Some(load.map_or(fed, |load| load.max(fed)));
                    }
                }
                let total: f64 = asked.iter().map(|(_, demand)| demand).sum();
                let share = pump.share(total, supply, load);
                rates[last] = pump.rate(state[last], load);
                for (i, (opening, demand)) in asked.iter().enumerate() {
                    let axis = 5 * i..5 * i + 5;
                    let own = cylinders[i].rates(&state[axis.clone()], *opening, share * demand);
                    rates[axis].copy_from_slice(&own);
                }
            });
            // The model does not represent a cavity larger than the air at 100 Pa.
            for pressures in self.state.chunks_exact_mut(5).map(|axis| &mut axis[2..4]) {
                pressures.iter_mut().for_each(|pressure| *pressure = pressure.max(-0.999 * 101_325.0));
            }
            for valve in &mut self.valves {
                valve.advance(length);
            }
            self.time_ns = next;
        }
    }

    /// y of every axis, m.
    pub fn positions(&self) -> impl Iterator<Item = f64> {
        self.state.chunks_exact(5).map(|axis| axis[0])
    }
}
