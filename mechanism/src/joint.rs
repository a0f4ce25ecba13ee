//! One joint and its cylinder: the angle that belongs to a length, and the length that belongs to an angle.
//!
//! ```text
//! R_boom  = p_1 u(P_1) u(B_1)^-1              l_1 = |R_boom B_1 - P_1|
//! R_arm   = p_2^-1 u(B_2 - O_2) u(A_1)^-1     l_2 = |R_arm A_1 - (B_2 - O_2)|
//! R_4     of the four-bar linkage             l_4 as in `four_bar`
//! ```
//!
//! R rotation of a body from the body before it, for the boom from the axes of the world; l length of its cylinder, m;
//! pins as in [`Geometry`], other symbols as in `pose`. Each joint depends on its own cylinder only. Trap: a length
//! follows from every rotation, also from one that the stroke does not reach; whoever measures an angle has to look at
//! the stroke.

use crate::{Geometry, vector::Rotation};

/// A joint that a cylinder turns. The telescope has none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Joint {
    /// Between machine and boom.
    Boom,
    /// Between boom and arm.
    Arm,
    /// Between arm and bucket.
    Bucket,
}

impl Joint {
    /// The joints, from the machine to the bucket.
    pub const ALL: [Self; 3] = [Self::Boom, Self::Arm, Self::Bucket];

    /// The joint that the axis with this number turns: boom, arm, telescope, bucket.
    pub fn of_axis(axis: usize) -> Option<Self> {
        Self::ALL.into_iter().find(|joint| joint.axis() == axis)
    }

    /// Number of the axis that turns this joint.
    pub fn axis(self) -> usize {
        match self {
            Self::Boom => 0,
            Self::Arm => 1,
            Self::Bucket => 3,
        }
    }

    /// The joint before this one, seen from the machine.
    pub fn before(self) -> Option<Self> {
        match self {
            Self::Boom => None,
            Self::Arm => Some(Self::Boom),
            Self::Bucket => Some(Self::Arm),
        }
    }
}

impl Geometry {
    /// Length of the cylinder of `joint`, m, at the rotation `rotation` of its body from the body before it. Not finite
    /// where the bucket's linkage does not close.
    pub fn length_of(&self, joint: Joint, rotation: Rotation) -> f64 {
        match joint {
            Joint::Boom => (rotation * self.boom_cylinder_rod - self.boom_cylinder_base).norm(),
            Joint::Arm => (rotation * self.arm_cylinder_rod - self.arm_base()).norm(),
            Joint::Bucket => self.bucket.length(rotation),
        }
    }
}
