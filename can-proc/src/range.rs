//! Whether a position has numbers for all places of its axis.
//!
//! ```text
//! cylinder           number = zero +- limit / resolution
//! sensor at a joint  number = zero +- d / angle_resolution      d = angle - angle_zero
//! ```
//!
//! The angles are all those between the least and the greatest one that the machine has with its cylinders within their
//! soft limits. A slope has d from -180 to 180 degrees: where d goes beyond, it jumps from one end to the other, and
//! needs numbers for both. Any other sensor may begin its turn anywhere.
//!
//! Trap: a direction that passes through 180 degrees has angles between those of its extreme postures that are greater
//! than both. So angles are followed from posture to posture before their extremes are taken.

use std::f64::consts::{PI, TAU};

use can::frames::Signal;
use mechanism::AXES;
use pipeline::machine::{AngleSensor, Machine};

/// Places of each cylinder that are looked at.
const PLACES: usize = 7;
/// Angles between the least and the greatest one that are looked at.
const ANGLES: usize = 1000;

/// The number of a position: where it is on the bus, whether it grows while the axis retracts, and that of count 0.
pub struct Counted<'s> {
    /// Its bits.
    pub signal: &'s Signal,
    /// Whether it grows while the axis retracts.
    pub is_reversed: bool,
    /// The number of count 0.
    pub zero: i64,
    /// Whether it is the slope of an inclinometer.
    pub is_slope: bool,
}

impl Counted<'_> {
    fn number(&self, count: f64) -> f64 {
        let sign = if self.is_reversed { -1.0 } else { 1.0 };
        self.zero as f64 + sign * count.round()
    }

    /// A number that the position of an axis would need and cannot have, and the place where it would: a soft limit of
    /// the axis; of a sensor at a joint an angle, with all cylinders that move the joint within theirs.
    pub fn lacking(&self, machine: &Machine, axis: usize) -> Option<(f64, String)> {
        let encoder = &machine.axes[axis].encoder;
        let Some(sensor) = encoder.angle else {
            let limits = <[f64; 2]>::from(machine.axes[axis].soft_limits);
            let numbers = limits.map(|limit| (self.number(limit / encoder.resolution), format!("{limit} m")));
            return numbers.into_iter().find(|(number, _)| !self.signal.has(*number));
        };
        let (least, greatest) = angles(machine, &sensor)?;
        let (least, greatest) = (least - sensor.zero, greatest - sensor.zero);
        let mut between = (0..=ANGLES).map(|i| least + (greatest - least) * i as f64 / ANGLES as f64);
        let number = |d: f64| self.number(d / sensor.resolution);
        let turn = |d: f64| ((d + PI) / TAU).floor();
        let found = if self.is_slope {
            let jumps = turn(least) != turn(greatest);
            let ends = [-PI, PI].into_iter().filter(|_| jumps);
            ends.chain(between.map(|d| d - TAU * turn(d))).find(|d| !self.signal.has(number(*d)))
        } else {
            let has = |d: f64| [0.0, -TAU, TAU].iter().any(|turn| self.signal.has(number(d + turn)));
            between.find(|d| !has(*d))
        };
        found.map(|d| (number(d), format!("{:.3} rad", d + sensor.zero)))
    }
}

/// Least and greatest angle of a sensor at a joint, rad, beyond a turn as well; `None` without a mechanism.
fn angles(machine: &Machine, sensor: &AngleSensor) -> Option<(f64, f64)> {
    let mechanism = machine.mechanism?.prepared();
    let all = PLACES.pow(AXES as u32);
    let mut found: Vec<f64> = Vec::with_capacity(all);
    for posture in 0..all {
        let digit = |axis: usize| posture / PLACES.pow(axis as u32) % PLACES;
        let positions = std::array::from_fn(|axis| {
            let (low, high) = machine.axes[axis].soft_limits;
            low + (high - low) * digit(axis) as f64 / (PLACES - 1) as f64
        });
        let angle = sensor.rotation(&mechanism.pose(&positions)).angle();
        // The posture before differs by a step of one cylinder.
        let before = (0..AXES).find(|axis| digit(*axis) > 0).map(|axis| found[posture - PLACES.pow(axis as u32)]);
        found.push(before.map_or(angle, |before| angle - TAU * ((angle - before) / TAU).round()));
    }
    Some(found.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(*x), high.max(*x))))
}
