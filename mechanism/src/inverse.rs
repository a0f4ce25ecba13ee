//! Inverse kinematics: cylinder lengths from tip, bucket pitch and telescope.
//!
//! ```text
//! O_4 = tip - L_3 x(pitch)                          the bucket pin
//! O_2 = intersection of the circles about O_1 (L_1) and O_4 (L_2 + s), above the line O_1 O_4
//! l_1, l_2, l_4                                     of the rotations of the joints (see `joint`)
//! ```
//!
//! Four axes move the tip in three coordinates (x, z, pitch), so one axis is free: here the telescope s is given. The
//! elbow is always up, as on machines with a boom in one piece.

use crate::{
    AXES, Geometry, Joint,
    vector::{Rotation, Vector},
};

/// Why the tip cannot be at a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ReachError {
    /// Boom and arm are too short, or the place is too close.
    #[error("the bucket pin is out of reach of boom and arm")]
    BucketPin,
    /// The linkage of the bucket does not close at this pitch.
    #[error("the bucket's linkage does not close at this pitch")]
    BucketPitch,
}

impl Geometry {
    /// Cylinder lengths, m, that bring the teeth to `tip`, m, with the bucket's x axis at `pitch` and the telescope at
    /// length `telescope`, m. Strokes and limits of the cylinders are not looked at.
    ///
    /// # Errors
    /// The place is out of reach, or the bucket's linkage does not close.
    pub fn cylinder_lengths(&self, tip: Vector, pitch: Rotation, telescope: f64) -> Result<[f64; AXES], ReachError> {
        let pin = tip - self.bucket_length * pitch.axis() - self.boom_foot;
        let arm_length = self.arm_length + telescope;
        let distance = pin.dot(pin);
        let along = 0.5 * (distance + self.boom_length * self.boom_length - arm_length * arm_length) / distance;
        let across = (self.boom_length * self.boom_length / distance - along * along).sqrt();
        let elbow = along * pin + across * pin.normal();
        if !(elbow.x.is_finite() && elbow.z.is_finite()) {
            return Err(ReachError::BucketPin);
        }
        let boom = elbow.direction();
        let arm = (pin - elbow).direction();

        let bucket = self.length_of(Joint::Bucket, pitch * arm.inverse());
        if !bucket.is_finite() {
            return Err(ReachError::BucketPitch);
        }
        Ok([self.length_of(Joint::Boom, boom), self.length_of(Joint::Arm, boom.inverse() * arm), telescope, bucket])
    }
}
