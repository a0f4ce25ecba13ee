//! Vectors and rotations in the plane of the machine: x forward, z up, angles counter-clockwise.
//!
//! ```text
//! R(a) v = (cos a  x - sin a  z,  sin a  x + cos a  z)         R(a) R(b) = R(a + b)
//! a x b  = a_x b_z - a_z b_x                                   n(v) = (-v_z, v_x), v turned by +90 degrees
//! ```
//!
//! A rotation is carried as its cosine and its sine, and rotations are multiplied as complex numbers. So the kinematics
//! need only + - * / and the square root, whose results are the same on every computer.

use std::ops::{Add, Mul, Neg, Sub};

/// A vector in the plane of the machine.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Vector {
    /// Forward.
    pub x: f64,
    /// Up.
    pub z: f64,
}

impl Vector {
    /// The vector (x, z).
    pub const fn new(x: f64, z: f64) -> Self {
        Self { x, z }
    }

    /// Scalar product.
    pub fn dot(self, other: Self) -> f64 {
        self.x * other.x + self.z * other.z
    }

    /// Planar cross product; positive where `other` lies counter-clockwise of `self`.
    pub fn cross(self, other: Self) -> f64 {
        self.x * other.z - self.z * other.x
    }

    /// The vector turned by +90 degrees.
    pub fn normal(self) -> Self {
        Self::new(-self.z, self.x)
    }

    /// Length.
    pub fn norm(self) -> f64 {
        self.dot(self).sqrt()
    }

    /// The rotation from the x axis to this vector, which must not be zero.
    pub fn direction(self) -> Rotation {
        let norm = self.norm();
        Rotation { cos: self.x / norm, sin: self.z / norm }
    }
}

impl Add for Vector {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.x + other.x, self.z + other.z)
    }
}

impl Sub for Vector {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self::new(self.x - other.x, self.z - other.z)
    }
}

impl Neg for Vector {
    type Output = Self;

    fn neg(self) -> Self {
        Self::new(-self.x, -self.z)
    }
}

impl Mul<Vector> for f64 {
    type Output = Vector;

    fn mul(self, vector: Vector) -> Vector {
        Vector::new(self * vector.x, self * vector.z)
    }
}

/// A rotation, counter-clockwise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rotation {
    /// Cosine of the angle.
    pub cos: f64,
    /// Sine of the angle.
    pub sin: f64,
}

impl Rotation {
    /// No rotation.
    pub const NONE: Self = Self { cos: 1.0, sin: 0.0 };

    /// The rotation by as much the other way.
    pub fn inverse(self) -> Self {
        Self { cos: self.cos, sin: -self.sin }
    }

    /// The rotated x axis.
    pub fn axis(self) -> Vector {
        Vector::new(self.cos, self.sin)
    }

    /// The angle, rad, in (-pi, pi]. For reports: its last bits depend on the computer's library.
    pub fn angle(self) -> f64 {
        self.sin.atan2(self.cos)
    }

    /// The rotation by an angle, rad. For input of a person: its last bits depend on the computer's library.
    pub fn by(angle: f64) -> Self {
        Self { cos: angle.cos(), sin: angle.sin() }
    }
}

impl Mul for Rotation {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        Self { cos: self.cos * other.cos - self.sin * other.sin, sin: self.sin * other.cos + self.cos * other.sin }
    }
}

impl Mul<Vector> for Rotation {
    type Output = Vector;

    fn mul(self, vector: Vector) -> Vector {
        Vector::new(self.cos * vector.x - self.sin * vector.z, self.sin * vector.x + self.cos * vector.z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_multiply_as_their_angles_add() {
        let rotation = Rotation::by(0.4) * Rotation::by(-1.1);
        assert!((rotation.angle() + 0.7).abs() < 1e-15);
        assert!((rotation * rotation.inverse()).angle().abs() < 1e-15);
        let turned = Rotation::by(0.3) * Vector::new(2.0, -1.0);
        assert!((turned.norm() - 5f64.sqrt()).abs() < 1e-15);
        assert!((turned.direction().angle() - 0.3 - (-1f64).atan2(2.0)).abs() < 1e-15);
    }

    #[test]
    fn the_cross_product_is_the_scalar_product_with_the_normal() {
        let (a, b) = (Vector::new(0.3, -1.2), Vector::new(2.0, 0.7));
        assert_eq!(a.cross(b), a.normal().dot(b));
        assert_eq!(a.dot(a.normal()), 0.0);
    }
}
