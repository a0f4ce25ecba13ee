//! How fast the commands of one direction move the axis, before its model is known.
//!
//! ```text
//! rest(k) = sum of v(u(i)) T over i = k-R .. k          v(u) = g * line through the strokes (l_j, v_j)
//! beyond the last stroke:  v(u) = g v_n ((u - l_0)/(l_n - l_0))^2
//! ```
//!
//! u commands, T period s, R the longest time from neutral to rest seen so far, ticks; l_j levels of the strokes so
//! far, v_j the fastest speeds in them m/s, l_0 a level that was seen to move the axis, g >= 1 raised by whatever moves
//! faster; rest(k) way that is under way, m. What is under way in the pilot lines comes out whatever is commanded now,
//! so all of it counts. Trap: if l_0 is below the dead band, the quadratic rule expects too little speed; l_0 is above
//! it.

/// Strokes that are kept, of either direction.
pub const MOST_STROKES: usize = 12;

/// Factor on the speeds that were seen: loads and oil differ from place to place.
const CAUTION: f64 = 1.1;

/// Least slope of the root of the speed, as a part of its mean slope above [`Direction::moving`]. A straight curve has
/// 0.5 and more, the end of an S less. A stroke that ends early for lack of way looks as if more command made no more
/// speed.
const LEAST_SLOPE: f64 = 0.25;

/// A stroke that was made.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stroke {
    /// Magnitude of its command.
    pub level: f64,
    /// Fastest speed in it, m/s.
    pub speed: f64,
}

/// What has been seen of one direction.
#[derive(Debug, Clone, PartialEq)]
pub struct Direction {
    /// l_0, a level that moved the axis; infinite before one has.
    pub moving: f64,
    strokes: [Stroke; MOST_STROKES],
    count: usize,
    /// g.
    gain: f64,
}

impl Direction {
    /// Nothing seen yet.
    pub const fn new() -> Self {
        let none = Stroke { level: 0.0, speed: 0.0 };
        Self { moving: f64::INFINITY, strokes: [none; MOST_STROKES], count: 0, gain: 1.0 }
    }

    /// The last stroke.
    pub fn last(&self) -> Option<Stroke> {
        self.strokes[..self.count].last().copied()
    }

    /// Whether no more strokes can be kept.
    pub fn is_full(&self) -> bool {
        self.count == MOST_STROKES
    }

    /// Keeps a stroke; levels rise, and speeds do not fall.
    pub fn push(&mut self, level: f64, speed: f64) {
        let before = self.last().unwrap_or_default();
        if !self.is_full() && level > before.level {
            self.strokes[self.count] = Stroke { level, speed: speed.max(before.speed) };
            self.count += 1;
        }
    }

    /// The speed that a command of this magnitude may make, m/s.
    pub fn speed(&self, level: f64) -> f64 {
        let strokes = &self.strokes[..self.count];
        let Some(last) = self.last() else { return 0.0 };
        let speed = if level > last.level {
            last.speed * ((level - self.moving) / (last.level - self.moving)).powi(2)
        } else {
            let above = strokes.partition_point(|stroke| stroke.level < level).min(self.count - 1);
            // Below the first stroke the line begins a little below the level that was seen to move the axis.
            let below = if above == 0 { Stroke { level: 0.5 * self.moving, speed: 0.0 } } else { strokes[above - 1] };
            let above = strokes[above];
            below.speed + (above.speed - below.speed) * ((level - below.level) / (above.level - below.level)).max(0.0)
        };
        CAUTION * self.gain * speed
    }

    /// The level that makes `speed` m/s when the root of the speed goes on to rise as between the last two strokes.
    pub fn level(&self, speed: f64) -> f64 {
        let strokes = &self.strokes[..self.count];
        let Some(last) = self.last() else { return self.moving };
        let before = strokes.iter().rev().find(|stroke| stroke.speed < last.speed);
        let before = before.copied().unwrap_or(Stroke { level: self.moving, speed: 0.0 });
        let slope = (last.speed.sqrt() - before.speed.sqrt()) / (last.level - before.level);
        let least = LEAST_SLOPE * last.speed.sqrt() / (last.level - self.moving);
        last.level + (speed.sqrt() - last.speed.sqrt()) / slope.max(least).max(f64::MIN_POSITIVE)
    }

    /// Takes in a speed (m/s) that commands up to `level` have made.
    pub fn learn(&mut self, level: f64, speed: f64) {
        let expected = self.speed(level);
        if expected > 0.0 && speed > expected && level <= self.last().map_or(0.0, |last| last.level) {
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
    fn a_stroke_that_ended_early_does_not_make_the_next_level_many_times_as_high() {
        let mut direction = Direction::new();
        direction.moving = 0.15;
        direction.push(0.37, 0.10);
        direction.push(0.46, 0.1001);
        let next = direction.level(0.12);
        assert!((0.48..0.6).contains(&next), "{next}");
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
