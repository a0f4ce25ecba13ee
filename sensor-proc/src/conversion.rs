//! From the counts of all sensors to positions of the pistons.
//!
//! ```text
//! at the cylinder    y = r_l n                      R_i = R(q(y)) of the linkage
//! rotary encoder     R_i = R(q_0 + r n)
//! inclinometer       R_i = B_(i-1)^-1 R(q_0 + r n)
//! bodies             B_0 = 1,  B_i = B_(i-1) R_i;  with an inclinometer B_i = R(q_0 + r n)
//! position           y = l(R_i) - l_0
//! ```
//!
//! n counts, r_l m and r rad per count, q_0 angle at count 0, rad; R(q) rotation by q; R_i rotation of joint i from the
//! body before it, B_i that of the body from level, as they are measured: for boom, arm and bucket in turn; l length of
//! the cylinder, m, l_0 that at position 0, y position, m ([`mechanism::Joint`]).
//!
//! So the angle of a joint under an inclinometer is the difference of two neighbouring inclinometers where the body
//! before has one too, and otherwise the difference of the inclinometer and of what the sensors before it say about the
//! body before. Two neighbouring inclinometers have the same lag in most machines, so their difference is late by the
//! motion of their own joint only.
//!
//! Rotations are carried as cosine and sine: an angle beyond 180 degrees needs no care. The sine comes from the
//! computer's library, whose last bits are not the same on every computer.
//!
//! Traps: an inclinometer takes a tilt of the machine for a motion of the boom. A position that is computed from the
//! sensors of other axes is as unusable as theirs ([`Conversion::needs`]).

use mechanism::{Joint, Linkage, Mechanism, Rotation};
use pipeline::{
    MAX_AXES,
    machine::{AngleKind, AngleSensor, Encoder, Machine},
    message::EncoderValue,
};

/// The conversion of all axes of a machine.
#[derive(Debug, Clone)]
pub struct Conversion {
    encoders: Vec<Encoder>,
    /// The linkage, where a sensor is at one of its joints.
    linkage: Option<Box<(Linkage, Mechanism)>>,
    /// Axes whose sensors the position of each axis is computed from, besides its own: bit i is axis i.
    needs: Vec<u32>,
}

impl Conversion {
    /// The conversion of all axes of `machine`.
    pub fn new(machine: &Machine) -> Self {
        let encoders: Vec<Encoder> = machine.axes.iter().map(|axis| axis.encoder).collect();
        let has_angle = encoders.iter().any(|encoder| encoder.angle.is_some());
        let linkage = machine.mechanism.filter(|_| has_angle);
        let needs = encoders.iter().map(|encoder| match encoder.angle {
            Some(AngleSensor { joint, kind: AngleKind::Inclinometer, .. }) => body_before(&encoders, joint),
            _ => 0,
        });
        Self {
            needs: needs.collect(),
            linkage: linkage.map(|mechanism| Box::new((Linkage::new(&mechanism.geometry), mechanism))),
            encoders,
        }
    }

    /// Axes whose sensors the position of `axis` is computed from, besides its own: bit i is axis i. Their numbers are
    /// lower than `axis`.
    pub fn needs(&self, axis: usize) -> u32 {
        self.needs[axis]
    }

    /// Positions of all axes, m, at these counts. That of a sensor at a joint is not finite where the linkage does not
    /// close.
    pub fn positions(&self, values: &[EncoderValue; MAX_AXES]) -> [f64; MAX_AXES] {
        let mut positions = [f64::NAN; MAX_AXES];
        for ((position, encoder), value) in positions.iter_mut().zip(&self.encoders).zip(values) {
            if encoder.angle.is_none() {
                *position = value.counts as f64 * encoder.resolution;
            }
        }
        let Some(linkage) = &self.linkage else { return positions };
        let (linkage, Mechanism { geometry, retracted, .. }) = &**linkage;
        let mut before = Rotation::NONE;
        for joint in Joint::ALL {
            let axis = joint.axis();
            let Some(sensor) = self.encoders.get(axis).and_then(|encoder| encoder.angle) else {
                before = before * linkage.rotation(joint, retracted[axis] + positions[axis]);
                continue;
            };
            let measured = Rotation::by(sensor.zero + values[axis].counts as f64 * sensor.resolution);
            let (rotation, body) = match sensor.kind {
                AngleKind::RotaryEncoder => (measured, before * measured),
                AngleKind::Inclinometer => (before.inverse() * measured, measured),
            };
            positions[axis] = geometry.length_of(joint, rotation) - retracted[axis];
            before = body;
        }
        positions
    }
}

/// Axes whose sensors say where the body before `joint` is: bit i is axis i.
fn body_before(encoders: &[Encoder], joint: Joint) -> u32 {
    let Some(before) = joint.before() else { return 0 };
    let own = 1 << before.axis();
    match encoders.get(before.axis()).and_then(|encoder| encoder.angle) {
        Some(AngleSensor { kind: AngleKind::Inclinometer, .. }) => own,
        _ => own | body_before(encoders, before),
    }
}

#[cfg(test)]
mod tests;
