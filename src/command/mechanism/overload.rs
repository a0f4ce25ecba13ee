//! Loads at rest that are too heavy for the relief valves.
//!
//! ```text
//! p = F/A_1 for F > 0,  -F/A_2 for F < 0          p > p_r: the relief valve opens and the piston gives way
//! ```
//!
//! F force that holds the cylinder at rest, N, in a posture within the soft limits, with the payload of the machine
//! file or the heaviest of the scenario; A_1 and A_2 areas of piston side and rod side, m2; p pressure with none on the
//! other side, Pa: the least that can hold the load; p_r relief pressure, Pa.
//!
//! Trap: the greatest load mostly lies at an end of a stroke, so the grid of postures has the soft limits in it.

use mechanism::{AXES, Masses, Mechanism, Moments, Payload, Vector};
use pipeline::machine::{Machine, Parameter};

/// Positions of each cylinder on the grid, with both soft limits.
const POSITIONS: usize = 9;

/// The heaviest load at rest of one axis.
#[derive(Clone, Copy)]
struct Heaviest {
    /// Pa.
    pressure: f64,
    /// N.
    force: f64,
    /// kg in the bucket.
    payload: f64,
    /// m.
    positions: [f64; AXES],
}

/// One warning for each axis whose relief valve opens under the load at rest somewhere within the soft limits.
pub fn overloads(machine: &Machine) -> Vec<String> {
    let Some(mechanism) = &machine.mechanism else { return Vec::new() };
    let heaviest = heaviest(machine, mechanism);
    let warning = |(axis, heaviest): (&pipeline::machine::Axis, Heaviest)| {
        let relief = axis.plant.as_ref()?.relief_pressure;
        (heaviest.pressure > relief).then(|| {
            format!(
                "axis.{}.plant.relief_pressure: found {:.1} MPa, and a load at rest of {:.0} kN, {:.1} MPa, with {:.0} \
                 kg in the bucket in the posture {:.2?} m: the piston gives way there",
                axis.name,
                relief / 1e6,
                heaviest.force / 1e3,
                heaviest.pressure / 1e6,
                heaviest.payload,
                heaviest.positions
            )
        })
    };
    machine.axes.iter().zip(heaviest).filter_map(warning).collect()
}

/// The heaviest load at rest of each axis of the mechanism; with no pressure for an axis without a simulated plant.
fn heaviest(machine: &Machine, mechanism: &Mechanism) -> [Heaviest; AXES] {
    let own = mechanism.masses.payload;
    let changes = machine.scenario.changes.iter().filter(|change| change.parameter == Parameter::Payload);
    let most = changes.map(|change| change.to).fold(own.mass, f64::max);
    let prepared = mechanism.prepared();
    let mut heaviest =
        [Heaviest { pressure: f64::NEG_INFINITY, force: 0.0, payload: 0.0, positions: [0.0; AXES] }; AXES];
    for payload in [own.mass, most] {
        let masses = Masses { payload: Payload { mass: payload, ..own }, ..mechanism.masses };
        let moments = Moments::new(&masses);
        for number in 0..POSITIONS.pow(AXES as u32) {
            let positions = posture(machine, number);
            let pose = prepared.pose(&positions);
            let forces = moments.dynamics(&pose, &[0.0; AXES]).holding_force(&pose, Vector::default());
            for (i, (heaviest, force)) in heaviest.iter_mut().zip(forces).enumerate() {
                let Some(plant) = &machine.axes[i].plant else { continue };
                let pressure = if force > 0.0 { force / plant.piston_area } else { -force / plant.rod_area };
                if pressure > heaviest.pressure {
                    *heaviest = Heaviest { pressure, force, payload, positions };
                }
            }
        }
    }
    heaviest
}

/// The posture with this number on the grid over the soft limits, m.
fn posture(machine: &Machine, number: usize) -> [f64; AXES] {
    std::array::from_fn(|i| {
        let (low, high) = machine.axes[i].soft_limits;
        let place = number / POSITIONS.pow(i as u32) % POSITIONS;
        low + (high - low) * place as f64 / (POSITIONS - 1) as f64
    })
}
