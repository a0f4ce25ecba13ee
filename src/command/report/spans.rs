//! Spans of time in which a number is constant.

/// Most spans of one axis; where there are more, the shorter half is left out.
const MOST: usize = 1000;

/// Spans of time in which a number is constant.
#[derive(Debug, Default)]
pub struct Spans {
    /// Begin, end, number.
    spans: Vec<(f64, f64, u32)>,
    is_cut: bool,
}

impl Spans {
    /// The number from `t` s on.
    pub fn push(&mut self, t: f64, number: u32) {
        let is_cut = std::mem::take(&mut self.is_cut);
        if let Some(last) = self.spans.last_mut().filter(|_| !is_cut) {
            last.1 = t;
            if last.2 == number {
                return;
            }
        }
        if self.spans.len() >= 2 * MOST {
            self.thin();
        }
        self.spans.push((t, t, number));
    }

    /// Nothing is known until the next number.
    pub fn cut(&mut self) {
        self.is_cut = true;
    }

    /// Leaves out the shorter half of the spans.
    fn thin(&mut self) {
        let mut lengths: Vec<f64> = self.spans.iter().map(|span| span.1 - span.0).collect();
        lengths.sort_by(f64::total_cmp);
        let shortest = lengths[lengths.len() / 2];
        self.spans.retain(|span| span.1 - span.0 > shortest);
    }

    /// Begin, end and number of each span.
    pub fn all(&self) -> &[(f64, f64, u32)] {
        &self.spans
    }

    /// Time with this number, s.
    pub fn time(&self, number: u32) -> f64 {
        self.spans.iter().filter(|span| span.2 == number).fold(0.0, |sum, span| sum + span.1 - span.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_end_at_gaps_and_are_bounded() {
        let mut spans = Spans::default();
        [(0.0, 1), (1.0, 1), (2.0, 2)].iter().for_each(|(t, number)| spans.push(*t, *number));
        spans.cut();
        spans.push(9.0, 2);
        assert_eq!(spans.all(), [(0.0, 2.0, 1), (2.0, 2.0, 2), (9.0, 9.0, 2)]);
        assert_eq!((spans.time(1), spans.time(2)), (2.0, 0.0));
        (0..100_000).for_each(|i| spans.push(10.0 + f64::from(i), i as u32 % 2));
        assert!(spans.all().len() <= 2 * MOST);
    }
}
