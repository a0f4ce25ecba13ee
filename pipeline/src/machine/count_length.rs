//! Length of one count of a sensor at a joint.
//!
//! ```text
//! d(y) = (r + r_before) / |J(y)|
//! r_before = 0 for a rotary encoder; for an inclinometer that of the body before (0 for the boom)
//! r_body   = r for an inclinometer;  r + r_body before for a rotary encoder;
//!            max |J| d_l + r_body before for a sensor at the cylinder
//! ```
//!
//! d length of a count, m, at position y, m; r angle of a count, rad; J = dq/dl rate of the joint per rate of its
//! cylinder, rad/m; r_body angle, rad, by which the direction of a body changes when every sensor that it is computed
//! from changes by one count; d_l length of a count at the cylinder, m. d is so the greatest step of the position that
//! the counts can make together.
//!
//! Trap: J varies by a factor of about two over the stroke of an excavator's cylinder. Margins take the greatest d of
//! the stroke, so that they hold everywhere.

use mechanism::{AXES, Joint, Linkage, Mechanism};

use super::{AngleKind, Axis, Encoder, Machine};

/// Number of parts of a stroke at whose ends the length of a count is looked at.
const PARTS: usize = 100;

impl Machine {
    /// Greatest step of the position of the axis with the number `axis`, m, when every sensor that the position is
    /// computed from changes by one count; at `position`, m.
    pub fn count_length(&self, axis: usize, position: f64) -> f64 {
        let encoder = &self.axes[axis].encoder;
        match (&self.mechanism, encoder.angle) {
            (Some(mechanism), Some(_)) => Counts::new(mechanism, &self.axes).length(axis, position),
            _ => encoder.resolution,
        }
    }
}

/// Puts the greatest length of a count into every sensor at a joint.
pub(super) fn complete(mechanism: &Mechanism, axes: &mut [Axis]) {
    for axis in 0..axes.len().min(AXES) {
        if axes[axis].encoder.angle.is_some() {
            let counts = Counts::new(mechanism, axes);
            let greatest = positions(axes[axis].stroke).map(|position| counts.length(axis, position));
            axes[axis].encoder.resolution = greatest.fold(0.0, f64::max);
        }
    }
}

/// Positions over a stroke, m.
fn positions(stroke: f64) -> impl Iterator<Item = f64> {
    (0..=PARTS).map(move |i| stroke * i as f64 / PARTS as f64)
}

/// The counts of all axes of a mechanism.
struct Counts<'a> {
    linkage: Linkage,
    retracted: [f64; AXES],
    axes: &'a [Axis],
}

impl<'a> Counts<'a> {
    fn new(mechanism: &Mechanism, axes: &'a [Axis]) -> Self {
        Self { linkage: Linkage::new(&mechanism.geometry), retracted: mechanism.retracted, axes }
    }

    /// |J| at `position`, rad/m.
    fn rate(&self, axis: usize, position: f64) -> f64 {
        // Every joint depends on its own cylinder only, so the other lengths do not matter.
        self.linkage.pose(&[self.retracted[axis] + position; AXES]).rate[axis].abs()
    }

    /// r_body, rad.
    fn body(&self, joint: Joint) -> f64 {
        let axis = joint.axis();
        let before = joint.before().map_or(0.0, |before| self.body(before));
        match self.axes[axis].encoder {
            Encoder { angle: Some(sensor), .. } if sensor.kind == AngleKind::Inclinometer => sensor.resolution,
            Encoder { angle: Some(sensor), .. } => sensor.resolution + before,
            Encoder { angle: None, resolution, .. } => {
                let rates = positions(self.axes[axis].stroke).map(|position| self.rate(axis, position));
                resolution * rates.fold(0.0, f64::max) + before
            }
        }
    }

    /// d, m; that of a sensor at the cylinder is its count.
    fn length(&self, axis: usize, position: f64) -> f64 {
        let Encoder { angle: Some(sensor), .. } = self.axes[axis].encoder else {
            return self.axes[axis].encoder.resolution;
        };
        let before = match (sensor.kind, sensor.joint.before()) {
            (AngleKind::Inclinometer, Some(before)) => self.body(before),
            _ => 0.0,
        };
        (sensor.resolution + before) / self.rate(axis, position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn built_in(settings: &[(&str, &str)]) -> Machine {
        let settings: Vec<_> = settings.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
        Machine::load(None, &settings).unwrap()
    }

    #[test]
    fn a_count_at_the_joint_is_the_moment_arm_long() {
        let machine = built_in(&[
            ("axis.boom.encoder.kind", "rotary-encoder"),
            ("axis.boom.encoder.angle_resolution", "2e-4"),
            ("axis.bucket.encoder.kind", "rotary-encoder"),
            ("axis.bucket.encoder.angle_resolution", "1e-3"),
        ]);
        let prepared = machine.mechanism.unwrap().prepared();
        for part in [0.0, 0.3, 0.5, 1.0] {
            let positions: [f64; AXES] = std::array::from_fn(|i| part * machine.axes[i].stroke);
            let rate = prepared.pose(&positions).rate;
            for (axis, count) in [(0, 2e-4), (3, 1e-3)] {
                let expected = count / rate[axis].abs();
                let found = machine.count_length(axis, positions[axis]);
                assert!((found - expected).abs() < 1e-12, "{axis} {part}: {found} {expected}");
                assert!(found <= machine.axes[axis].encoder.resolution * (1.0 + 1e-4));
            }
            assert_eq!(machine.count_length(1, positions[1]), machine.axes[1].encoder.resolution);
        }
    }

    #[test]
    fn an_inclinometer_adds_the_counts_that_say_where_the_body_before_is() {
        let of_arm = |boom: &[(&str, &str)]| {
            let arm = [("axis.arm.encoder.kind", "inclinometer"), ("axis.arm.encoder.angle_resolution", "1e-4")];
            let machine = built_in(&[boom, &arm].concat());
            machine.count_length(1, 0.5) * Counts::new(&machine.mechanism.unwrap(), &machine.axes).rate(1, 0.5)
        };
        let angle = [("axis.boom.encoder.kind", "inclinometer"), ("axis.boom.encoder.angle_resolution", "3e-4")];
        assert!((of_arm(&angle) - 4e-4).abs() < 1e-12);
        // The boom's sensor has counts of 0.1 mm; its shortest moment arm is 0.395 m.
        assert!((of_arm(&[]) - 1e-4 - 1e-4 / 0.395).abs() < 1e-6, "{}", of_arm(&[]));
    }
}
