//! Pins and lengths of the machine.

use crate::{FourBar, triangle::Triangle, vector::Vector};

/// Where the pins are. Frames: the boom's origin is its foot and its x axis leads to the arm pin; the arm's origin is
/// the arm pin and its x axis leads along the telescope to the bucket pin; the bucket's origin is the bucket pin and
/// its x axis leads to the teeth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// Boom foot in the world, m.
    pub boom_foot: Vector,
    /// From boom foot to arm pin, m.
    pub boom_length: f64,
    /// Base of the boom cylinder, from the boom foot in the axes of the world, m.
    pub boom_cylinder_base: Vector,
    /// Rod pin of the boom cylinder in the boom frame, m.
    pub boom_cylinder_rod: Vector,
    /// Base of the arm cylinder in the boom frame, m.
    pub arm_cylinder_base: Vector,
    /// Rod pin of the arm cylinder in the arm frame, m.
    pub arm_cylinder_rod: Vector,
    /// From arm pin to bucket pin with the telescope at length 0, m.
    pub arm_length: f64,
    /// Linkage of the bucket, from the bucket pin in the axes of the arm, carried by the inner section.
    pub bucket: FourBar,
    /// From bucket pin to the teeth, m.
    pub bucket_length: f64,
}

impl Geometry {
    /// Joint, base and rod of the boom cylinder.
    pub(crate) fn boom_triangle(&self) -> Triangle {
        Triangle::new(self.boom_cylinder_base.norm(), self.boom_cylinder_rod.norm())
    }

    /// Base of the arm cylinder from the arm pin, in the axes of the boom.
    pub(crate) fn arm_base(&self) -> Vector {
        self.arm_cylinder_base - Vector::new(self.boom_length, 0.0)
    }

    /// Joint, base and rod of the arm cylinder.
    pub(crate) fn arm_triangle(&self) -> Triangle {
        Triangle::new(self.arm_base().norm(), self.arm_cylinder_rod.norm())
    }
}
