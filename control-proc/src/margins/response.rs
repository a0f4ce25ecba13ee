//! The open loop along the unit circle, from nearly 0 to half of the sampling frequency.
//!
//! ```text
//! z = 1 + r exp(j a), a from 0 to 90 degrees          then          z = exp(j b), b from r to 180 degrees
//! ```
//!
//! The small arc of radius r ([`SLOWEST`]) goes around the poles at rest, z = 1, so that turns can be counted from a
//! real number on. Between the points of a logarithmic grid more points are added until neither L nor 1 + L_u changes
//! by more than a small part from one to the next.

use std::f64::consts::PI;

use nalgebra::Complex;

use super::Loop;

/// r, rad in a period. A loop that grows by less than that in a period counts as stable.
const SLOWEST: f64 = 1e-5;
/// Points of the arc and of the grid before refinement.
const ARC: usize = 8;
const GRID: usize = 200;
/// Largest change of L from point to point, as a part of it, and of L where it is small.
const CHANGE: f64 = 0.05;
const SMALL: f64 = 0.02;
/// Largest change of 1 + L_u from point to point, as a part of it.
const TURN: f64 = 0.3;
/// Halvings of a step of the grid at most.
const HALVINGS: usize = 12;

/// The loop at one z.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// arg z, rad; 0 on the arc.
    pub angle: f64,
    /// C (G_0 - F M).
    pub inner: Complex<f64>,
    /// C F P.
    pub outer: Complex<f64>,
}

impl Point {
    /// L.
    pub fn open(&self) -> Complex<f64> {
        self.outer / (self.inner + 1.0)
    }

    /// 1 + L_u with `gain` times the gain of the plant.
    pub fn characteristic(&self, gain: f64) -> Complex<f64> {
        self.inner + self.outer * gain + 1.0
    }

    /// Whether the next point is near enough.
    fn is_near(&self, next: &Self) -> bool {
        let [from, to] = [self.open(), next.open()];
        let [before, after] = [self.characteristic(1.0), next.characteristic(1.0)];
        (to - from).norm() <= CHANGE * (from.norm() + SMALL) && (after - before).norm() <= TURN * before.norm()
    }
}

/// The loop along arc and circle.
pub fn response(of: &Loop) -> Vec<Point> {
    let on_arc = |i: usize| {
        let z = Complex::from_polar(SLOWEST, 0.5 * PI * i as f64 / ARC as f64) + 1.0;
        Point { angle: 0.0, ..of.point(z) }
    };
    let mut points: Vec<Point> = (0..ARC).map(on_arc).collect();
    let step = (PI / SLOWEST).ln() / GRID as f64;
    let angle = |i: usize| SLOWEST * (step * i as f64).exp();
    points.push(on_circle(of, angle(0)));
    for i in 1..=GRID {
        refine(of, &mut points, on_circle(of, angle(i)), HALVINGS);
    }
    points
}

fn on_circle(of: &Loop, angle: f64) -> Point {
    Point { angle, ..of.point(Complex::from_polar(1.0, angle)) }
}

/// Adds `next`, and before it as many points as are needed.
fn refine(of: &Loop, points: &mut Vec<Point>, next: Point, halvings: usize) {
    let Some(last) = points.last().copied() else { return };
    if halvings > 0 && !last.is_near(&next) {
        refine(of, points, on_circle(of, (last.angle * next.angle).sqrt()), halvings - 1);
        refine(of, points, next, halvings - 1);
    } else {
        points.push(next);
    }
}
