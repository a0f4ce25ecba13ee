//! A curve through points (s, value), thinned so that no extreme is lost, with gaps where there is no value; and spans
//! of time in which a number is constant.

/// Stretches that the time of a picture is divided into. Each is drawn by its lowest and its highest point.
const STRETCHES: f64 = 1000.0;

/// Length of a stretch in a picture of `duration` s.
pub fn stretch(duration: f64) -> f64 {
    duration / STRETCHES
}

/// A curve.
pub struct Curve {
    /// The pieces between the gaps.
    pieces: Vec<Vec<(f64, f64)>>,
    /// Length of a stretch, s.
    stretch: f64,
    /// Begin, lowest and highest point of the stretch that is not closed yet.
    open: Option<[(f64, f64); 3]>,
}

impl Curve {
    /// A curve without points.
    pub fn new(stretch: f64) -> Self {
        Self { pieces: vec![Vec::new()], stretch, open: None }
    }

    /// Adds a point. A value that is not finite is a gap.
    pub fn push(&mut self, t: f64, value: f64) {
        let point = (t, value);
        match &mut self.open {
            _ if !value.is_finite() => {
                self.close();
                if self.pieces.last().is_some_and(|piece| !piece.is_empty()) {
                    self.pieces.push(Vec::new());
                }
            }
            Some([begin, low, high]) if t - begin.0 < self.stretch => {
                if value < low.1 {
                    *low = point;
                }
                if value > high.1 {
                    *high = point;
                }
            }
            _ => {
                self.close();
                self.open = Some([point; 3]);
            }
        }
    }

    /// Closes the present stretch.
    fn close(&mut self) {
        let Some([_, low, high]) = self.open.take() else { return };
        let (first, second) = if low.0 <= high.0 { (low, high) } else { (high, low) };
        let Some(piece) = self.pieces.last_mut() else { return };
        piece.push(first);
        if second != first {
            piece.push(second);
        }
    }

    /// The points of each piece.
    pub fn pieces(mut self) -> Vec<Vec<(f64, f64)>> {
        self.close();
        self.pieces.retain(|piece| !piece.is_empty());
        self.pieces
    }
}

/// The points as steps: each value is held until the next one.
pub fn held(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let first = points.first().copied();
    let steps = points.windows(2).flat_map(|pair| [(pair[1].0, pair[0].1), pair[1]]);
    first.into_iter().chain(steps).collect()
}

/// Spans of time in which a number is constant.
#[derive(Default)]
pub struct Spans {
    /// Begin, end, number.
    spans: Vec<(f64, f64, u32)>,
}

impl Spans {
    /// The number from `t` s on.
    pub fn push(&mut self, t: f64, number: u32) {
        if let Some(last) = self.spans.last_mut() {
            last.1 = t;
            if last.2 == number {
                return;
            }
        }
        self.spans.push((t, t, number));
    }

    /// Begin, end and number of each span.
    pub fn all(&self) -> &[(f64, f64, u32)] {
        &self.spans
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_thinned_and_keeps_its_extremes() {
        let mut line = Curve::new(stretch(100.0));
        for i in 0..100_000 {
            let spike = if i == 34_567 { 5.0 } else { 0.0 };
            line.push(f64::from(i) * 1e-3, f64::from(i).sin() + spike);
        }
        let points = line.pieces().concat();
        assert!((1000..=2002).contains(&points.len()), "{}", points.len());
        assert!(points.contains(&(34.567, f64::from(34_567).sin() + 5.0)));
        assert!(points.windows(2).all(|pair| pair[0].0 < pair[1].0));
    }

    #[test]
    fn a_short_line_is_drawn_whole() {
        let mut line = Curve::new(stretch(4.0));
        let points = [(1.0, 0.5), (2.0, -0.5), (2.1, 0.25), (5.0, 0.0)];
        points.iter().for_each(|(t, value)| line.push(*t, *value));
        let drawn = line.pieces();
        assert_eq!(drawn, [points]);
        assert_eq!(held(&drawn[0])[..3], [(1.0, 0.5), (2.0, 0.5), (2.0, -0.5)]);
    }

    #[test]
    fn a_line_has_a_gap_where_values_are_missing() {
        let mut line = Curve::new(stretch(100.0));
        let values = [f64::NAN, 1.0, 2.0, f64::NAN, f64::NAN, 3.0, f64::INFINITY];
        values.iter().zip(0..).for_each(|(value, t)| line.push(f64::from(t), *value));
        assert_eq!(line.pieces(), [vec![(1.0, 1.0), (2.0, 2.0)], vec![(5.0, 3.0)]]);
        assert!(Curve::new(1.0).pieces().is_empty());
    }

    #[test]
    fn equal_numbers_in_a_row_are_one_span() {
        let mut spans = Spans::default();
        [(0.0, 0), (1.0, 1), (2.0, 1), (3.0, 2)].iter().for_each(|(t, number)| spans.push(*t, *number));
        assert_eq!(spans.all(), [(0.0, 1.0, 0), (1.0, 3.0, 1), (3.0, 3.0, 2)]);
    }
}
