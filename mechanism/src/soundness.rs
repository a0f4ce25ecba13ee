//! Whether the pins let every cylinder move over its whole stroke.
//!
//! ```text
//! m(l) = dl/dq,  l_0 - e <= l <= l_0 + s + e       m finite, of one sign, and min |m| >= 0.05 max |m|
//! ```
//!
//! m moment arm of a cylinder in m, l its length in m, l_0 its length at position 0, s its stroke, e the way into an
//! end stop. At a dead centre three pins are in line: m is zero or infinite there. Beyond it the linkage does not
//! close, or the joint turns back while the cylinder moves on.
//!
//! Trap: m is looked at on a grid of lengths. A dead centre between two neighbours of the grid is found by its small
//! moment arm.

use crate::{AXES, Linkage, Mechanism};

/// How far an end stop of usual stiffness lets a piston move past the end of the stroke, m: 2 MN on a stop of 1e8 N/m.
pub const END_STOP_WAY: f64 = 0.02;

/// Number of cylinder lengths between which the stroke is divided.
const LENGTHS: usize = 400;

/// Least moment arm in parts of the largest one of the same cylinder. Machines have 0.4 to 0.5; at 0.05 a cylinder
/// feels 400 times the mass.
const LEAST_MOMENT_ARM: f64 = 0.05;

/// Why a cylinder cannot move over its whole stroke.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Flaw {
    /// The linkage closes nowhere.
    #[error("pins that close at no length from {from:.3} to {to:.3} m of the cylinder")]
    Apart {
        /// Shortest length of the cylinder, m.
        from: f64,
        /// Greatest length of the cylinder, m.
        to: f64,
    },
    /// The linkage closes on a part of the stroke only, or the joint turns back.
    #[error("a dead centre at position {position:.3} m, length {length:.3} m of the cylinder")]
    DeadCentre {
        /// Position of the piston, m.
        position: f64,
        /// Length of the cylinder, m.
        length: f64,
    },
    /// The moment arm is near zero.
    #[error("a moment arm of {least:.3} m at position {position:.3} m, where the largest is {greatest:.3} m")]
    MomentArm {
        /// Position of the piston, m.
        position: f64,
        /// Smallest moment arm, m.
        least: f64,
        /// Largest moment arm, m.
        greatest: f64,
    },
}

impl Mechanism {
    /// What keeps cylinders from moving over their strokes `strokes`, m, and by `ways`, m, into their end stops: the
    /// number of the axis, and why. [`END_STOP_WAY`] is the usual way.
    pub fn flaws(&self, strokes: &[f64; AXES], ways: &[f64; AXES]) -> Vec<(usize, Flaw)> {
        let linkage = Linkage::new(&self.geometry);
        let of_axis = |(axis, turns): (usize, f64)| {
            let (retracted, way) = (self.retracted[axis], ways[axis]);
            let lengths = (retracted - way, retracted + strokes[axis] + way);
            Some((axis, self.flaw(&linkage, axis, turns, lengths)?))
        };
        TURNS.into_iter().filter_map(of_axis).collect()
    }

    /// `turns` is the sign of dq/dl.
    fn flaw(&self, linkage: &Linkage, axis: usize, turns: f64, (from, to): (f64, f64)) -> Option<Flaw> {
        let retracted = self.retracted[axis];
        let moment_arm = |length: f64| turns / linkage.pose(&[length; AXES]).rate[axis];
        // Written so that NaN does not move.
        let moves = |length: f64| moment_arm(length) > 0.0 && moment_arm(length).is_finite();
        let lengths = (0..=LENGTHS).map(|i| from + (to - from) * i as f64 / LENGTHS as f64);
        let (mut least, mut greatest, mut at) = (f64::INFINITY, 0.0f64, from);
        let (mut good, mut bad) = (None, None);
        for length in lengths {
            if !moves(length) {
                bad = Some(length);
            } else {
                good = Some(length);
                greatest = greatest.max(moment_arm(length));
                if moment_arm(length) < least {
                    (least, at) = (moment_arm(length), length);
                }
            }
            if let (Some(mut good), Some(mut bad)) = (good, bad) {
                // As many halvings as a number has digits.
                for _ in 0..f64::MANTISSA_DIGITS {
                    let middle = 0.5 * (good + bad);
                    *(if moves(middle) { &mut good } else { &mut bad }) = middle;
                }
                return Some(Flaw::DeadCentre { position: good - retracted, length: good });
            }
        }
        if good.is_none() {
            return Some(Flaw::Apart { from, to });
        }
        let is_small = least < LEAST_MOMENT_ARM * greatest;
        is_small.then_some(Flaw::MomentArm { position: at - retracted, least, greatest })
    }
}

/// The axes that turn a joint, with the sign of dq/dl.
const TURNS: [(usize, f64); 3] = [(0, 1.0), (1, -1.0), (3, -1.0)];
