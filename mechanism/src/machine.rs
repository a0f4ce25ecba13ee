//! Pins, bodies and cylinders of one machine, and its motion by cylinder positions.
//!
//! ```text
//! l = l_0 + x
//! ```
//!
//! l cylinder lengths from pin to pin in m, l_0 those at position 0, x positions of the pistons in m. For the telescope
//! l is the distance by which the arm is longer than [`Geometry::arm_length`].

use crate::{AXES, CylinderDynamics, Geometry, Linkage, Masses, Moments, Pose, vector::Vector};

/// One machine: its pins, its cylinders and its bodies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mechanism {
    /// Pins and lengths.
    pub geometry: Geometry,
    /// Length of each cylinder at position 0, m.
    pub retracted: [f64; AXES],
    /// Bodies and payload.
    pub masses: Masses,
}

impl Mechanism {
    /// Cylinder lengths, m, at these positions of the pistons, m.
    pub fn lengths(&self, positions: &[f64; AXES]) -> [f64; AXES] {
        std::array::from_fn(|i| self.retracted[i] + positions[i])
    }

    /// Positions of the pistons, m, at these cylinder lengths, m.
    pub fn positions(&self, lengths: &[f64; AXES]) -> [f64; AXES] {
        std::array::from_fn(|i| lengths[i] - self.retracted[i])
    }

    /// The machine prepared for many evaluations.
    pub fn prepared(&self) -> PreparedMechanism {
        PreparedMechanism {
            linkage: Linkage::new(&self.geometry),
            retracted: self.retracted,
            moments: Moments::new(&self.masses),
        }
    }
}

/// A machine with everything that its pose does not change computed once. A new payload needs a new one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PreparedMechanism {
    linkage: Linkage,
    retracted: [f64; AXES],
    moments: Moments,
}

impl PreparedMechanism {
    /// The pose at these positions of the pistons, m. Not finite where a linkage does not close.
    #[inline]
    pub fn pose(&self, positions: &[f64; AXES]) -> Pose {
        self.linkage.pose(&std::array::from_fn(|i| self.retracted[i] + positions[i]))
    }

    /// The equation of motion at `pose`, with speeds of the pistons `rates`, m/s, and a force on the teeth `tip_force`,
    /// N.
    #[inline]
    pub fn dynamics(&self, pose: &Pose, rates: &[f64; AXES], tip_force: Vector) -> CylinderDynamics {
        self.moments.dynamics(pose, &pose.joint_rates(rates)).of_cylinders(pose, rates, tip_force)
    }

    /// Kinetic and potential energy, J, at `pose` with speeds of the pistons `rates`, m/s. The potential energy is 0
    /// where the centre of mass is as high as the boom foot.
    pub fn energy(&self, pose: &Pose, rates: &[f64; AXES]) -> (f64, f64) {
        let joint_rates = pose.joint_rates(rates);
        let terms = self.moments.dynamics(pose, &joint_rates);
        let momentum = |i: usize| (0..AXES).map(|j| terms.mass[i][j] * joint_rates[j]).sum::<f64>();
        let twice: f64 = (0..AXES).map(|i| joint_rates[i] * momentum(i)).sum();
        (0.5 * twice, terms.potential_energy)
    }
}
