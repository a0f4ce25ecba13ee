//! One piece of the way: a straight line or an arc, with the pitch of the bucket along it.
//!
//! ```text
//! phi(f) = phi_0 + (phi_1 - phi_0) (3 f^2 - 2 f^3) + l (m_0 (f^3 - 2 f^2 + f) + m_1 (f^3 - f^2))
//! ```
//!
//! f part of the piece from 0 to 1, phi pitch in rad, l length of the piece in m, m_0 and m_1 change of the pitch per
//! length at its ends in rad/m. With m_0 = m_1 = (phi_1 - phi_0) / l the pitch changes evenly.

use std::f64::consts::PI;

use mechanism::{Rotation, Vector};

/// Directions, curvatures and changes of pitch that differ by less than this are the same.
pub const SAME: f64 = 1e-6;

/// A place of the teeth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipPlace {
    /// Place of the teeth, m.
    pub at: Vector,
    /// Pitch of the bucket, rad.
    pub pitch: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// From the start by this vector, m.
    Line(Vector),
    /// About a centre (m) by an angle (rad).
    Arc(Vector, f64),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Number of the piece of the task.
    pub number: usize,
    pub start: TipPlace,
    pub shape: Shape,
    /// Change of pitch over the piece, rad.
    pub turn: f64,
    /// Change of pitch per length at both ends, rad/m.
    pub turning: [f64; 2],
    /// m.
    pub length: f64,
}

impl Piece {
    pub fn place(&self, part: f64) -> TipPlace {
        let at = match self.shape {
            Shape::Line(way) => self.start.at + part * way,
            Shape::Arc(center, angle) => center + Rotation::by(part * angle) * (self.start.at - center),
        };
        let (square, cube) = (part * part, part.powi(3));
        let bent = self.turning[0] * (cube - 2.0 * square + part) + self.turning[1] * (cube - square);
        let pitch = self.start.pitch + self.turn * (3.0 * square - 2.0 * cube) + self.length * bent;
        TipPlace { at, pitch }
    }

    /// Way of the teeth along the piece, m: 0 where the bucket turns and the teeth stay in place.
    pub fn travel(&self) -> f64 {
        self.length * self.rates(0.0).0.norm()
    }

    /// Change of place and of pitch per length, at a part of the piece.
    pub fn rates(&self, part: f64) -> (Vector, f64) {
        let way = match self.shape {
            Shape::Line(way) => way,
            Shape::Arc(center, angle) => angle * (self.place(part).at - center).normal(),
        };
        let [first, last] = self.turning;
        let turning = 6.0 * self.turn / self.length * (part - part * part)
            + first * (3.0 * part * part - 4.0 * part + 1.0)
            + last * (3.0 * part * part - 2.0 * part);
        ((1.0 / self.length) * way, turning)
    }

    /// Whether the next piece begins in the direction in which this one ends.
    pub fn leads_into(&self, next: &Self) -> bool {
        (self.rates(1.0).0 - next.rates(0.0).0).norm() < SAME
    }

    /// Distance of a place from the shape, m.
    pub fn distance(&self, at: Vector) -> f64 {
        let part = match self.shape {
            Shape::Line(way) if way.dot(way) > 0.0 => (at - self.start.at).dot(way) / way.dot(way),
            Shape::Line(_) => 0.0,
            Shape::Arc(center, angle) => {
                let (from, to) = (self.start.at - center, at - center);
                let turned = from.cross(to).atan2(from.dot(to));
                // Counted the way round that the arc goes.
                let turned = if turned * angle < 0.0 { turned + 2.0 * PI * angle.signum() } else { turned };
                let part = turned / angle;
                // Beyond the end: as far from it as from the start, the other way round.
                let beyond = 0.5 * (1.0 + 2.0 * PI / angle.abs());
                if part > beyond { 0.0 } else { part }
            }
        };
        (at - self.place(part.clamp(0.0, 1.0)).at).norm()
    }
}
