//! One cylinder at one time by the equations in `plant_sim::actuator` and `plant_sim::hydraulics`, written again in
//! plain numbers.

use pipeline::machine::{Hydraulics, LoadHolding, Parameter, Plant, SupplyKind};

use super::conditions::Conditions;

/// Parameters of one axis under its conditions; SI units.
pub struct Cylinder {
    plant: Plant,
    stroke: f64,
    /// Drop over the edge that feeds which a compensator allows.
    allowed_drop: f64,
    return_pressure: f64,
    bulk_modulus: f64,
    air: f64,
    /// k
    conductance: f64,
    mass: f64,
    /// Factor of the load force.
    gravity: f64,
    /// Factor of the leakage.
    leakage: f64,
    /// Factor of all friction.
    dry: f64,
    /// Further factor of the viscous friction.
    viscous: f64,
    external_force: f64,
}

/// f(dp) = dp / (dp^2 + p_tr^2)^(1/4)
fn root(drop: f64) -> f64 {
    let transition = 2e4;
    drop / drop.hypot(transition).sqrt()
}

impl Cylinder {
    pub fn new(plant: &Plant, stroke: f64, hydraulics: &Hydraulics, conditions: &Conditions, viscosity: f64) -> Self {
        let Hydraulics { supply, oil } = hydraulics;
        Self {
            allowed_drop: match supply.kind {
                SupplyKind::ConstantPressure => f64::INFINITY,
                SupplyKind::LoadSensing { .. } => plant.rated_pressure_drop,
            },
            return_pressure: supply.return_pressure,
            bulk_modulus: oil.bulk_modulus * conditions.factor(Parameter::BulkModulus),
            air: oil.air * conditions.factor(Parameter::Air),
            conductance: plant.rated_flow * conditions.factor(Parameter::FlowGain) / plant.rated_pressure_drop.sqrt(),
            mass: plant.mass * conditions.factor(Parameter::Mass),
            gravity: conditions.factor(Parameter::LoadForce),
            leakage: conditions.factor(Parameter::Leakage) / viscosity,
            dry: conditions.factor(Parameter::Friction),
            viscous: viscosity,
            external_force: conditions.value(Parameter::ExternalForce, 0.0) * supply.pressure * plant.piston_area,
            plant: plant.clone(),
            stroke,
        }
    }

    /// q_i, flow that the axis demands from the pump at the pressure `supply` Pa and the opening `x`, m3/s.
    pub fn demand(&self, x: f64, p1: f64, p2: f64, supply: f64) -> f64 {
        let fed = if x >= 0.0 { p1 } else { p2 };
        self.conductance * x.abs() * root((supply - fed).min(self.allowed_drop)).max(0.0)
    }

    /// Flow to the tank and flow from the draining chamber to the fed one at the opening `x`, m3/s.
    fn returns(&self, x: f64, fed: f64, drained: f64) -> (f64, f64) {
        let ports = &self.plant.ports;
        let (meter_out, regeneration, setting) = if x >= 0.0 {
            (ports.meter_out.extend, ports.regeneration.extend, ports.counterbalance.extend)
        } else {
            (ports.meter_out.retract, ports.regeneration.retract, ports.counterbalance.retract)
        };
        let balanced = if setting > 0.0 {
            ((drained + ports.pilot_ratio * fed - setting) / (0.2 * setting)).clamp(0.0, 1.0)
        } else {
            1.0
        };
        let edge = self.conductance * x.abs();
        let drain = balanced * meter_out * edge * root(drained - self.return_pressure);
        (drain, regeneration * edge * root(drained - fed).max(0.0))
    }

    /// Leakage of the spool out of piston side and rod side, m3/s.
    fn spool(&self, p1: f64, p2: f64) -> (f64, f64) {
        let ports = &self.plant.ports;
        let (piston_held, rod_held) = match ports.load_holding {
            LoadHolding::None => (false, false),
            LoadHolding::Piston => (true, false),
            LoadHolding::Rod => (false, true),
            LoadHolding::Both => (true, true),
        };
        let out = |held: bool, p: f64| {
            if held { 0.0 } else { self.leakage * ports.spool_leakage * (p - self.return_pressure) }
        };
        (out(piston_held, p1), out(rod_held, p2))
    }

    /// Rates of y, v, p1, p2 and z at the opening `x`, when the pump feeds `feed` m3/s.
    pub fn rates(&self, state: &[f64], x: f64, feed: f64) -> [f64; 5] {
        let &[y, v, p1, p2, z] = state else { unreachable!("five numbers for each axis") };
        let plant = &self.plant;
        let (q1, q2) = if x >= 0.0 {
            let (drain, regenerated) = self.returns(x, p1, p2);
            (feed + regenerated, drain + regenerated)
        } else {
            let (drain, regenerated) = self.returns(x, p2, p1);
            (-drain - regenerated, -feed - regenerated)
        };
        let (spool1, spool2) = self.spool(p1, p2);
        let internal = self.leakage * plant.internal_leakage * (p1 - p2);
        let external = self.leakage * plant.external_leakage;
        let into_piston = q1 - plant.piston_area * v - internal - external * p1 - self.port(p1) - spool1;
        let into_rod = plant.rod_area * v - q2 + internal - external * p2 - self.port(p2) - spool2;
        let (hose1, hose2) = (plant.ports.piston_hose_volume, plant.ports.rod_hose_volume);
        let volume = |dead: f64, area: f64, out: f64| (dead + area * out).max(0.1 * dead);
        let v1 = volume(plant.piston_dead_volume + hose1, plant.piston_area, y);
        let v2 = volume(plant.rod_dead_volume + hose2, plant.rod_area, self.stroke - y);
        let (c1, c2) = (
            v1 / self.modulus(p1) + hose1 / plant.ports.hose_modulus,
            v2 / self.modulus(p2) + hose2 / plant.ports.hose_modulus,
        );
        let (friction, dz) = self.friction(v, z);
        let force = plant.piston_area * p1 - plant.rod_area * p2 - friction - self.load(y) + self.stops(y, v);
        [v, force / self.mass, into_piston / c1, into_rod / c2, dz]
    }

    /// beta_e
    fn modulus(&self, p: f64) -> f64 {
        let (atmosphere, kappa) = (101_325.0, 1.4);
        let absolute = atmosphere + p.max(-0.999 * atmosphere);
        let r = self.air * (atmosphere / absolute).powf(1.0 / kappa);
        (1.0 + r) / (1.0 / self.bulk_modulus + r / (kappa * absolute))
    }

    /// Flow out of the chamber through relief and make-up valve, m3/s.
    fn port(&self, p: f64) -> f64 {
        let relief = self.plant.relief_pressure;
        let flow = self.plant.rated_flow;
        flow * (p - relief).max(0.0) / (0.05 * relief) - flow * (-p).max(0.0) / 5e4
    }

    /// F and dz/dt
    fn friction(&self, v: f64, z: f64) -> (f64, f64) {
        let plant = &self.plant;
        // The least value, that of the simulator, prevents a division by zero without dry friction.
        let (coulomb, most) =
            ((self.dry * plant.coulomb_friction).max(1e-6), (self.dry * plant.static_friction).max(1e-6));
        let g = coulomb + (most - coulomb) / (1.0 + (v / plant.stribeck_speed).powi(2));
        let stiffness = self.dry * plant.bristle_stiffness;
        let damping = self.dry * self.viscous.min(1.0) * plant.bristle_damping;
        let forgetting = stiffness * v.abs() / g;
        let dz = (v - forgetting * z) * if forgetting > 1e4 { 1e4 / forgetting } else { 1.0 };
        (stiffness * z + damping * dz + self.dry * self.viscous * plant.viscous_friction * v, dz)
    }

    /// F_L: Lagrange's parabola through the three forces; inside a stop the force is that at the stop.
    fn load(&self, y: f64) -> f64 {
        let y = y.clamp(0.0, self.stroke);
        let (force, part) = (self.plant.load_force, y / self.stroke);
        let parabola = force.retracted * 2.0 * (part - 0.5) * (part - 1.0) - force.middle * 4.0 * part * (part - 1.0)
            + force.extended * 2.0 * part * (part - 0.5);
        self.gravity * parabola + self.external_force + self.plant.load_stiffness * (y - 0.5 * self.stroke)
    }

    fn stops(&self, y: f64, v: f64) -> f64 {
        let (stiffness, damping) = (self.plant.end_stop_stiffness, self.plant.end_stop_damping);
        if y < 0.0 {
            (-stiffness * y - damping * v).max(0.0)
        } else if y > self.stroke {
            -(stiffness * (y - self.stroke) + damping * v).max(0.0)
        } else {
            0.0
        }
    }

    /// y, v, p1, p2 and z of the axis at rest at `y`. The rod side has the mean of return and idle pressure. Where
    /// the piston side would then have less than the return pressure, it has the return pressure.
    pub fn at_rest(&self, y: f64, idle: f64) -> [f64; 5] {
        let (a1, a2, load) = (self.plant.piston_area, self.plant.rod_area, self.load(y));
        let rod = 0.5 * (idle + self.return_pressure);
        let piston = (load + a2 * rod) / a1;
        if piston >= self.return_pressure {
            return [y, 0.0, piston, rod, 0.0];
        }
        let rod = (a1 * self.return_pressure - load) / a2;
        [y, 0.0, self.return_pressure, rod.max(self.return_pressure), 0.0]
    }
}
