//! The way of the teeth: straight lines and arcs, one after the other.
//!
//! ```text
//! line    p(f) = p_0 + f (p_1 - p_0)                  arc    p(f) = c + R(f a) (p_0 - c)
//! pitch   phi(f) = phi_0 + f (phi_1 - phi_0)          length = max(length of the shape, L |phi_1 - phi_0|)
//! ```
//!
//! f part of the piece from 0 to 1, p place of the teeth in m, c centre in m, a angle of the arc in rad, R rotation,
//! phi pitch of the bucket in rad, L length of the bucket in m. A piece on which the teeth stay in place and the bucket
//! turns has a length as well: the way of the teeth about the pin. s is the length along all pieces, m. The way of the
//! teeth themselves is shorter where they turn in place: [`Way::travel`].

use mechanism::Vector;
use pipeline::machine::{TipShape, TipTask};

pub use super::piece::TipPlace;
use super::{
    piece::{Piece, SAME, Shape},
    rounding::rounded,
};

/// Shortest piece, m.
const SHORTEST: f64 = 1e-6;

/// The way of the teeth, by its length s in m.
#[derive(Debug, Clone, PartialEq)]
pub struct Way {
    pieces: Vec<Piece>,
    /// s at the end of each piece, m.
    ends: Vec<f64>,
    /// Way of the teeth to the end of each piece, m.
    travels: Vec<f64>,
}

impl Way {
    /// The way of a task of a machine whose bucket is `bucket_length` m long. Or the number of a piece without length.
    pub fn new(task: &TipTask, bucket_length: f64) -> Result<Self, usize> {
        let mut place = TipPlace { at: Vector::new(task.start[0], task.start[1]), pitch: task.pitch.to_radians() };
        let mut pieces = Vec::new();
        for (i, piece) in task.pieces.iter().enumerate() {
            let (shape, way) = match piece.shape {
                TipShape::Line([x, z]) => {
                    let way = Vector::new(x, z) - place.at;
                    (Shape::Line(way), way.norm())
                }
                TipShape::Arc { center: [x, z], angle } => {
                    let (center, angle) = (Vector::new(x, z), angle.to_radians());
                    (Shape::Arc(center, angle), angle.abs() * (place.at - center).norm())
                }
            };
            let turn = piece.pitch.map_or(0.0, |pitch| pitch.to_radians() - place.pitch);
            let length = way.max(bucket_length * turn.abs());
            if length < SHORTEST {
                return Err(i);
            }
            let piece = Piece { number: i, start: place, shape, turn, turning: [turn / length; 2], length };
            place = piece.place(1.0);
            pieces.push(piece);
        }
        if task.rounding > 0.0 {
            pieces = rounded(&pieces, task.rounding);
        }
        let sums = |of: fn(&Piece) -> f64| {
            let add = |end: &mut f64, piece: &Piece| {
                *end += of(piece);
                Some(*end)
            };
            pieces.iter().scan(0.0, add).collect()
        };
        let (ends, travels) = (sums(|piece| piece.length), sums(Piece::travel));
        Ok(Self { pieces, ends, travels })
    }

    /// Number of the piece of the task at s, m.
    pub fn number(&self, s: f64) -> usize {
        self.pieces[self.piece(s)].number
    }

    /// Pieces of the task in their order, each with s at its begin and at its end, m.
    pub fn spans(&self) -> Vec<(usize, (f64, f64))> {
        let mut spans: Vec<(usize, (f64, f64))> = Vec::new();
        let mut begin = 0.0;
        for (piece, end) in self.pieces.iter().zip(&self.ends) {
            match spans.last_mut() {
                Some((number, span)) if *number == piece.number => span.1 = *end,
                _ => spans.push((piece.number, (begin, *end))),
            }
            begin = *end;
        }
        spans
    }

    /// s at the end of a piece of the task, m, with the arc after it; none where there is no such piece.
    pub fn end(&self, number: usize) -> Option<f64> {
        let last = self.pieces.iter().rposition(|piece| piece.number == number)?;
        self.ends.get(last).copied()
    }

    /// s at the end, m.
    pub fn length(&self) -> f64 {
        self.ends.last().copied().unwrap_or_default()
    }

    /// Way of the teeth up to s, m: turns in place are no part of it.
    pub fn travel(&self, s: f64) -> f64 {
        let (i, part) = self.part(s);
        self.travels[i] - (1.0 - part) * self.pieces[i].travel()
    }

    /// Where the teeth are at s, m.
    pub fn place(&self, s: f64) -> TipPlace {
        let (i, part) = self.part(s);
        self.pieces[i].place(part)
    }

    /// Change of place and of pitch per length at s, m.
    pub fn rates(&self, s: f64) -> (Vector, f64) {
        let (i, part) = self.part(s);
        self.pieces[i].rates(part)
    }

    /// Place in the list of the piece at s, m, and the part of the piece from 0 to 1.
    fn part(&self, s: f64) -> (usize, f64) {
        let i = self.piece(s);
        let length = self.pieces[i].length;
        (i, ((s - (self.ends[i] - length)) / length).clamp(0.0, 1.0))
    }

    /// Place in the list of the piece at s, m.
    fn piece(&self, s: f64) -> usize {
        self.ends.partition_point(|end| *end <= s).min(self.pieces.len() - 1)
    }

    /// The runs of the way: from s to s, m. Between two of them the teeth or the bucket change their direction, so they
    /// stand there.
    pub fn runs(&self) -> Vec<(f64, f64)> {
        let mut runs = Vec::new();
        let mut begin = 0.0;
        for (i, end) in self.ends.iter().enumerate() {
            let goes_on = self.pieces.get(i + 1).is_some_and(|next| {
                let piece = &self.pieces[i];
                piece.leads_into(next) && (piece.rates(1.0).1 - next.rates(0.0).1).abs() < SAME
            });
            if !goes_on {
                runs.push((begin, *end));
                begin = *end;
            }
        }
        runs
    }

    /// Distance of a place (m) from the way between two s, m.
    pub fn distance(&self, at: Vector, (from, to): (f64, f64)) -> f64 {
        let pieces = &self.pieces[self.piece(from)..=self.piece(to)];
        pieces.iter().map(|piece| piece.distance(at)).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use pipeline::machine::{TipPiece, TipWithout};

    use std::f64::consts::PI;

    use super::*;

    fn task(pieces: &[(TipShape, Option<f64>)]) -> TipTask {
        let pieces =
            pieces.iter().map(|(shape, pitch)| TipPiece { shape: *shape, pitch: *pitch, free: None }).collect();
        TipTask {
            start: [7.0, 0.0],
            pitch: -90.0,
            speed: 0.5,
            free: None,
            rounding: 0.0,
            file: None,
            pieces,
            without: TipWithout::default(),
        }
    }

    #[test]
    fn a_line_an_arc_and_a_turn_follow_each_other() {
        let pieces = [
            (TipShape::Line([5.0, 0.0]), None),
            (TipShape::Arc { center: [5.0, 1.0], angle: -90.0 }, None),
            (TipShape::Line([4.0, 1.0]), Some(-150.0)),
        ];
        let way = Way::new(&task(&pieces), 1.5).unwrap();
        let (arc, turn) = (PI / 2.0, 1.5 * PI / 3.0);
        assert!((way.length() - (2.0 + arc + turn)).abs() < 1e-12);
        // The teeth stay in place on the last piece.
        assert!((way.travel(way.length()) - (2.0 + arc)).abs() < 1e-12);
        // Line and arc have the same direction where they meet; the turn begins from a stand.
        assert_eq!(way.runs().len(), 2);
        assert!((way.runs()[0].1 - (2.0 + arc)).abs() < 1e-12);
        let middle = way.place(2.0 + 0.5 * arc);
        let expected = Vector::new(5.0, 1.0) + (-(0.5f64.sqrt())) * Vector::new(1.0, 1.0);
        assert!((middle.at - expected).norm() < 1e-12, "{middle:?}");
        let end = way.place(way.length());
        assert!((end.at - Vector::new(4.0, 1.0)).norm() < 1e-12 && (end.pitch + 150f64.to_radians()).abs() < 1e-12);
        assert_eq!(Way::new(&task(&[(TipShape::Line([7.0, 0.0]), None)]), 1.5), Err(0));
    }

    #[test]
    fn the_distance_is_that_to_the_nearest_place_of_the_way() {
        let pieces = [(TipShape::Line([5.0, 0.0]), None), (TipShape::Arc { center: [5.0, 1.0], angle: -270.0 }, None)];
        let way = Way::new(&task(&pieces), 1.5).unwrap();
        let all = (0.0, way.length());
        let near = |x, z| way.distance(Vector::new(x, z), all);
        assert!((near(6.0, 0.01) - 0.01).abs() < 1e-12);
        assert!((near(3.9, 1.0) - 0.1).abs() < 1e-12);
        assert!((near(5.0, 2.2) - 0.2).abs() < 1e-12);
        assert!((near(7.3, 0.4) - 0.5).abs() < 1e-12);
        // Every place of the way is on it, and every place beside it as far as it is away.
        for i in 0..500 {
            let s = way.length() * f64::from(i) / 499.0;
            assert!(way.distance(way.place(s).at, all) < 1e-9, "{s}");
        }
    }
}
