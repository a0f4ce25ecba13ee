//! Forward kinematics: from the cylinder lengths to joints, points and Jacobians.
//!
//! ```text
//! q = (theta_1, theta_2, s, theta_4)       boom from the x axis, arm from the boom, telescope, bucket from the arm
//! R_boom   = p_1 u(P_1) u(B_1)^-1          p_1 angle of the boom's triangle (see `triangle`)
//! R_arm    = R_boom p_2^-1 u(B_2 - O_2) u(A_1)^-1
//! R_bucket = R_arm R_4                     R_4 of the four-bar linkage (see `four_bar`)
//! O_2 = O_1 + L_1 x_boom,  O_4 = O_2 + (L_2 + s) x_arm,  tip = O_4 + L_3 x_bucket
//! dq = J dl,  J diagonal                   every joint depends on its own cylinder only
//! ```
//!
//! l cylinder lengths in m, u(v) the rotation from the x axis to v, x_body the x axis of a body; pins as in
//! [`Geometry`]. An extending boom cylinder lifts the boom, an extending arm cylinder draws the arm in, and an
//! extending bucket cylinder curls the bucket in, as on machines with a backhoe.

use crate::{
    AXES, Geometry,
    four_bar::PreparedFourBar,
    joint::Joint,
    triangle::Triangle,
    vector::{Rotation, Vector},
};

/// Pins and lengths with everything that no cylinder length changes computed once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linkage {
    boom_foot: Vector,
    boom_length: f64,
    arm_length: f64,
    bucket_length: f64,
    boom: Triangle,
    /// u(P_1) u(B_1)^-1
    boom_offset: Rotation,
    arm: Triangle,
    /// u(B_2 - O_2) u(A_1)^-1
    arm_offset: Rotation,
    bucket: PreparedFourBar,
}

impl Linkage {
    /// From the pins.
    pub fn new(geometry: &Geometry) -> Self {
        let offset = |base: Vector, rod: Vector| base.direction() * rod.direction().inverse();
        Self {
            boom_foot: geometry.boom_foot,
            boom_length: geometry.boom_length,
            arm_length: geometry.arm_length,
            bucket_length: geometry.bucket_length,
            boom: geometry.boom_triangle(),
            boom_offset: offset(geometry.boom_cylinder_base, geometry.boom_cylinder_rod),
            arm: geometry.arm_triangle(),
            arm_offset: offset(geometry.arm_base(), geometry.arm_cylinder_rod),
            bucket: PreparedFourBar::new(&geometry.bucket),
        }
    }

    /// Rotation of the body that `joint` turns, from the body before it, at the length `length` of its cylinder, m.
    /// That of the boom is from the axes of the world. Not finite where the linkage does not close.
    pub fn rotation(&self, joint: Joint, length: f64) -> Rotation {
        match joint {
            Joint::Boom => self.boom.angle(length).rotation * self.boom_offset,
            Joint::Arm => self.arm.angle(length).rotation.inverse() * self.arm_offset,
            Joint::Bucket => self.bucket.angle(length).rotation,
        }
    }

    /// The pose at cylinder lengths `lengths`, m.
    #[inline]
    pub fn pose(&self, lengths: &[f64; AXES]) -> Pose {
        let boom_angle = self.boom.angle(lengths[0]);
        let arm_angle = self.arm.angle(lengths[1]);
        let bucket_angle = self.bucket.angle(lengths[3]);
        let boom = boom_angle.rotation * self.boom_offset;
        let arm = boom * (arm_angle.rotation.inverse() * self.arm_offset);
        let bucket = arm * bucket_angle.rotation;

        let arm_pin = self.boom_foot + self.boom_length * boom.axis();
        let bucket_pin = arm_pin + (self.arm_length + lengths[2]) * arm.axis();
        Pose {
            boom,
            arm,
            bucket,
            boom_foot: self.boom_foot,
            arm_pin,
            bucket_pin,
            tip: bucket_pin + self.bucket_length * bucket.axis(),
            telescope: lengths[2],
            rate: [boom_angle.rate, -arm_angle.rate, 1.0, bucket_angle.rate],
            curvature: [boom_angle.curvature, -arm_angle.curvature, 0.0, bucket_angle.curvature],
        }
    }
}

/// The machine at four cylinder lengths. Not finite where a linkage does not close.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Boom, from the axes of the world.
    pub boom: Rotation,
    /// Arm and telescope, from the axes of the world.
    pub arm: Rotation,
    /// Bucket, from the axes of the world.
    pub bucket: Rotation,
    /// Boom foot, m.
    pub boom_foot: Vector,
    /// Arm pin, m.
    pub arm_pin: Vector,
    /// Bucket pin, m.
    pub bucket_pin: Vector,
    /// Teeth of the bucket, m.
    pub tip: Vector,
    /// Length of the telescope, m.
    pub telescope: f64,
    /// The diagonal of J, rad/m; 1 for the telescope.
    pub rate: [f64; AXES],
    /// dJ/dl, rad/m2; 0 for the telescope.
    pub curvature: [f64; AXES],
}

impl Pose {
    /// The pose at cylinder lengths `lengths`, m. [`Linkage::pose`] is faster for many lengths.
    pub fn new(geometry: &Geometry, lengths: &[f64; AXES]) -> Self {
        Linkage::new(geometry).pose(lengths)
    }

    /// Rotation of the body that `joint` turns, from the axes of the world.
    pub fn body(&self, joint: Joint) -> Rotation {
        match joint {
            Joint::Boom => self.boom,
            Joint::Arm => self.arm,
            Joint::Bucket => self.bucket,
        }
    }

    /// Rotation of the body that `joint` turns, from the body before it; that of the boom from the axes of the world.
    pub fn joint(&self, joint: Joint) -> Rotation {
        joint.before().map_or(Rotation::NONE, |before| self.body(before).inverse()) * self.body(joint)
    }

    /// Rates of the joints, rad/s (m/s for the telescope), of rates of the cylinders, m/s.
    #[inline]
    pub fn joint_rates(&self, cylinder_rates: &[f64; AXES]) -> [f64; AXES] {
        std::array::from_fn(|i| self.rate[i] * cylinder_rates[i])
    }

    /// Joint coordinates, rad (m for the telescope): boom from the x axis, arm from the boom, bucket from the arm. For
    /// reports: the last bits depend on the computer's library.
    pub fn joints(&self) -> [f64; AXES] {
        let arm = (self.arm * self.boom.inverse()).angle();
        let bucket = (self.bucket * self.arm.inverse()).angle();
        [self.boom.angle(), arm, self.telescope, bucket]
    }

    /// Velocity of the point `at`, m, per joint rate, when it is fixed to the body that the last of these joints moves;
    /// m/rad (1 for the telescope). `last` is the number of that joint.
    #[inline]
    pub fn jacobian(&self, at: Vector, last: usize) -> [Vector; AXES] {
        let all = [
            (at - self.boom_foot).normal(),
            (at - self.arm_pin).normal(),
            self.arm.axis(),
            (at - self.bucket_pin).normal(),
        ];
        std::array::from_fn(|i| if i <= last { all[i] } else { Vector::default() })
    }

    /// Velocity of the tip per cylinder rate, for the four cylinders.
    pub fn tip_jacobian(&self) -> [Vector; AXES] {
        let joints = self.jacobian(self.tip, 3);
        std::array::from_fn(|i| self.rate[i] * joints[i])
    }

    /// Velocity of the tip, m/s, at these cylinder rates, m/s.
    pub fn tip_velocity(&self, cylinder_rates: &[f64; AXES]) -> Vector {
        let jacobian = self.tip_jacobian();
        (0..AXES).fold(Vector::default(), |sum, i| sum + cylinder_rates[i] * jacobian[i])
    }
}
