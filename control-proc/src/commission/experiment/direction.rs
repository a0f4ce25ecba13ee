//! How far the axis still goes, before its model is known.
//!
//! ```text
//! rest(k) = sum of v(u(i)) T over i = k-R .. k          v(u) = g * line through the strokes (l_j, v_j)
//! beyond the last stroke:  v(u) = g v_n ((u - l_0)/(l_n - l_0))^2
//! ```
//!
//! u commands, T period s, R the longest time from neutral to rest seen so far, ticks; l_j levels of the strokes so far,
//! v_j the fastest speeds in them m/s, l_0 a level that was seen to move the axis, g >= 1 raised by whatever moves faster.
//! What is under way in the pilot lines comes out whatever is commanded now, so it counts in full. Trap: a dead band
//! taken too small makes the quadratic rule rash; l_0 is above it.

/// Strokes that are kept, of either direction.
pub const MOST_STROKES: usize = 12;

/// More than was seen: loads and oil are not everywhere the same.
const CAUTION: f64 = 1.1;

/// What has been seen of one direction.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// l_0, a level that moved the axis; the command limit or more before one has.
    pub moving: f64,
    strokes: [(f64, f64); MOST_STROKES],
    count: usize,
    gain: f64,
}

impl Direction {
    /// Nothing seen yet.
    pub const fn new() -> Self {
        Self { moving: f64::INFINITY, strokes: [(0.0, 0.0); MOST_STROKES], count: 0, gain: 1.0 }
    }

    /// Level and fastest speed of the last stroke, m/s.
    pub fn last(&self) -> Option<(f64, f64)> {
        self.strokes[..self.count].last().copied()
    }

    /// Whether no more strokes can be kept.
    pub fn is_full(&self) -> bool {
        self.count == MOST_STROKES
    }

    /// Keeps a stroke; levels rise, and speeds do not fall.
    pub fn push(&mut self, level: f64, speed: f64) {
        let before = self.last().unwrap_or((0.0, 0.0));
        if !self.is_full() && level > before.0 {
            self.strokes[self.count] = (level, speed.max(before.1));
            self.count += 1;
        }
    }

    /// The speed that a command of this magnitude may make, m/s.
    pub fn speed(&self, level: f64) -> f64 {
        let strokes = &self.strokes[..self.count];
        let Some((last, fastest)) = self.last() else { return 0.0 };
        let speed = if level > last {
            fastest * ((level - self.moving) / (last - self.moving)).powi(2)
        } else {
            let above = strokes.partition_point(|(stroke, _)| *stroke < level).min(self.count - 1);
            // Below the first stroke: from a little below where it was seen to move.
            let (l_0, v_0) = if above == 0 { (0.5 * self.moving, 0.0) } else { strokes[above - 1] };
            let (l_1, v_1) = strokes[above];
            v_0 + (v_1 - v_0) * ((level - l_0) / (l_1 - l_0)).max(0.0)
        };
        CAUTION * self.gain * speed
    }

    /// A speed was seen that commands up to `level` had made, m/s.
    pub fn learn(&mut self, level: f64, speed: f64) {
        let expected = self.speed(level);
        if expected > 0.0 && speed > expected && level <= self.last().map_or(0.0, |(last, _)| last) {
            self.gain *= speed / expected;
        }
    }
}

impl Default for Direction {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speeds_are_interpolated_between_strokes_and_quadratic_beyond() {
        let mut direction = Direction::new();
        direction.moving = 0.2;
        assert_eq!(direction.speed(0.5), 0.0, "nothing is known");
        direction.push(0.3, 0.05);
        direction.push(0.4, 0.15);
        for (level, speed) in [(0.1, 0.0), (0.3, 0.05), (0.35, 0.1), (0.4, 0.15), (0.6, 0.6)] {
            assert!((direction.speed(level) - CAUTION * speed).abs() < 1e-12, "{level}: {}", direction.speed(level));
        }
    }

    #[test]
    fn what_moves_faster_than_expected_makes_everything_faster() {
        let mut direction = Direction::new();
        direction.moving = 0.2;
        direction.push(0.4, 0.1);
        direction.learn(0.4, 0.22);
        assert!((direction.speed(0.4) - 0.22).abs() < 1e-12);
        direction.learn(0.4, 0.1);
        assert!((direction.speed(0.4) - 0.22).abs() < 1e-12);
    }
}
