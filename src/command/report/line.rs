//! A line of unknown length with a bounded number of points, which keeps every peak.

/// Most groups of a line: about one for each pixel that a picture has on paper.
const MOST: usize = 500;

/// Lowest and highest point of some values that follow each other.
type Extremes = [(f64, f64); 2];

/// A line that grows value by value. When it has too many groups, two neighbours become one.
#[derive(Debug)]
pub struct Line {
    groups: Vec<Extremes>,
    /// Values of a whole group.
    each: usize,
    /// Values of the last group.
    count: usize,
}

impl Line {
    /// A line without values.
    pub fn new() -> Self {
        Self { groups: Vec::new(), each: 1, count: 0 }
    }

    /// Adds a value at `t` s, which does not go back. A value that is not finite breaks the line.
    pub fn push(&mut self, t: f64, value: f64) {
        let point = (t, value);
        let is_broken = |group: &Extremes| !group[0].1.is_finite();
        match self.groups.last_mut() {
            Some(last) if is_broken(last) && !value.is_finite() => {}
            Some(last) if self.count < self.each && value.is_finite() && !is_broken(last) => {
                merge(last, &[point; 2]);
                self.count += 1;
            }
            _ => {
                if self.groups.len() >= 2 * MOST {
                    self.halve();
                }
                self.groups.push([point; 2]);
                self.count = 1;
            }
        }
    }

    /// Breaks the line at `t` s.
    pub fn cut(&mut self, t: f64) {
        if !self.groups.is_empty() {
            self.push(t, f64::NAN);
        }
    }

    fn halve(&mut self) {
        let mut halved: Vec<Extremes> = Vec::with_capacity(2 * MOST);
        let mut is_open = false;
        for group in &self.groups {
            let is_whole = group[0].1.is_finite();
            match halved.last_mut() {
                Some(last) if is_open && is_whole => {
                    merge(last, group);
                    is_open = false;
                }
                _ => {
                    halved.push(*group);
                    is_open = is_whole;
                }
            }
        }
        // A line that is broken at nearly every value is drawn without its breaks.
        if halved.len() > 3 * MOST / 2 {
            halved.retain(|group| group[0].1.is_finite());
        }
        self.groups = halved;
        self.each = self.each.saturating_mul(2);
    }

    /// The points; one that is not finite breaks the line.
    pub fn points(&self) -> Vec<(f64, f64)> {
        let mut points = Vec::new();
        for [low, high] in &self.groups {
            let (first, second) = if low.0 <= high.0 { (low, high) } else { (high, low) };
            points.push(*first);
            if first != second && second.1.is_finite() {
                points.push(*second);
            }
        }
        points
    }
}

fn merge(into: &mut Extremes, from: &Extremes) {
    if from[0].1 < into[0].1 {
        into[0] = from[0];
    }
    if from[1].1 > into[1].1 {
        into[1] = from[1];
    }
}

/// Values of some messages, so few that a picture can show all of them, spread over a time of unknown length.
#[derive(Debug)]
pub struct Spread<T> {
    kept: Vec<(f64, T)>,
    /// Messages from one that is kept to the next one.
    every: u64,
    seen: u64,
}

impl<T> Spread<T> {
    /// Nothing yet.
    pub fn new() -> Self {
        Self { kept: Vec::new(), every: 1, seen: 0 }
    }

    /// Adds a value at `t` s if it is its turn.
    pub fn push(&mut self, t: f64, value: impl FnOnce() -> T) {
        let is_turn = self.seen.is_multiple_of(self.every);
        self.seen += 1;
        if !is_turn {
            return;
        }
        self.kept.push((t, value()));
        if self.kept.len() >= MOST {
            let mut index = 0;
            self.kept.retain(|_| {
                index += 1;
                index % 2 == 1
            });
            self.every *= 2;
        }
    }

    /// Times and values.
    pub fn kept(&self) -> &[(f64, T)] {
        &self.kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_line_is_bounded_and_keeps_every_peak_and_break() {
        let mut line = Line::new();
        for i in 0..1_000_000 {
            match i {
                500_000 => line.cut(f64::from(i)),
                777 => line.push(f64::from(i), 9.0),
                999_998 => line.push(f64::from(i), -9.0),
                _ => line.push(f64::from(i), f64::from(i % 7)),
            }
        }
        let points = line.points();
        assert!(points.len() > MOST && points.len() <= 4 * MOST, "{}", points.len());
        assert!(points.contains(&(777.0, 9.0)) && points.contains(&(999_998.0, -9.0)));
        assert_eq!(points.iter().filter(|point| point.1.is_nan()).count(), 1);
        assert!(points.windows(2).all(|pair| pair[0].0 <= pair[1].0));
    }

    #[test]
    fn a_short_line_has_all_its_points() {
        let mut line = Line::new();
        line.cut(0.0);
        (0..50).for_each(|i| line.push(f64::from(i), f64::from(i)));
        assert_eq!(line.points(), (0..50).map(|i| (f64::from(i), f64::from(i))).collect::<Vec<_>>());
    }

    #[test]
    fn a_line_that_is_broken_everywhere_is_bounded_as_well() {
        let mut line = Line::new();
        (0..100_000).for_each(|i| line.push(f64::from(i), if i % 2 == 0 { 1.0 } else { f64::NAN }));
        assert!(line.points().len() <= 4 * MOST);
    }

    #[test]
    fn values_are_spread_over_the_whole_time() {
        let mut spread = Spread::new();
        (0..10_000).for_each(|i| spread.push(f64::from(i), || i));
        let kept = spread.kept();
        assert!(kept.len() > MOST / 4 && kept.len() < MOST, "{}", kept.len());
        let steps: Vec<i32> = kept.windows(2).map(|pair| pair[1].1 - pair[0].1).collect();
        assert!(steps.iter().all(|step| *step == steps[0]), "{steps:?}");
        assert!(kept[kept.len() - 1].1 > 9_900);
    }
}
