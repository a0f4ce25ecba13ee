//! Masses, loads and natural frequencies of the cylinders over the workspace.
//!
//! ```text
//! f = sqrt(k/m) / (2 pi)          m = the entry of M_l of this cylinder, the others held
//! ```
//!
//! k stiffness of the oil in chambers and hoses with the valve shut, N/m (`plant_sim::actuator::cylinder`), at the
//! pressures at which the simulated machine starts in the posture; m mass, kg. The ideal frequency leaves hoses out and
//! takes the oil at 5 MPa in both chambers. Friction and leakage damp the motion and are left out.
//!
//! The workspace is the range of the soft limits, without postures in which the teeth are under the machine.
//!
//! Traps: with all valves shut the cylinders swing together. The frequencies of those modes are not those of single
//! cylinders: they lie below the lowest and above the highest of them. A motion of less than a tenth of a millimetre
//! stays in the bristles of friction, which are a spring beside the oil.

use std::f64::consts::TAU;

use mechanism::{AXES, Dynamics, Mechanism, Moments, Vector, natural_frequencies, postures};
use pipeline::machine::Machine;
use plant_sim::{actuator::cylinder::Cylinder, conditions::Conditions, hydraulics::supply::Pump};
use serde::Serialize;

/// Parts that the range of each cylinder is divided into.
const PARTS: usize = 13;

/// Teeth nearer to the centre of swing are at the tracks, m (assumed for machines of 20 t).
const NEAREST: f64 = 1.5;

/// Pressure of the ideal frequency, Pa. Above it, beta_e rises by a tenth at the most.
const IDEAL_PRESSURE: f64 = 5e6;

/// The values below which 5, 50 and 95 % of all postures are.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Spread {
    pub p5: f64,
    pub p50: f64,
    pub p95: f64,
}

impl Spread {
    /// Of some values; `None` without any.
    fn new(mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let last = values.len().checked_sub(1)?;
        let at = |part: f64| {
            let place = part * last as f64;
            let (low, rest) = (place.floor() as usize, place.fract());
            values[low] + rest * (values[(low + 1).min(last)] - values[low])
        };
        Some(Self { p5: at(0.05), p50: at(0.5), p95: at(0.95) })
    }
}

/// What one cylinder feels over the workspace.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Felt {
    /// Its entry on the diagonal of M_l, kg.
    pub reflected_mass: Spread,
    /// Force that gravity needs from it at rest, N.
    pub gravity: Spread,
    /// Natural frequency with the other cylinders held, Hz; none for a machine without a simulated plant.
    pub natural_frequency: Option<Spread>,
    /// Natural frequency without hoses, with the oil at 5 MPa and the other cylinders held, Hz.
    pub ideal_frequency: Option<Spread>,
    /// Way of the teeth per way of the piston.
    pub tip_ratio: Spread,
}

/// The workspace: how many postures, what each cylinder feels, and how they swing together.
#[derive(Debug, Clone, Serialize)]
pub struct Workspace {
    pub postures: usize,
    #[serde(skip)]
    pub cylinders: Vec<Felt>,
    /// Natural frequencies of the coupled cylinders with all valves shut, rising, Hz.
    pub coupled_frequencies: Option<Vec<Spread>>,
}

impl Workspace {
    /// Over the soft limits of the machine; `None` where the teeth are under the machine everywhere.
    pub fn new(machine: &Machine, mechanism: &Mechanism) -> Option<Self> {
        let low = std::array::from_fn(|i| machine.axes[i].soft_limits.0);
        let high = std::array::from_fn(|i| machine.axes[i].soft_limits.1);
        let (prepared, moments) = (mechanism.prepared(), Moments::new(&mechanism.masses));
        let springs = Springs::new(machine);
        // For each cylinder: mass, gravity, frequency, ideal frequency, ratio; then the modes.
        let mut found: [[Vec<f64>; 5]; AXES] = Default::default();
        let mut modes: [Vec<f64>; AXES] = Default::default();
        for positions in postures(low, high, PARTS) {
            let pose = prepared.pose(&positions);
            if pose.tip.x < NEAREST {
                continue;
            }
            let terms: Dynamics = moments.dynamics(&pose, &[0.0; AXES]);
            let mass = terms.cylinder_mass(&pose);
            let gravity = terms.holding_force(&pose, Vector::default());
            let stiffness = springs.as_ref().map(|springs| springs.at_rest(&positions, &gravity));
            let ideal = springs.as_ref().map(|springs| springs.ideal(&positions));
            let tip = pose.tip_jacobian();
            for (i, found) in found.iter_mut().enumerate() {
                found[0].push(mass[i][i]);
                found[1].push(gravity[i]);
                let frequency = |k: [f64; AXES]| (k[i] / mass[i][i]).sqrt() / TAU;
                found[2].extend(stiffness.map(frequency));
                found[3].extend(ideal.map(frequency));
                found[4].push(tip[i].norm());
            }
            for (modes, frequency) in modes.iter_mut().zip(stiffness.iter().flat_map(|k| natural_frequencies(&mass, k)))
            {
                modes.push(frequency);
            }
        }
        let postures = found[0][0].len();
        let felt = |[mass, gravity, frequency, ideal, ratio]: [Vec<f64>; 5]| {
            Some(Felt {
                reflected_mass: Spread::new(mass)?,
                gravity: Spread::new(gravity)?,
                natural_frequency: Spread::new(frequency),
                ideal_frequency: Spread::new(ideal),
                tip_ratio: Spread::new(ratio)?,
            })
        };
        let cylinders = found.into_iter().map(felt).collect::<Option<Vec<_>>>()?;
        Some(Self { postures, cylinders, coupled_frequencies: modes.into_iter().map(Spread::new).collect() })
    }
}

/// Natural frequencies of the coupled cylinders at `positions`, m, with all valves shut, rising, Hz; `None` for a
/// machine without a simulated plant.
pub fn frequencies_at(machine: &Machine, mechanism: &Mechanism, positions: &[f64; AXES]) -> Option<[f64; AXES]> {
    let pose = mechanism.prepared().pose(positions);
    let terms = Moments::new(&mechanism.masses).dynamics(&pose, &[0.0; AXES]);
    let gravity = terms.holding_force(&pose, Vector::default());
    let springs = Springs::new(machine)?.at_rest(positions, &gravity);
    Some(natural_frequencies(&terms.cylinder_mass(&pose), &springs))
}

/// The oil of the cylinders as springs.
struct Springs {
    cylinders: [Cylinder<f64>; AXES],
    /// The cylinders as they are without hoses.
    bare: [Cylinder<f64>; AXES],
    /// Pressure of the idling pump, Pa.
    idle: f64,
}

impl Springs {
    /// Those of the machine; `None` without a simulated plant.
    fn new(machine: &Machine) -> Option<Self> {
        let hydraulics = machine.hydraulics.as_ref()?;
        let plants: Option<Vec<_>> = machine.axes.iter().map(|axis| Some((axis.stroke, axis.plant.clone()?))).collect();
        let plants = plants.filter(|plants| plants.len() >= AXES)?;
        let cylinder = |i: usize, has_hoses: bool| {
            let (stroke, mut plant) = plants[i].clone();
            if !has_hoses {
                (plant.ports.piston_hose_volume, plant.ports.rod_hose_volume) = (0.0, 0.0);
            }
            Cylinder::new(&plant, stroke, hydraulics, &Conditions::NOMINAL)
        };
        Some(Self {
            cylinders: std::array::from_fn(|i| cylinder(i, true)),
            bare: std::array::from_fn(|i| cylinder(i, false)),
            idle: Pump::new(&hydraulics.supply, 1.0, 1.0).pressure,
        })
    }

    /// Stiffness at `positions`, m, while the oil holds the forces `gravity`, N; N/m.
    fn at_rest(&self, positions: &[f64; AXES], gravity: &[f64; AXES]) -> [f64; AXES] {
        std::array::from_fn(|i| {
            let cylinder = &self.cylinders[i];
            cylinder.oil_stiffness(positions[i], cylinder.pressures_at_rest(gravity[i], self.idle))
        })
    }

    /// Stiffness without hoses and with both chambers at [`IDEAL_PRESSURE`], N/m.
    fn ideal(&self, positions: &[f64; AXES]) -> [f64; AXES] {
        std::array::from_fn(|i| self.bare[i].oil_stiffness(positions[i], (IDEAL_PRESSURE, IDEAL_PRESSURE)))
    }
}
