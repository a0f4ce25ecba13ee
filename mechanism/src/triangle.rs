//! A cylinder that turns a joint: the triangle of joint, cylinder base and rod pin.
//!
//! ```text
//! cos p   = (a^2 + b^2 - l^2) / (2 a b)           sin p = sqrt(1 - cos^2 p)
//! m       = a b sin p / l                         moment arm
//! dp/dl   = 1 / m
//! d2p/dl2 = -a b cos p / (l m^3) + 1 / (l m)
//! ```
//!
//! p angle at the joint, a and b distances from the joint to cylinder base and rod pin in m, l cylinder length from pin
//! to pin in m. Trap: at p = 0 and p = 180 degrees the moment arm is zero, dp/dl infinite, and the cylinder moves
//! nothing.

use crate::vector::Rotation;

/// Two fixed sides of the triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle {
    /// a, from joint to cylinder base, m.
    base: f64,
    /// b, from joint to rod pin, m.
    rod: f64,
    /// a b, m2.
    product: f64,
    /// a^2 + b^2, m2.
    squares: f64,
    /// 1 / (2 a b), 1/m2.
    inverse: f64,
}

/// The angle p of a triangle and its derivatives by the cylinder length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CylinderAngle {
    /// p.
    pub rotation: Rotation,
    /// dp/dl, rad/m.
    pub rate: f64,
    /// d2p/dl2, rad/m2.
    pub curvature: f64,
}

impl Triangle {
    /// From the sides, m.
    pub fn new(base: f64, rod: f64) -> Self {
        let product = base * rod;
        Self { base, rod, product, squares: base * base + rod * rod, inverse: 0.5 / product }
    }

    /// Cylinder lengths between which the triangle closes, m.
    pub fn lengths(&self) -> (f64, f64) {
        ((self.base - self.rod).abs(), self.base + self.rod)
    }

    /// p and its derivatives at cylinder length `length`, m. Not finite where the triangle does not close.
    #[inline]
    pub fn angle(&self, length: f64) -> CylinderAngle {
        let cos = (self.squares - length * length) * self.inverse;
        let sin = (1.0 - cos * cos).sqrt();
        // 1 / (l m)
        let inverse = 1.0 / (self.product * sin);
        let rate = length * inverse;
        CylinderAngle {
            rotation: Rotation { cos, sin },
            rate,
            curvature: inverse * (1.0 - self.product * cos * rate * rate),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_right_triangle_has_its_height_as_moment_arm() {
        let triangle = Triangle::new(3.0, 4.0);
        let at = triangle.angle(5.0);
        assert!(at.rotation.cos.abs() < 1e-15 && (at.rotation.sin - 1.0).abs() < 1e-15);
        assert!((at.rate - 1.0 / 2.4).abs() < 1e-15);
        assert_eq!(triangle.lengths(), (1.0, 7.0));
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let triangle = Triangle::new(0.823, 2.622);
        let step = 1e-5;
        for length in [1.9, 2.3, 2.8, 3.2] {
            let at = |l: f64| triangle.angle(l);
            let difference = (at(length + step).rotation.angle() - at(length - step).rotation.angle()) / (2.0 * step);
            assert!((at(length).rate - difference).abs() < 1e-8);
            let difference = (at(length + step).rate - at(length - step).rate) / (2.0 * step);
            assert!((at(length).curvature - difference).abs() < 1e-7);
        }
    }

    #[test]
    fn a_length_that_closes_nothing_has_no_angle() {
        let triangle = Triangle::new(1.0, 2.0);
        assert!(triangle.angle(3.1).rate.is_nan() && triangle.angle(0.9).rate.is_nan());
    }
}
