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
        self.lag.as_ref().map_or_else(|| self.sensor.rotation(pose).axis(), |lag| lag.output)
    }

    /// Counts while the sensor sees the direction `seen`, with newly drawn noise.
    pub fn read(&mut self, seen: Vector) -> i64 {
        let turned = self.shift * seen;
        self.encoder.read(turned.z.atan2(turned.x))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mechanism::{AXES, Joint};

    const STEP: f64 = 1e-4;

    /// A pose in which only the boom's angle, rad, is of interest.
    fn at(angle: f64) -> Pose {
        let boom = Rotation::by(angle);
        let place = Vector::default();
        Pose {
            boom,
            arm: boom,
            bucket: boom,
            boom_foot: place,
            arm_pin: place,
            bucket_pin: place,
            tip: place,
            telescope: 0.0,
            rate: [1.0; AXES],
            curvature: [0.0; AXES],
        }
    }

    fn inclinometer(bandwidth: Option<f64>, angle: f64) -> NoisyAngleSensor {
        let sensor = AngleSensor { joint: Joint::Boom, kind: AngleKind::Inclinometer, resolution: 1e-6, zero: 0.5 };
        let errors = SensorErrors { encoder_noise: 0.0, angle_error: 0.01, bandwidth, pressure_noise: 0.0 };
        let encoder = NoisyEncoder::new(sensor.resolution, super::super::noise::Noise::new(0.0, 1, 0));
        NoisyAngleSensor::new(sensor, &errors, encoder, &at(angle))
    }

    #[test]
    fn counts_are_the_angle_from_the_zero_with_its_error() {
        for angle in [-3.0, -0.7, 0.0, 1.2, 3.1] {
            let mut sensor = inclinometer(None, 0.0);
            let seen = sensor.seen(&at(angle));
            let expected = Rotation::by(angle + 0.01 - 0.5).angle() * 1e6;
            assert!((sensor.read(seen) as f64 - expected).abs() <= 0.5001, "{angle}");
        }
    }

    #[test]
    fn a_turn_is_seen_late_as_the_closed_form_of_the_lag_says() {
        // With x = exp(i w t) and s(0) = 1: s = exp(i w t)/(1 + i w tau) + (1 - 1/(1 + i w tau)) exp(-t/tau).
        for (bandwidth, speed) in [(10.0, 0.5), (2.0, 1.0), (50.0, -0.8)] {
            let mut sensor = inclinometer(Some(bandwidth), 0.0);
            let tau = 1.0 / (TAU * bandwidth);
            let square = 1.0 + speed * speed * tau * tau;
            let steady = Vector::new(1.0 / square, -speed * tau / square);
            for step in 1..=20_000 {
                let time = f64::from(step) * STEP;
                sensor.follow(&at(speed * time), STEP);
                let expected =
                    Rotation::by(speed * time) * steady + (-time / tau).exp() * (Vector::new(1.0, 0.0) - steady);
                let error = (sensor.seen(&at(0.0)) - expected).norm();
                // The trapezoidal rule: h^2/(12 tau) of the largest second derivative, |w|/tau.
                assert!(error < STEP * STEP * speed.abs() / (12.0 * tau) + 1e-12, "{bandwidth} Hz, {time} s: {error}");
            }
            let seen = sensor.seen(&at(0.0));
            let late = speed * 20_000.0 * STEP - seen.z.atan2(seen.x);
            assert!((late - (speed * tau).atan()).abs() < 1e-6, "{late}");
        }
    }

    #[test]
    fn a_small_turn_decays_as_a_lag_of_the_angle_does() {
        let (mut sensor, tau) = (inclinometer(Some(5.0), 0.3), 1.0 / (TAU * 5.0));
        let turn = 1e-3;
        for step in 1..=2000 {
            sensor.follow(&at(0.3 + turn), STEP);
            let seen = sensor.seen(&at(0.0));
            // The step comes in the middle of the first step of the integration.
            let expected = turn * (1.0 - (-(f64::from(step) - 0.5) * STEP / tau).exp());
            assert!((seen.z.atan2(seen.x) - 0.3 - expected).abs() < 1e-8, "{step}");
        }
    }
}
