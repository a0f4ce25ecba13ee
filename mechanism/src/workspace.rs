//! Where the teeth reach, and postures that are spread evenly over the workspace.
//!
//! ```text
//! reach = max x_tip       depth = max -z_tip       height = max z_tip
//! l_i = low_i + (high_i - low_i) (k_i + 1/2) / n,   k_i = 0 .. n - 1
//! ```
//!
//! The extremes are found on a grid of the three cylinders that turn, which is then made finer about the best point.
//! Trap: an extreme mostly lies at the end of a stroke, so the grid of the extremes has the ends in it. The postures
//! have not: at the ends moment arms are small, and masses there would weigh too much.

use crate::{AXES, PreparedMechanism, Vector};

/// Lengths of each cylinder on the grid of the extremes.
const LENGTHS: usize = 9;

/// How often the grid is made finer, each time to the two cells about the best point.
const REFINEMENTS: usize = 20;

/// The farthest places of the teeth, m: forward of the centre of swing, below and above ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// Farthest forward.
    pub reach: f64,
    /// Farthest below ground.
    pub depth: f64,
    /// Farthest above ground.
    pub height: f64,
}

impl PreparedMechanism {
    /// The farthest places of the teeth with positions of the pistons between `low` and `high`, m, for the telescope at
    /// `telescope`, m.
    pub fn extent(&self, low: &[f64; AXES], high: &[f64; AXES], telescope: f64) -> Extent {
        let (mut low, mut high) = (*low, *high);
        (low[2], high[2]) = (telescope, telescope);
        let farthest = |of: fn(Vector) -> f64| self.farthest(low, high, of);
        Extent { reach: farthest(|tip| tip.x), depth: farthest(|tip| -tip.z), height: farthest(|tip| tip.z) }
    }

    fn farthest(&self, low: [f64; AXES], high: [f64; AXES], of: fn(Vector) -> f64) -> f64 {
        let (mut from, mut to) = (low, high);
        let mut best = (f64::NEG_INFINITY, low);
        for _ in 0..REFINEMENTS {
            let at = |i: usize, k: usize| from[i] + (to[i] - from[i]) * k as f64 / (LENGTHS - 1) as f64;
            for k in 0..LENGTHS.pow(3) {
                let (boom, arm, bucket) = (k % LENGTHS, k / LENGTHS % LENGTHS, k / LENGTHS / LENGTHS);
                let positions = [at(0, boom), at(1, arm), low[2], at(3, bucket)];
                let value = of(self.pose(&positions).tip);
                if value > best.0 {
                    best = (value, positions);
                }
            }
            for i in 0..AXES {
                let cell = (to[i] - from[i]) / (LENGTHS - 1) as f64;
                (from[i], to[i]) = ((best.1[i] - cell).max(low[i]), (best.1[i] + cell).min(high[i]));
            }
        }
        best.0
    }
}

/// Positions of the pistons, m, in the middles of `n` equal parts of the range from `low` to `high` for each cylinder:
/// `n` to the power of four postures.
pub fn postures(low: [f64; AXES], high: [f64; AXES], n: usize) -> impl Iterator<Item = [f64; AXES]> {
    let at = move |i: usize, k: usize| low[i] + (high[i] - low[i]) * ((k % n) as f64 + 0.5) / n as f64;
    (0..n.pow(AXES as u32)).map(move |k| [at(0, k), at(1, k / n), at(2, k / n.pow(2)), at(3, k / n.pow(3))])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn postures_are_in_the_middles_of_equal_parts() {
        let all: Vec<_> = postures([0.0, 1.0, 0.0, 0.0], [1.0, 3.0, 0.0, 4.0], 2).collect();
        assert_eq!((all.len(), all[0], all[15]), (16, [0.25, 1.5, 0.0, 1.0], [0.75, 2.5, 0.0, 3.0]));
    }
}
