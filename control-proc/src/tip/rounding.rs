//! A way without corners: arcs in the place of corners between straight lines, and a pitch whose rate does not jump.
//!
//! ```text
//! d = r (1 / cos(b/2) - 1)        t = r tan(b/2) <= l/2
//! m = 0 where h_0 h_1 <= 0, else 3 (l_0 + l_1) / ((2 l_1 + l_0) / h_0 + (l_1 + 2 l_0) / h_1)
//! ```
//!
//! b angle by which the direction changes, rad; d largest distance from the corner, m; r radius of the arc, m; t what
//! both lines lose, m, at most half of each length l. m change of pitch per length where two pieces meet, h_0 and h_1
//! their mean changes, l_0 and l_1 their lengths: the rule of Fritsch and Butland, with which the pitch does not
//! overshoot (A method for constructing local monotone piecewise cubic interpolants, SIAM J. Sci. Stat. Comput. 5,
//! 1984).
//!
//! A way that turns back keeps its corner: the teeth stand there.

use mechanism::Vector;

use super::piece::{Piece, Shape, TipPlace};

/// Changes of direction that are none, and those that turn back, rad.
const STRAIGHT: f64 = 1e-6;
const BACK: f64 = 3.0;
/// Least radius of an arc, m: a smaller one is as good as a stand.
const LEAST_RADIUS: f64 = 1e-3;

/// The pieces with arcs at most `most` m from the corners that they replace.
pub(super) fn rounded(pieces: &[Piece], most: f64) -> Vec<Piece> {
    let corners: Vec<Option<Corner>> =
        (1..pieces.len()).map(|i| Corner::between(&pieces[i - 1], &pieces[i], most)).collect();
    let lost = |corner: Option<&Option<Corner>>| corner.copied().flatten().map_or(0.0, |corner| corner.lost);
    let mut all = Vec::with_capacity(2 * pieces.len());
    for (i, piece) in pieces.iter().enumerate() {
        let before = i.checked_sub(1).and_then(|i| corners.get(i));
        let after = corners.get(i);
        let line = piece.without(lost(before), lost(after));
        let end = line.place(1.0);
        if line.length > 0.0 {
            all.push(line);
        }
        if let (Some(corner), Some(next)) = (after.copied().flatten(), pieces.get(i + 1)) {
            let pitch = next.place(corner.lost / next.way().norm()).pitch;
            all.push(corner.arc(i, end, pitch));
        }
    }
    smooth_pitch(&mut all);
    all
}

/// A corner that becomes an arc.
#[derive(Debug, Clone, Copy)]
struct Corner {
    /// t, m.
    lost: f64,
    /// r, m.
    radius: f64,
    /// b with its sign, counter-clockwise, rad.
    angle: f64,
    /// Direction of the first line.
    along: Vector,
}

impl Corner {
    fn between(one: &Piece, two: &Piece, most: f64) -> Option<Self> {
        let (first, second) = (one.way(), two.way());
        let shortest = first.norm().min(second.norm());
        let angle = first.cross(second).atan2(first.dot(second));
        if shortest == 0.0 || !(STRAIGHT..BACK).contains(&angle.abs()) {
            return None;
        }
        let half = 0.5 * angle.abs();
        let lost = (most / (1.0 / half.cos() - 1.0) * half.tan()).min(0.5 * shortest);
        let radius = lost / half.tan();
        (radius >= LEAST_RADIUS).then(|| Self { lost, radius, angle, along: (1.0 / first.norm()) * first })
    }

    /// The arc from `start` to the pitch `pitch`, rad.
    fn arc(&self, number: usize, start: TipPlace, pitch: f64) -> Piece {
        let center = start.at + (self.radius * self.angle.signum()) * self.along.normal();
        let (turn, length) = (pitch - start.pitch, self.radius * self.angle.abs());
        Piece { number, start, shape: Shape::Arc(center, self.angle), turn, turning: [turn / length; 2], length }
    }
}

impl Piece {
    /// The vector of a straight line, m; nothing of an arc.
    fn way(&self) -> Vector {
        if let Shape::Line(way) = self.shape { way } else { Vector::default() }
    }

    /// The straight line without these lengths at its ends, m.
    fn without(&self, first: f64, last: f64) -> Self {
        if first == 0.0 && last == 0.0 {
            return *self;
        }
        let long = self.way().norm();
        let left = ((long - first - last) / long).max(0.0);
        Self {
            start: self.place(first / long),
            shape: Shape::Line(left * self.way()),
            turn: left * self.turn,
            length: left * self.length,
            ..*self
        }
    }
}

/// Gives the pitch one rate where two pieces go on in one direction.
fn smooth_pitch(pieces: &mut [Piece]) {
    for i in 1..pieces.len() {
        let (one, two) = (pieces[i - 1], pieces[i]);
        if one.leads_into(&two) {
            let (h, l) = ([one.turn / one.length, two.turn / two.length], [one.length, two.length]);
            let mean = if h[0] * h[1] <= 0.0 {
                0.0
            } else {
                3.0 * (l[0] + l[1]) / ((2.0 * l[1] + l[0]) / h[0] + (l[1] + 2.0 * l[0]) / h[1])
            };
            (pieces[i - 1].turning[1], pieces[i].turning[0]) = (mean, mean);
        }
    }
}

#[cfg(test)]
mod tests {
    use pipeline::machine::{TipPiece, TipShape, TipTask, TipWithout};

    use super::super::way::Way;
    use super::*;

    fn way(places: &[([f64; 2], f64)], rounding: f64) -> Way {
        let piece = |&(to, pitch)| TipPiece { shape: TipShape::Line(to), pitch: Some(pitch), free: None };
        let pieces = places[1..].iter().map(piece).collect();
        let (start, pitch) = places[0];
        let task = TipTask {
            start,
            pitch,
            speed: 0.5,
            free: None,
            rounding,
            file: None,
            pieces,
            without: TipWithout::default(),
        };
        Way::new(&task, 1.5).unwrap()
    }

    const CURVED: [([f64; 2], f64); 6] = [
        ([7.0, 0.0], -100.0),
        ([6.4, -0.2], -105.0),
        ([5.6, -0.3], -118.0),
        ([5.0, -0.25], -120.0),
        ([4.4, 0.0], -119.0),
        ([4.2, 0.6], -119.0),
    ];

    #[test]
    fn a_way_with_rounded_corners_is_one_run_and_near_to_its_corners() {
        assert_eq!(way(&CURVED, 0.0).runs().len(), 5);
        for rounding in [0.002, 0.01, 0.1] {
            let way = way(&CURVED, rounding);
            assert_eq!(way.runs().len(), 1, "{rounding}");
            let all = (0.0, way.length());
            for ([x, z], _) in CURVED {
                let distance = way.distance(Vector::new(x, z), all);
                assert!(distance <= rounding * (1.0 + 1e-9), "{distance} at [{x}, {z}]");
            }
            let end = way.place(way.length());
            assert!((end.at - Vector::new(4.2, 0.6)).norm() < 1e-9 && (end.pitch.to_degrees() + 119.0).abs() < 1e-9);
        }
    }

    #[test]
    fn place_and_pitch_go_on_without_a_jump_of_their_rates_and_do_not_overshoot() {
        let way = way(&CURVED, 0.02);
        let parts = 200_000;
        let step = way.length() / f64::from(parts);
        let places: Vec<TipPlace> = (0..=parts).map(|k| way.place(step * f64::from(k))).collect();
        let rates: Vec<(Vector, f64)> = (places.windows(2))
            .map(|two| ((1.0 / step) * (two[1].at - two[0].at), (two[1].pitch - two[0].pitch) / step))
            .collect();
        for (k, two) in rates.windows(2).enumerate() {
            assert!((two[1].0 - two[0].0).norm() < 0.01, "direction at {k}");
            assert!((two[1].1 - two[0].1).abs() < 0.01, "pitch at {k}: {} {}", two[0].1, two[1].1);
        }
        let (least, most) = ((-120.0f64).to_radians(), (-100.0f64).to_radians());
        assert!(places.iter().all(|place| (least - 1e-9..=most + 1e-9).contains(&place.pitch)));
    }

    #[test]
    fn a_way_that_turns_back_keeps_its_corner() {
        let there = [([7.0, 0.0], -100.0), ([6.0, 0.0], -100.0), ([7.0, 0.0], -100.0)];
        let way = way(&there, 0.05);
        assert_eq!(way.runs().len(), 2);
        assert_eq!(way.place(1.0).at, Vector::new(6.0, 0.0));
    }
}
