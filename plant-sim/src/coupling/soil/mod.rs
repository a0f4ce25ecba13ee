//! The soil at the teeth: the fundamental equation of earthmoving, with penetration of the teeth and a heap.
//!
//! ```text
//! F(d) = w (gamma d^2 N_g + c d N_c + c_a d N_a) + Q N_q + p A d/(d + d_0)               Q = gamma w H d
//! N_g  = (cot rho + cot b) sin(a + phi + b)/(2 sin e)      N_c = cos phi/(sin b sin e)   e = delta + rho + phi + b
//! N_a  = -cos(rho + phi + b)/(sin rho sin e)               N_q = sin(a + phi + b)/sin e
//! f    = -s F(d) v/sqrt(v^2 + v_0^2) (1 - max(0, v_n)/sqrt(v^2 + v_0^2))
//! ```
//!
//! | symbol | unit | meaning |
//! |---|---|---|
//! | F | N | force that cuts the soil |
//! | d | m | depth of the teeth below the surface of the ground, at right angles to it, from 0 to [`DEEPEST`] |
//! | w, rho | m, rad | width of the cut, angle of the blade to the ground |
//! | gamma, c, phi | N/m3, Pa, rad | weight, cohesion and angle of friction of the soil |
//! | delta, c_a | rad, Pa | angle of friction and adhesion between soil and steel |
//! | a | rad | angle at which the ground rises towards the machine, the direction of digging |
//! | b | rad | angle of the plane along which the soil fails: the one that makes N_g least |
//! | Q, H | N, m | weight of the soil before the bucket, and its height once the bucket is as deep in the ground |
//! | p, A, d_0 | Pa, m2, m | pressure against the edge of the teeth, its area, depth at which half of it acts |
//! | f, v, v_n | N, m/s | force on the teeth; their velocity, and its part out of the ground |
//! | v_0, s | m/s, 1 | speed below which the force falls to zero, strength that a scenario sets |
//!
//! Sources: A. R. Reece, The fundamental equation of earth-moving mechanics, 1964; E. McKyes, Soil Cutting and Tillage,
//! 1985, for N_a. Assumed: the whole force acts against the motion of the teeth, so that the soil never drives the
//! machine; the depth of the teeth is the depth of the cut; the heap grows with the depth; nothing holds teeth that
//! leave the ground at right angles; the rake angle does not follow the bucket's pitch.
//!
//! Trap: dry friction against the motion would be infinitely stiff at rest. v_0 makes it a damper there, so teeth that
//! a force pushes into the ground creep. A smaller v_0 needs a smaller step ([`crate::plant::stiffness`]).

use mechanism::Vector;
use pipeline::machine;

/// v_0, m/s: half of a slow speed of grading.
const SLOW: f64 = 0.1;

/// Largest depth that counts, m: deeper teeth are a bucket that is full.
pub const DEEPEST: f64 = 0.6;

/// d_0, m: assumed, about the length of the teeth's tips.
const HALF_PENETRATION: f64 = 0.05;

/// Angles b at which the least N_g is looked for, between 0 and that with e = 180 degrees.
const PLANES: usize = 2000;

/// The soil with the coefficients of its force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Soil {
    /// A point of the surface.
    surface: Vector,
    /// Unit vector out of the ground.
    out: Vector,
    /// w gamma N_g, N/m2.
    square: f64,
    /// w (c N_c + c_a N_a + gamma H N_q), N/m.
    linear: f64,
    /// p A, N.
    penetration: f64,
    /// s.
    pub strength: f64,
}

impl Soil {
    /// Soil of the machine file; its strength is 0 until a scenario sets it.
    pub fn new(soil: &machine::Soil) -> Self {
        let rise = soil.slope.to_radians();
        let (phi, rho) = (soil.friction_angle.to_radians(), soil.rake_angle.to_radians());
        let plane = Plane { phi, rho, delta: soil.steel_friction_angle.to_radians(), slope: -rise };
        let b = plane.of_failure();
        let cut = soil.cohesion * plane.cohesion(b) + soil.adhesion * plane.adhesion(b);
        let heap = soil.unit_weight * soil.heap * plane.surcharge(b);
        Self {
            surface: Vector::new(0.0, soil.level),
            out: Vector::new(-rise.sin(), rise.cos()),
            square: soil.width * soil.unit_weight * plane.weight(b),
            // Adhesion alone may not pull the blade.
            linear: soil.width * (cut + heap).max(0.0),
            penetration: soil.penetration_resistance * soil.teeth_area,
            strength: 0.0,
        }
    }

    /// F at depth `depth` m, N.
    #[inline]
    pub fn resistance(&self, depth: f64) -> f64 {
        let depth = depth.clamp(0.0, DEEPEST);
        depth * (self.square * depth + self.linear + self.penetration / (depth + HALF_PENETRATION))
    }

    /// f on teeth at `tip` m that move with `velocity` m/s, N.
    #[inline]
    pub fn force(&self, tip: Vector, velocity: Vector) -> Vector {
        let depth = -(tip - self.surface).dot(self.out);
        let inverse = 1.0 / (velocity.dot(velocity) + SLOW * SLOW).sqrt();
        let held = 1.0 - velocity.dot(self.out).max(0.0) * inverse;
        (-self.strength * self.resistance(depth) * held * inverse) * velocity
    }

    /// Largest damping of the teeth's motion by soil of strength 1, N s/m: that at rest.
    pub fn damping(&self) -> f64 {
        self.resistance(DEEPEST) / SLOW
    }

    /// Largest slope of the force by depth of soil of strength 1, N/m.
    pub fn stiffness(&self) -> f64 {
        2.0 * self.square * DEEPEST + self.linear + self.penetration / HALF_PENETRATION
    }
}

/// Blade, soil and slope by their angles, rad.
struct Plane {
    phi: f64,
    rho: f64,
    delta: f64,
    /// a.
    slope: f64,
}

impl Plane {
    /// sin e at failure angle `b`.
    fn sin_e(&self, b: f64) -> f64 {
        (self.delta + self.rho + self.phi + b).sin()
    }

    /// N_g.
    fn weight(&self, b: f64) -> f64 {
        (self.rho.tan().recip() + b.tan().recip()) * self.surcharge(b) / 2.0
    }

    /// N_c.
    fn cohesion(&self, b: f64) -> f64 {
        self.phi.cos() / (b.sin() * self.sin_e(b))
    }

    /// N_a.
    fn adhesion(&self, b: f64) -> f64 {
        -(self.rho + self.phi + b).cos() / (self.rho.sin() * self.sin_e(b))
    }

    /// N_q.
    fn surcharge(&self, b: f64) -> f64 {
        (self.slope + self.phi + b).sin() / self.sin_e(b)
    }

    /// The angle b at which N_g is least.
    fn of_failure(&self) -> f64 {
        let most = std::f64::consts::PI - self.delta - self.rho - self.phi;
        let planes = (1..PLANES).map(|i| most * i as f64 / PLANES as f64);
        // A slope that falls as steeply as the soil slides by itself needs no force: N_g is then not positive.
        let resists = planes.filter(|b| *b > -self.slope && self.weight(*b) > 0.0);
        resists.min_by(|a, b| self.weight(*a).total_cmp(&self.weight(*b))).unwrap_or(most / 2.0)
    }
}

#[cfg(test)]
mod tests;
