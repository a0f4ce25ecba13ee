//! The bucket's four-bar linkage: cylinder, rocker, link and bucket.
//!
//! ```text
//! J = R + r u(C - R) turned by -p          rocker end; p angle of the triangle R, C, J (see `triangle`)
//! K = the intersection of |K| = h and |K - J| = k on the outer side
//! dtheta/drho   = g = (p' x u) / (K x u)                                   p' = J - R,  u = K - J
//! dg/drho       = (dN - g dD) / D        N = p' x u,  D = K x u
//! dN            = (n(p') x u) + p' x du                                     du = g n(K) - n(p')
//! dD            = g (n(K) x u) + K x du
//! dtheta/dl     = g drho/dl              drho/dl = -dp/dl
//! d2theta/dl2   = dg/drho (drho/dl)^2 - g d2p/dl2
//! ```
//!
//! All points from the bucket pin in the axes of the inner arm, m: R rocker pin, C cylinder base, J rocker end, K link
//! pin on the bucket; r, k and h lengths of rocker, link and bucket arm, m; rho and theta angles of rocker and bucket,
//! l cylinder length in m, n(v) the vector v turned by +90 degrees. The outer side is the one on which the loop R, J,
//! K, bucket pin is convex. Trap: where K x u = 0 the link points at the bucket pin, a dead centre; behind it the
//! bucket would turn back.

use crate::{
    triangle::Triangle,
    vector::{Rotation, Vector},
};

/// Difference of two angles that are the same but for rounding.
const SAME: f64 = 1e-6;

/// The linkage between bucket cylinder and bucket.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FourBar {
    /// R, m.
    pub rocker_pin: Vector,
    /// C, m.
    pub cylinder_base: Vector,
    /// r, m.
    pub rocker: f64,
    /// k, m.
    pub link: f64,
    /// Link pin in the frame of the bucket, whose x axis points to the teeth, m; its length is h.
    pub link_pin: Vector,
}

/// The bucket's angle and its derivatives by the cylinder length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BucketAngle {
    /// theta, from the axes of the inner arm to those of the bucket.
    pub rotation: Rotation,
    /// dtheta/dl, rad/m.
    pub rate: f64,
    /// d2theta/dl2, rad/m2.
    pub curvature: f64,
}

impl FourBar {
    fn triangle(&self) -> Triangle {
        Triangle::new((self.cylinder_base - self.rocker_pin).norm(), self.rocker)
    }

    /// Cylinder lengths between which the cylinder's triangle closes, m; the loop of the link may close on a part of
    /// them.
    pub fn lengths(&self) -> (f64, f64) {
        self.triangle().lengths()
    }

    /// theta and its derivatives at cylinder length `length`, m. Not finite where the linkage does not close.
    pub fn angle(&self, length: f64) -> BucketAngle {
        PreparedFourBar::new(self).angle(length)
    }

    /// J, the end of the rocker, at cylinder length `length`, m, from the bucket pin in the axes of the arm. Not finite
    /// where the cylinder's triangle does not close.
    pub fn rocker_end(&self, length: f64) -> Vector {
        let prepared = PreparedFourBar::new(self);
        prepared.rocker_pin + prepared.rocker(prepared.triangle.angle(length).rotation)
    }

    /// The cylinder length at which the bucket stands at `rotation`, m. Not finite where the linkage does not close, or
    /// only behind a dead centre.
    pub fn length(&self, rotation: Rotation) -> f64 {
        let pin = rotation * self.link_pin;
        // Seen from the rocker pin.
        let end = intersection(self.rocker * self.rocker, pin - self.rocker_pin, self.link * self.link, Side::Left);
        let length = (self.cylinder_base - self.rocker_pin - end).norm();
        // Behind a dead centre the bucket stands elsewhere at this length.
        let turned = (self.angle(length).rotation * rotation.inverse()).angle();
        if turned.abs() < SAME { length } else { f64::NAN }
    }
}

/// A linkage with everything that no cylinder length changes computed once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PreparedFourBar {
    triangle: Triangle,
    rocker_pin: Vector,
    /// The vector of length r from R towards C, m.
    towards_base: Vector,
    /// k^2, m2.
    link_square: f64,
    /// h^2, m2.
    pin_square: f64,
    /// Turns a vector K of length h to the bucket's x axis of length 1; 1/m.
    to_bucket: Rotation,
}

impl PreparedFourBar {
    pub(crate) fn new(linkage: &FourBar) -> Self {
        let pin_square = linkage.link_pin.dot(linkage.link_pin);
        Self {
            triangle: linkage.triangle(),
            rocker_pin: linkage.rocker_pin,
            towards_base: linkage.rocker * (linkage.cylinder_base - linkage.rocker_pin).direction().axis(),
            link_square: linkage.link * linkage.link,
            pin_square,
            to_bucket: Rotation { cos: linkage.link_pin.x / pin_square, sin: -linkage.link_pin.z / pin_square },
        }
    }

    /// J - R at the angle p of the triangle.
    #[inline]
    fn rocker(&self, angle: Rotation) -> Vector {
        angle.inverse() * self.towards_base
    }

    /// As [`FourBar::angle`].
    #[inline]
    pub(crate) fn angle(&self, length: f64) -> BucketAngle {
        let angle = self.triangle.angle(length);
        let rocker = self.rocker(angle.rotation);
        let end = self.rocker_pin + rocker;
        let pin = intersection(self.pin_square, end, self.link_square, Side::Right);
        let link = pin - end;

        let inverse = 1.0 / pin.cross(link);
        let ratio = rocker.cross(link) * inverse;
        let turned = ratio * pin.normal() - rocker.normal();
        let moved_rate = rocker.normal().cross(link) + rocker.cross(turned);
        let opposed_rate = ratio * pin.normal().cross(link) + pin.cross(turned);
        let ratio_rate = (moved_rate - ratio * opposed_rate) * inverse;
        let pin = Rotation { cos: pin.x, sin: pin.z };
        BucketAngle {
            rotation: pin * self.to_bucket,
            rate: -ratio * angle.rate,
            curvature: ratio_rate * angle.rate * angle.rate - ratio * angle.curvature,
        }
    }
}

/// Side of the line from the origin to the other circle's centre.
#[derive(Clone, Copy, PartialEq)]
enum Side {
    Left,
    Right,
}

/// The point whose distance from the origin has the square `radius`, and whose distance from `centre` has the square
/// `distance`, m2, on one side of the line between origin and `centre`.
#[inline]
fn intersection(radius: f64, centre: Vector, distance: f64, side: Side) -> Vector {
    let between = centre.dot(centre);
    let inverse = 1.0 / between;
    let along = 0.5 * (between + radius - distance) * inverse;
    let across = (radius * inverse - along * along).sqrt();
    let across = if side == Side::Left { across } else { -across };
    along * centre + across * centre.normal()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As the built-in machine's, with a bucket arm at 101.5 degrees.
    fn linkage() -> FourBar {
        FourBar {
            rocker_pin: Vector::new(-0.41, 0.0),
            cylinder_base: Vector::new(-2.597, 0.711),
            rocker: 0.7,
            link: 0.6,
            link_pin: 0.466 * Rotation::by(101.5f64.to_radians()).axis(),
        }
    }

    #[test]
    fn all_four_bars_keep_their_lengths() {
        let linkage = linkage();
        for i in 0..=20 {
            let length = 1.68 + 0.056 * f64::from(i);
            let pin = linkage.angle(length).rotation * linkage.link_pin;
            assert!((pin.norm() - 0.466).abs() < 1e-15);
            assert!((linkage.length(linkage.angle(length).rotation) - length).abs() < 1e-12, "{length}");
        }
    }

    /// Regression: behind a dead centre the length of another angle was given, 48 degrees off for the built-in machine.
    #[test]
    fn a_length_is_that_of_its_angle_and_angles_behind_a_dead_centre_have_none() {
        let linkage = linkage();
        let rotations = (-180..180).map(|degrees| Rotation::by(f64::from(degrees).to_radians()));
        let closed: Vec<Rotation> = rotations.filter(|rotation| linkage.length(*rotation).is_finite()).collect();
        assert!((100..300).contains(&closed.len()), "{}", closed.len());
        for rotation in closed {
            let found = linkage.angle(linkage.length(rotation)).rotation;
            assert!((found * rotation.inverse()).angle().abs() < 1e-6, "{rotation:?} {found:?}");
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let linkage = linkage();
        let step = 1e-5;
        for length in [1.75, 2.0, 2.3, 2.6, 2.75] {
            let at = |l: f64| linkage.angle(l);
            let turned = (at(length + step).rotation * at(length - step).rotation.inverse()).angle();
            assert!((at(length).rate - turned / (2.0 * step)).abs() < 1e-8);
            let difference = (at(length + step).rate - at(length - step).rate) / (2.0 * step);
            assert!((at(length).curvature - difference).abs() < 1e-6);
        }
    }

    #[test]
    fn the_bucket_curls_over_its_stroke_as_such_a_machine_does() {
        let degrees = |length: f64| linkage().angle(length).rotation.angle().to_degrees();
        assert!((degrees(1.68) - 38.8).abs() < 0.1, "{}", degrees(1.68));
        assert!((degrees(2.8) + 123.2).abs() < 0.1, "{}", degrees(2.8));
    }

    #[test]
    fn a_linkage_that_does_not_close_has_no_angle() {
        let linkage = FourBar { link: 0.1, ..linkage() };
        assert!(linkage.angle(2.2).rate.is_nan());
    }
}
