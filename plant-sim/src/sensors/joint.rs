//! A sensor at a joint: rotary encoder or inclinometer.
//!
//! ```text
//! counts = round((wrap(q - q_0 + e) + w)/r)
//! rotary encoder   q = angle of the joint
//! inclinometer     q = angle(s),  tau ds/dt + s = x,  tau = 1/(2 pi f)
//! per step         s' = s + ((x + x')/2 - s) h/(tau + h/2)
//! ```
//!
//! q angle, rad; q_0 angle at count 0, e zero error, w noise, r angle of a count, all rad; x direction of the body's x
//! axis (cosine and sine of its angle from level), s what the filter of the inclinometer makes of it, f bandwidth, Hz;
//! tau time constant and h step of the integration, s; x' and s' at the end of the step; wrap to (-pi, pi]. The rule of
//! the step is the trapezoidal rule.
//!
//! Source of the inclinometer: sensors of this kind measure the components of gravity along their axes, filter them,
//! and compute the angle from them. The lag is of first order (assumed). While a body turns at w rad/s the angle of the
//! filtered components is late by atan(w tau), for a slow turn that of a lag of the angle itself.
//!
//! Traps: accelerations of the body act on a real inclinometer as well, which is left out here: the sensor is one that
//! compensates them by a gyroscope. Angle and counts do not enter the integration, so they may use the arc tangent,
//! whose last bits depend on the computer's library.

use std::f64::consts::TAU;

use mechanism::{Pose, Rotation, Vector};
use pipeline::machine::{AngleKind, AngleSensor, SensorErrors};

use super::encoder::NoisyEncoder;

/// One sensor at a joint with its errors.
#[derive(Debug, Clone)]
pub struct NoisyAngleSensor {
    sensor: AngleSensor,
    encoder: NoisyEncoder,
    /// Rotation by e - q_0.
    shift: Rotation,
    /// The lag of an inclinometer that has one.
    lag: Option<Lag>,
}

/// First-order lag of a direction.
#[derive(Debug, Clone)]
struct Lag {
    /// tau, s.
    time_constant: f64,
    /// x at the end of the last step.
    input: Vector,
    /// s.
    output: Vector,
}

impl NoisyAngleSensor {
    /// The sensor on the machine at rest in `pose`; `encoder` makes counts of the angle.
    pub fn new(sensor: AngleSensor, errors: &SensorErrors, encoder: NoisyEncoder, pose: &Pose) -> Self {
        let input = pose.body(sensor.joint).axis();
        let lag = errors.bandwidth.filter(|_| sensor.kind == AngleKind::Inclinometer);
        Self {
            sensor,
            encoder,
            shift: Rotation::by(errors.angle_error - sensor.zero),
            lag: lag.map(|bandwidth| Lag { time_constant: 1.0 / (TAU * bandwidth), input, output: input }),
        }
    }

    /// Whether what the sensor reads depends on the past.
    pub fn has_lag(&self) -> bool {
        self.lag.is_some()
    }

    /// Takes the lag through a step of `step` s that has ended in `pose`.
    pub fn follow(&mut self, pose: &Pose, step: f64) {
        let Some(lag) = &mut self.lag else { return };
        let input = pose.body(self.sensor.joint).axis();
        let part = step / (lag.time_constant + 0.5 * step);
        lag.output = lag.output + part * (0.5 * (lag.input + input) - lag.output);
        lag.input = input;
    }

    /// Direction that the sensor sees in `pose`, as cosine and sine; their length is not 1 during a lag.
    pub fn seen(&self, pose: &Pose) -> Vector {
        match (&self.lag, self.sensor.kind) {
            (Some(lag), _) => lag.output,
            (None, AngleKind::Inclinometer) => pose.body(self.sensor.joint).axis(),
            (None, AngleKind::RotaryEncoder) => pose.joint(self.sensor.joint).axis(),
        }
    }

    /// Counts while the sensor sees the direction `seen`, with newly drawn noise.
    pub fn read(&mut self, seen: Vector) -> i64 {
        let turned = self.shift * seen;
        self.encoder.read(turned.z.atan2(turned.x))
    }
}
