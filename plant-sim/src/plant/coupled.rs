//! The fastest rate of the axes that a linkage couples. Used at construction only.
//!
//! ```text
//! r = max(lambda(M_l^-1 D) + r_bristles, r_hydraulic) + sqrt(lambda(M_l^-1 K))
//! K = diag(k_i) + s k_soil T,  D = diag(d_i) + s d_soil T                         T = J_tip^T J_tip
//! lambda(A) <= (tr A^64)^(1/64) <= 1.03 lambda(A)
//! ```
//!
//! r rate of which [`super::stiffness`] makes a condition for the step, 1/s; lambda the largest eigenvalue; M_l mass
//! that the cylinders feel, kg, with the least payload of the scenario; k_i and d_i stiffness, N/m, and damping, N s/m,
//! of axis i with its end stops, bristles and oil, as for an axis alone; k_soil and d_soil those of the soil at the
//! teeth and s its largest strength; J_tip motion of the teeth per motion of the cylinders; r_bristles and r_hydraulic
//! as for an axis alone, the latter the largest of all axes.
//!
//! The eigenvalues are those of the coupled modes: with the other cylinders free a cylinder moves far less than M_ii.
//! All eigenvalues of M_l^-1 K are real and not negative, because M_l and K are symmetric and M_l is positive definite.
//! The trace of a power is then an upper bound, and needs only squarings.
//!
//! The worst posture is looked for on a grid. The boom's angle turns the whole machine and changes nothing but the
//! boom's own lever arm, so only the boom's longest lever arm counts: the eigenvalues grow with it. The other three
//! axes take [`POSTURES`] positions each. Between them the eigenvalue is higher by less than one percent (a test shows
//! it on an excavator of 20 t), which the limit of the step covers.
//!
//! How deep a piston sinks into its end stops follows from the same loads; the linkage has to close there too. Only
//! forces at rest count: a piston that hits a stop at speed sinks deeper for a moment.
//!
//! Trap: the least mass of each axis by itself is not enough. Modes of arm, telescope and bucket against each other are
//! faster than those of any axis alone.

use mechanism::{AXES, CylinderDynamics};
use pipeline::machine::{Axis, Change, Hydraulics, Plant};

use super::stiffness::Parts;
use crate::{actuator::friction::FASTEST_BRISTLES, conditions::Work, coupling::Coupling};

/// Positions over the stroke of arm, telescope and bucket.
const POSTURES: usize = 7;

/// Positions over the stroke of the boom at which its lever arm is looked at.
const LEVERS: usize = 33;

/// A 4 x 4 matrix.
type Matrix = [[f64; AXES]; AXES];

/// What the axes of a linkage do in the worst case.
#[derive(Debug, Clone, Copy)]
pub struct Worst {
    /// Fastest rate of their motion, 1/s.
    pub rate: f64,
    /// The axis that makes it fast; `None` where the soil does.
    pub axis: Option<usize>,
    /// What of the axis does.
    pub by: &'static str,
    /// How deep each piston is pressed into its end stops, m.
    pub depths: [f64; AXES],
}

/// The worst of the axes of `coupling`, in all postures under the worst conditions that `changes` reach.
pub fn worst_of_coupled(
    axes: &[(&Axis, &Plant)],
    hydraulics: &Hydraulics,
    coupling: &Coupling,
    changes: &[Change],
    payload: f64,
) -> Worst {
    let reached = changes.iter().flat_map(|change| [change.start, change.end]);
    let works: Vec<Work> = reached.chain([0.0]).map(|time| Work::at(changes, payload, time)).collect();
    let strength = works.iter().map(|work| work.soil).fold(0.0, f64::max);
    let heaviest = works.iter().map(|work| work.payload).fold(payload, f64::max);
    let lightest = works.iter().map(|work| work.payload).fold(payload, f64::min);

    let (mut heavy, mut light) = (coupling.clone(), coupling.clone());
    heavy.work(heaviest, strength);
    light.work(lightest, strength);
    let loads = largest_loads(&heavy);
    let parts: [Parts; AXES] = std::array::from_fn(|i| {
        let (axis, plant) = axes[i];
        Parts::new(axis, plant, hydraulics, changes, i, loads[i])
    });
    let (soil_stiffness, soil_damping) =
        light.soil().map_or((0.0, 0.0), |soil| (strength * soil.stiffness(), strength * soil.damping()));
    let springs = Modes::new(&light, parts.map(|parts| parts.springs), soil_stiffness);
    let dampers = Modes::new(&light, parts.map(|parts| parts.damping), soil_damping);
    let (hydraulic, slowest) = largest(parts.map(|parts| parts.hydraulic));
    let losses = (dampers.largest + FASTEST_BRISTLES).max(hydraulic);
    let (axis, by) = if springs.largest.sqrt() > losses {
        (springs.fastest_axis(&light), "the stiffness of oil, bristles and end stops")
    } else if hydraulic > dampers.largest + FASTEST_BRISTLES {
        (Some(slowest), "valve, leakage and volumes")
    } else {
        (dampers.fastest_axis(&light), "damping of friction and end stops")
    };
    let rate = losses + springs.largest.sqrt();
    Worst { rate, axis, by, depths: parts.map(|parts| parts.depth) }
}

/// Eigenvalues of the coupled axes on springs or on dampers.
struct Modes {
    /// Of each axis, N/m or N s/m.
    own: [f64; AXES],
    /// At the teeth, N/m or N s/m.
    teeth: f64,
    /// The largest eigenvalue over all postures.
    largest: f64,
}

impl Modes {
    fn new(coupling: &Coupling, own: [f64; AXES], teeth: f64) -> Self {
        Self { own, teeth, largest: largest_eigenvalue(coupling, own, teeth) }
    }

    /// The axis that alone has the largest eigenvalue; `None` where the soil has.
    fn fastest_axis(&self, coupling: &Coupling) -> Option<usize> {
        let alone = |i: usize| std::array::from_fn(|k| if k == i { self.own[k] } else { 0.0 });
        let (most, axis) = largest(std::array::from_fn(|i| largest_eigenvalue(coupling, alone(i), 0.0)));
        let is_axis = self.teeth == 0.0 || most >= largest_eigenvalue(coupling, [0.0; AXES], self.teeth);
        is_axis.then_some(axis)
    }
}

/// The largest of four values, and its place.
fn largest(values: [f64; AXES]) -> (f64, usize) {
    let of_place = |(most, place), (i, value): (usize, f64)| if value > most { (value, i) } else { (most, place) };
    values.into_iter().enumerate().fold((0.0, 0), of_place)
}

/// The largest eigenvalue over all postures; NaN where one of them is no number.
fn largest_eigenvalue(coupling: &Coupling, own: [f64; AXES], teeth: f64) -> f64 {
    postures(coupling).map(|positions| eigenvalue(coupling, &positions, own, teeth)).fold(0.0, f64::max)
}

/// Postures over the strokes, with the boom where its lever arm is longest.
fn postures(coupling: &Coupling) -> impl Iterator<Item = [f64; AXES]> {
    let strokes = *coupling.strokes();
    let part = |i: usize, of: usize| i as f64 / (of - 1) as f64;
    let middle = strokes.map(|stroke| 0.5 * stroke);
    let at = |position: f64| [position, middle[1], middle[2], middle[3]];
    let rate = |position: &f64| coupling.pose(&at(*position)).rate[0].abs();
    let positions = (0..LEVERS).map(|i| part(i, LEVERS) * strokes[0]);
    let boom = positions.min_by(|a, b| rate(a).total_cmp(&rate(b))).unwrap_or_default();
    (0..POSTURES.pow(3)).map(move |number| {
        let digit = |place: u32| part(number / POSTURES.pow(place) % POSTURES, POSTURES);
        [boom, digit(0) * strokes[1], digit(1) * strokes[2], digit(2) * strokes[3]]
    })
}

/// Largest force of weight and soil on each cylinder over all postures, N.
fn largest_loads(coupling: &Coupling) -> [f64; AXES] {
    let strokes = *coupling.strokes();
    let force = coupling.soil().map_or(0.0, |soil| soil.strength * soil.resistance(f64::INFINITY));
    let mut largest = [0.0f64; AXES];
    for posture in postures(coupling) {
        // The weight turns with the boom, so all its positions count here.
        for i in 0..POSTURES {
            let mut positions = posture;
            positions[0] = strokes[0] * i as f64 / (POSTURES - 1) as f64;
            let (weights, tip) = (coupling.holding_forces(&positions), coupling.pose(&positions).tip_jacobian());
            for axis in 0..AXES {
                largest[axis] = largest[axis].max(weights[axis].abs() + force * tip[axis].norm());
            }
        }
    }
    largest
}

/// A bound of lambda(M_l^-1 (diag(`own`) + `teeth` J_tip^T J_tip)) at `positions` that is at most 3 % above it.
fn eigenvalue(coupling: &Coupling, positions: &[f64; AXES], own: [f64; AXES], teeth: f64) -> f64 {
    const SQUARINGS: usize = 6;
    let tip = coupling.pose(positions).tip_jacobian();
    let dynamics = CylinderDynamics { mass: coupling.mass(positions), load: [0.0; AXES] };
    let columns: Matrix = std::array::from_fn(|j| {
        let column = std::array::from_fn(|i| {
            let shared = teeth * tip[i].dot(tip[j]);
            if i == j { own[i] + shared } else { shared }
        });
        // The mass of a pose that closes is positive definite; [`Coupling::new`] has refused others.
        dynamics.acceleration(&column).unwrap_or([f64::INFINITY; AXES])
    });
    // The rows of `power` are the columns of the matrix: a matrix and its transpose have the same eigenvalues.
    let (mut power, mut bound, mut weight) = (columns, 1.0, 1.0);
    for _ in 0..=SQUARINGS {
        // Scaled by its trace, so that high powers stay finite.
        let trace: f64 = (0..AXES).map(|i| power[i][i]).sum();
        bound *= f64::powf(trace, weight);
        weight *= 0.5;
        let scaled = power.map(|row| row.map(|value| value / trace));
        power = std::array::from_fn(|i| std::array::from_fn(|j| (0..AXES).map(|k| scaled[i][k] * scaled[k][j]).sum()));
    }
    bound
}

#[cfg(test)]
mod tests;
