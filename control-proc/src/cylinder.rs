//! The cylinder of an axis: what it pushes with, and how stiff its oil is.
//!
//! ```text
//! f = A_1 p_1 - A_2 p_2          k_i = B A_i^2 / V_i          V_1 = V_01 + A_1 y          V_2 = V_02 + A_2 (S - y)
//! ```
//!
//! f force in N, p_1 and p_2 pressures of piston side and rod side in Pa, A areas in m2; k stiffness of their oil in
//! N/m and B its bulk modulus in Pa, V volumes in m3 and V_0 those without the stroke, hoses included, y position and S
//! stroke in m. Source: Merritt, Hydraulic Control Systems (1967).

use std::f64::consts::TAU;

use pipeline::machine::Axis;

/// A cylinder.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    /// A_1 and A_2, m2.
    areas: [f64; 2],
    /// V_01 and V_02, m3.
    dead: [f64; 2],
    /// S, m.
    stroke: f64,
}

impl Cylinder {
    /// Of an axis whose machine file has its areas and volumes.
    pub fn of(axis: &Axis) -> Option<Self> {
        let plant = axis.plant.as_ref()?;
        let ports = &plant.ports;
        Some(Self {
            areas: [plant.piston_area, plant.rod_area],
            dead: [plant.piston_dead_volume + ports.piston_hose_volume, plant.rod_dead_volume + ports.rod_hose_volume],
            stroke: axis.stroke,
        })
    }

    /// f, N.
    pub fn force(&self, (piston, rod): (f64, f64)) -> f64 {
        piston * self.areas[0] - rod * self.areas[1]
    }

    /// Whether the piston at `position` m is away from its end stops by more than `way` m.
    pub fn is_free(&self, position: f64, way: f64) -> bool {
        way < position && position < self.stroke - way
    }

    /// Part of the frequency of a swing that is left where the oil of one chamber alone carries the load, of an
    /// extending axis that of the rod side and of a retracting one that of the piston side, at `position` m: root of
    /// k_2 and of k_1 over their sum.
    pub fn left(&self, position: f64) -> [f64; 2] {
        let [piston, rod] = self.stiffness(position);
        [rod, piston].map(|stiffness| (stiffness / (piston + rod)).sqrt())
    }

    /// Frequency with which `mass` kg swing on the oil of both chambers in the middle of the stroke, Hz; `bulk_modulus`
    /// in Pa.
    pub fn frequency(&self, mass: f64, bulk_modulus: f64) -> f64 {
        (bulk_modulus * self.middle() / mass).sqrt() / TAU
    }

    /// That frequency at `position` m, by the one of the middle.
    pub fn relative_frequency(&self, position: f64) -> f64 {
        let [piston, rod] = self.stiffness(position);
        ((piston + rod) / self.middle()).sqrt()
    }

    /// Area of the chamber that is drained, of an extending axis that of the rod side and of a retracting one that of
    /// the piston side, m2.
    pub fn drained(&self) -> [f64; 2] {
        [self.areas[1], self.areas[0]]
    }

    /// k_1 / B and k_2 / B at `position` m, m.
    fn stiffness(&self, position: f64) -> [f64; 2] {
        let position = position.clamp(0.0, self.stroke);
        let ways = [position, self.stroke - position];
        [0, 1].map(|i| self.areas[i] * self.areas[i] / (self.dead[i] + self.areas[i] * ways[i]))
    }

    /// (k_1 + k_2) / B in the middle of the stroke, m.
    fn middle(&self) -> f64 {
        self.stiffness(0.5 * self.stroke).iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pressures_push_by_their_areas_and_one_chamber_is_softer_than_both() {
        let cylinder = Cylinder { areas: [0.02, 0.01], dead: [1e-3, 1e-3], stroke: 1.0 };
        assert!((cylinder.force((10e6, 5e6)) - 150e3).abs() < 1e-6);
        assert!(cylinder.is_free(0.5, 0.01) && !cylinder.is_free(0.005, 0.01) && !cylinder.is_free(0.995, 0.01));
        // 4e-4 m4 over 11 l, 1e-4 m4 over 6 l.
        let (piston, rod) = (4e-4 / 11e-3, 1e-4 / 6e-3);
        let [extend, retract] = cylinder.left(0.5);
        assert!((extend * extend - rod / (piston + rod)).abs() < 1e-12);
        assert!((extend * extend + retract * retract - 1.0).abs() < 1e-12);
        assert_eq!(cylinder.left(2.0), cylinder.left(1.0));
        let expected = (1e9 * (piston + rod) / 5000.0f64).sqrt() / TAU;
        assert!((cylinder.frequency(5000.0, 1e9) / expected - 1.0).abs() < 1e-12);
        assert_eq!(cylinder.relative_frequency(0.5), 1.0);
        assert!(cylinder.relative_frequency(0.05) > 1.5 && cylinder.relative_frequency(0.95) > 1.2);
        assert_eq!(cylinder.drained(), [0.01, 0.02]);
    }
}
