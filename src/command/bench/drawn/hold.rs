//! What an axis does while its reference stands.
//!
//! ```text
//! steady    |e| <= max(1 mm, 3 counts) at every tick, at most 6 reversals, neutral for 90 % of the ticks
//! cycling   more than 6 reversals, and (max e - min e)/2 > max(0.5 mm, 1.5 counts)
//! ```
//!
//! e reference minus position m. A reversal is a command in the other direction than the last one that was not neutral.
//! Trap: an axis that creeps and is put back now and then, always the same way, does not cycle.

use pipeline::statistics::HoldStatistics;

/// Largest error of a steady axis, m and counts.
const NEAR: (f64, f64) = (1e-3, 3.0);
/// Half of the travel to and fro that is no limit cycle, m and counts.
const CYCLE: (f64, f64) = (0.5e-3, 1.5);
/// Most reversals.
const MOST_REVERSALS: u64 = 6;
/// Least part of the ticks with a neutral command.
const LEAST_NEUTRAL: f64 = 0.9;

/// What was seen; empty before the first tick.
#[derive(Debug, Clone, Default)]
pub struct Hold {
    /// m per count.
    resolution: f64,
    /// What was seen.
    pub seen: HoldStatistics,
}

impl Hold {
    /// Nothing seen yet, with an encoder of `resolution` m per count.
    pub fn new(resolution: f64) -> Self {
        Self { resolution, ..Self::default() }
    }

    /// Whether there was anything to see.
    pub fn is_watched(&self) -> bool {
        self.seen.ticks > 0
    }

    /// Whether the axis kept to its set point, quietly.
    pub fn is_steady(&self) -> bool {
        self.seen.largest() <= NEAR.0.max(NEAR.1 * self.resolution)
            && self.seen.reversals <= MOST_REVERSALS
            && self.seen.neutral() >= LEAST_NEUTRAL
    }

    /// Whether the axis went to and fro.
    pub fn is_cycling(&self) -> bool {
        self.seen.reversals > MOST_REVERSALS && 0.5 * self.seen.travel() > CYCLE.0.max(CYCLE.1 * self.resolution)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held(errors: impl Iterator<Item = (f64, f64)>) -> Hold {
        let mut hold = Hold::new(1e-4);
        errors.for_each(|(error, command)| hold.seen.push(error, command));
        hold
    }

    #[test]
    fn an_axis_at_rest_near_its_set_point_is_steady() {
        let hold = held((0..1000).map(|_| (0.9e-3, 0.0)));
        assert!(hold.is_steady() && !hold.is_cycling() && hold.seen.neutral() == 1.0);
        assert!(!held((0..1000).map(|_| (-1.1e-3, 0.0))).is_steady());
    }

    #[test]
    fn a_swing_to_and_fro_is_a_cycle_and_a_creep_that_is_put_back_is_none() {
        let swing = |amplitude: f64| {
            held((0..1000).map(move |i| {
                let phase = (0.1 * f64::from(i)).sin();
                (amplitude * phase, phase)
            }))
        };
        assert!(swing(0.8e-3).is_cycling() && !swing(0.8e-3).is_steady());
        assert!(!swing(0.4e-3).is_cycling() && !swing(0.4e-3).is_steady());
        assert_eq!(swing(0.8e-3).seen.reversals, 31);
        let creep = held((0..1000).map(|i| (0.9e-3 * f64::from(i % 100) / 100.0, f64::from(u8::from(i % 100 < 5)))));
        assert!(creep.is_steady() && creep.seen.reversals == 0);
    }
}
