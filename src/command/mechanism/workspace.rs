//! Masses, loads and natural frequencies of the cylinders over the workspace.
//!
//! ```text
//! k = beta_e (A_1^2/V_1 + A_2^2/V_2)          V_1 = V_01 + A_1 x,  V_2 = V_02 + A_2 (s - x)
//! f = sqrt(k/m) / (2 pi)                      m = the entry of M_l of this cylinder, the others held
//! ```
//!
//! k stiffness of the oil in both chambers with the valve shut, N/m; A_1, A_2 areas of the piston, m2; V_1, V_2 volumes
//! of the chambers with dead volumes V_01, V_02, m3; x position and s stroke, m; beta_e bulk modulus of oil and air at
//! 5 MPa, Pa (see `plant_sim::hydraulics::oil`). Friction and leakage damp the motion and are left out.
//!
//! The workspace is the range of the soft limits, without postures in which the teeth are under the machine.
//!
//! Trap: with all valves shut the cylinders swing together. The frequencies of those modes are not those of single
//! cylinders: they lie below the lowest and above the highest of them.

use mechanism::{AXES, Dynamics, Mechanism, Moments, Vector, natural_frequencies, postures};
use pipeline::machine::{Axis, Hydraulics, Machine};
use plant_sim::hydraulics::oil::{ADIABATIC_INDEX, ATMOSPHERE};
use serde::Serialize;

/// Parts that the range of each cylinder is divided into.
const PARTS: usize = 13;

/// Teeth nearer to the centre of swing are at the tracks, m (assumed for machines of 20 t).
const NEAREST: f64 = 1.5;

/// Pressure at which the stiffness of the oil is taken, Pa: that of a chamber at rest (assumed). Above it, beta_e rises
/// by a tenth at the most.
const PRESSURE: f64 = 5e6;

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
        // For each cylinder: mass, gravity, frequency, ratio; then the modes.
        let mut found: [[Vec<f64>; 4]; AXES] = Default::default();
        let mut modes: [Vec<f64>; AXES] = Default::default();
        for positions in postures(low, high, PARTS) {
            let pose = prepared.pose(&positions);
            if pose.tip.x < NEAREST {
                continue;
            }
            let terms: Dynamics = moments.dynamics(&pose, &[0.0; AXES]);
            let mass = terms.cylinder_mass(&pose);
            let gravity = terms.holding_force(&pose, Vector::default());
            let stiffness = stiffness(machine, &positions);
            let tip = pose.tip_jacobian();
            for (i, found) in found.iter_mut().enumerate() {
                found[0].push(mass[i][i]);
                found[1].push(gravity[i]);
                found[2].extend(stiffness.map(|k| (k[i] / mass[i][i]).sqrt() / (2.0 * std::f64::consts::PI)));
                found[3].push(tip[i].norm());
            }
            for (modes, frequency) in modes.iter_mut().zip(stiffness.iter().flat_map(|k| natural_frequencies(&mass, k)))
            {
                modes.push(frequency);
            }
        }
        let postures = found[0][0].len();
        let felt = |[mass, gravity, frequency, ratio]: [Vec<f64>; 4]| {
            Some(Felt {
                reflected_mass: Spread::new(mass)?,
                gravity: Spread::new(gravity)?,
                natural_frequency: Spread::new(frequency),
                tip_ratio: Spread::new(ratio)?,
            })
        };
        let cylinders = found.into_iter().map(felt).collect::<Option<Vec<_>>>()?;
        Some(Self { postures, cylinders, coupled_frequencies: modes.into_iter().map(Spread::new).collect() })
    }
}

/// Stiffness of the oil in each cylinder, N/m; `None` for a machine without a simulated plant.
fn stiffness(machine: &Machine, positions: &[f64; AXES]) -> Option<[f64; AXES]> {
    let bulk_modulus = bulk_modulus(machine.hydraulics.as_ref()?);
    let of = |axis: &Axis, position: f64| {
        let plant = axis.plant.as_ref()?;
        let piston = plant.piston_area.powi(2) / (plant.piston_dead_volume + plant.piston_area * position);
        let rod = plant.rod_area.powi(2) / (plant.rod_dead_volume + plant.rod_area * (axis.stroke - position));
        Some(bulk_modulus * (piston + rod))
    };
    let stiffness: Option<Vec<f64>> = machine.axes.iter().zip(positions).map(|(axis, x)| of(axis, *x)).collect();
    stiffness?.try_into().ok()
}

/// beta_e at [`PRESSURE`], Pa.
fn bulk_modulus(hydraulics: &Hydraulics) -> f64 {
    let pressure = PRESSURE + ATMOSPHERE;
    let air = hydraulics.oil.air * (ATMOSPHERE / pressure).powf(1.0 / ADIABATIC_INDEX);
    (1.0 + air) / (1.0 / hydraulics.oil.bulk_modulus + air / (ADIABATIC_INDEX * pressure))
}
