//! Whether a position has numbers for all places of its axis.

use std::f64::consts::TAU;

use can::frames::Signal;
use mechanism::AXES;
use pipeline::machine::Machine;

/// The number of a position: where it is on the bus, whether it grows while the axis retracts, and that of count 0.
pub struct Counted<'s> {
    /// Its bits.
    pub signal: &'s Signal,
    /// Whether it grows while the axis retracts.
    pub is_reversed: bool,
    /// The number of count 0.
    pub zero: i64,
}

impl Counted<'_> {
    fn number(&self, count: f64) -> f64 {
        let sign = if self.is_reversed { -1.0 } else { 1.0 };
        self.zero as f64 + sign * count.round()
    }

    /// A number that the position of an axis would need and cannot have, and the place where it would: a soft limit of
    /// the axis; of a sensor at a joint its angle, with all cylinders that move the joint at theirs.
    pub fn lacking(&self, machine: &Machine, axis: usize) -> Option<(f64, String)> {
        let encoder = &machine.axes[axis].encoder;
        let Some((sensor, mechanism)) = encoder.angle.zip(machine.mechanism) else {
            let limits = <[f64; 2]>::from(machine.axes[axis].soft_limits);
            let numbers = limits.map(|limit| (self.number(limit / encoder.resolution), format!("{limit} m")));
            return numbers.into_iter().find(|(number, _)| !self.signal.has(*number));
        };
        let mechanism = mechanism.prepared();
        (0..1_u32 << AXES).find_map(|corner| {
            let limits = std::array::from_fn(|axis| {
                let (low, high) = machine.axes[axis].soft_limits;
                if corner >> axis & 1 == 0 { low } else { high }
            });
            let angle = sensor.rotation(&mechanism.pose(&limits)).angle();
            // A sensor may begin its turn anywhere.
            let numbers = [0.0, -TAU, TAU].map(|turn| self.number((angle + turn - sensor.zero) / sensor.resolution));
            let has_none = !numbers.iter().any(|number| self.signal.has(*number));
            has_none.then(|| (numbers[0], format!("{angle:.3} rad")))
        })
    }
}
