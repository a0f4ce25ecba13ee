//! Machines drawn at random from the whole range that the machine file allows.

use pipeline::machine::SupplyKind;
use plant_sim::{PlantError, PlantSim};
use rand_pcg::{
    Pcg64,
    rand_core::{Rng, SeedableRng},
};
use toml::Value;

use super::{
    bounds,
    text::{self, Edits},
};

struct Draw(Pcg64);

impl Draw {
    fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    fn log(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.unit())
    }

    fn log_or_zero(&mut self, low: f64, high: f64) -> f64 {
        if self.unit() < 0.2 { 0.0 } else { self.log(low, high) }
    }

    fn hydraulics(&mut self) -> [(&'static str, f64); 5] {
        let pressure = self.log(1e5, 1e8);
        [
            ("supply.pressure", pressure),
            ("supply.return_pressure", self.log_or_zero(1e2, 1e7).min(0.9 * pressure)),
            ("supply.flow", self.log(1e-6, 10.0)),
            ("oil.bulk_modulus", self.log(1e8, 5e9)),
            ("oil.air", self.log(2e-3, 0.3)),
        ]
    }

    fn axis(&mut self) -> Edits {
        let stroke = self.log(1e-2, 10.0);
        let coulomb = self.log_or_zero(1.0, 1e6);
        let stiction = (coulomb * self.log(1.0, 10.0)).min(1e6);
        let viscous = self.log_or_zero(1.0, 1e7);
        let damping = self.log_or_zero(1.0, 1e7);
        let damping =
            if stiction > coulomb { damping.min(0.99 * viscous * coulomb / (stiction - coulomb)) } else { damping };
        let mut load = || if self.unit() < 0.5 { self.log(1.0, 1e7) } else { -self.log(1.0, 1e7) };
        let load = vec![Value::Float(load()), Value::Float(load()), Value::Float(load())];
        let dead = 0.9 * self.unit();
        let curve = if self.unit() < 0.5 { "s" } else { "linear" };
        let mut edits: Edits = vec![("valve_curve", curve.into()), ("load_force", Value::Array(load))];
        let numbers = [
            ("stroke", stroke),
            ("initial_position", stroke * self.unit()),
            ("piston_area", self.log(1e-5, 1.0)),
            ("rod_area", self.log(1e-5, 1.0)),
            ("piston_dead_volume", self.log(1e-5, 1.0)),
            ("rod_dead_volume", self.log(1e-5, 1.0)),
            ("mass", self.log(1.0, 1e6)),
            ("load_stiffness", self.log_or_zero(1.0, 1e8)),
            ("coulomb_friction", coulomb),
            ("static_friction", stiction),
            ("viscous_friction", viscous),
            ("bristle_damping", damping),
            ("bristle_stiffness", self.log_or_zero(1e3, 1e10)),
            ("stribeck_speed", self.log(1e-4, 1.0)),
            ("internal_leakage", self.log_or_zero(1e-15, 1e-9)),
            ("external_leakage", self.log_or_zero(1e-15, 1e-9)),
            ("relief_pressure", self.log(1e6, 1e8)),
            ("rated_flow", self.log(1e-6, 1.0)),
            ("rated_pressure_drop", self.log(1e4, 1e8)),
            ("dead_band_extend", dead),
            ("saturation_extend", dead + 0.0501 + (0.9499 - dead) * self.unit()),
            ("hysteresis", 0.2 * self.unit()),
            ("valve_time_constant", self.log(1e-3, 10.0)),
            ("dead_time", 0.5 * self.unit()),
            ("end_stop_stiffness", self.log(1e5, 1e9)),
            ("end_stop_damping", self.log_or_zero(1.0, 1e7)),
        ];
        edits.extend(numbers.map(|(key, value)| (key, Value::Float(value))));
        edits
    }

    /// Valves and hoses between spool and cylinder, each of them there in four of five cases.
    fn valve_block(&mut self) -> Edits {
        let held = ["none", "piston", "rod", "both"][(4.0 * self.unit()) as usize];
        let mut edits: Edits = vec![("load_holding", held.into())];
        let numbers = [
            ("meter_out_extend", self.log(0.01, 2.0)),
            ("meter_out_retract", self.log(0.01, 2.0)),
            ("regeneration_extend", self.log_or_zero(0.01, 2.0)),
            ("regeneration_retract", self.log_or_zero(0.01, 2.0)),
            ("counterbalance_extend", self.log_or_zero(1e5, 1e8)),
            ("counterbalance_retract", self.log_or_zero(1e5, 1e8)),
            ("pilot_ratio", self.log(0.1, 20.0)),
            ("spool_leakage", self.log_or_zero(1e-15, 1e-9)),
            ("piston_hose_volume", self.log_or_zero(1e-5, 1.0)),
            ("rod_hose_volume", self.log_or_zero(1e-5, 1.0)),
            ("hose_modulus", self.log(1e8, 1e12)),
        ];
        edits.extend(numbers.map(|(key, value)| (key, Value::Float(value))));
        edits
    }
}

/// Number of machines, each with four accepted axes.
const MACHINES: usize = 30;

#[test]
fn accepted_machines_stay_within_physical_bounds() {
    sweep(1, Draw::axis, |_| SupplyKind::ConstantPressure);
}

#[test]
fn accepted_machines_with_a_valve_block_and_a_load_sensing_pump_stay_within_physical_bounds() {
    let axis = |draw: &mut Draw| {
        let mut axis = draw.axis();
        axis.extend(draw.valve_block());
        axis
    };
    let kind =
        |draw: &mut Draw| SupplyKind::LoadSensing { margin: draw.log(1e5, 1e7), response_time: draw.log(5e-3, 5.0) };
    sweep(2, axis, kind);
}

/// Checks machines with axes by `axis` and pumps by `kind`, drawn from `seed` on.
fn sweep(seed: u64, axis: impl Fn(&mut Draw) -> Edits, kind: impl Fn(&mut Draw) -> SupplyKind) {
    let mut draw = Draw(Pcg64::seed_from_u64(seed));
    let (mut accepted, mut refused) = (0, 0);
    for index in 0..MACHINES {
        let hydraulics = draw.hydraulics();
        let kind = kind(&mut draw);
        let machine = |axes: &[Edits]| {
            let mut machine = text::machine(axes, &hydraulics);
            machine.hydraulics.as_mut().unwrap().supply.kind = kind;
            machine
        };
        let mut axes = Vec::new();
        while axes.len() < 4 {
            let axis = axis(&mut draw);
            match PlantSim::new(&machine(std::slice::from_ref(&axis)), 1) {
                Ok(_) => axes.push(axis),
                Err(PlantError::TooStiff { .. }) => refused += 1,
                Err(other) => panic!("{other}"),
            }
        }
        accepted += axes.len();
        bounds::check(&machine(&axes), &format!("machine {index}"));
    }
    println!("{accepted} axes accepted, {refused} refused as too stiff");
    assert!(accepted >= 100);
}
