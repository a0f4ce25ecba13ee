//! Straight lines through points in time.
//!
//! ```text
//! g(t) = p_i + (p_i+1 - p_i) (t - t_i) / (t_i+1 - t_i)     for t_i <= t < t_i+1
//! ```
//!
//! t time in s, p position in m. Before the first point g is the first position, after the last point the last one.

/// Points (s, m) with straight lines between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    points: Vec<(f64, f64)>,
}

impl Trajectory {
    /// Straight lines through `points` (s, m): at least one, with rising times.
    pub fn through(points: Vec<(f64, f64)>) -> Self {
        Self { points }
    }

    /// g(t), m, for `t` in s.
    pub fn position(&self, t: f64) -> f64 {
        let after = self.points.partition_point(|point| point.0 <= t);
        match (after.checked_sub(1).and_then(|i| self.points.get(i)), self.points.get(after)) {
            (Some(a), Some(b)) => a.1 + (b.1 - a.1) * ((t - a.0) / (b.0 - a.0)),
            (Some(only), None) | (None, Some(only)) => only.1,
            (None, None) => f64::NAN,
        }
    }

    /// Time of the last point, s.
    pub fn end(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.0)
    }
}
