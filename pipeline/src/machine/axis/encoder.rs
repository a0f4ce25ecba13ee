//! The position sensor: `[axis.NAME.encoder]`.
//!
//! ```text
//! at the cylinder    y = r_l n                                position of the piston
//! rotary encoder     q = q_0 + r n                            angle of the joint
//! inclinometer       q_1 + .. + q_i = q_0 + r n               angle of the body from level
//! ```
//!
//! n counts; y m; r_l length of a count, m; q rad, counter-clockwise, as the crate `mechanism` counts the joints: the
//! boom from level, arm and bucket from the body before; r angle of a count, rad; q_0 angle at count 0, rad. The
//! acquisition leads from q to y through the mechanism. Trap: an inclinometer on arm or bucket says nothing about its
//! own joint alone. The angle of the body before must be known, and its error is an error of this axis as well.

use std::time::Duration;

use mechanism::{Joint, Pose, Rotation};

use crate::machine::document::Section;

/// The position sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encoder {
    /// What a sensor at the joint measures; `None` of a sensor at the cylinder.
    pub angle: Option<AngleSensor>,
    /// Length of one count, m. That of a sensor at the joint is the greatest one over the stroke
    /// ([`Machine::count_length`](crate::machine::Machine::count_length)).
    pub resolution: f64,
    /// How far outside the stroke a position is still plausible, m.
    pub tolerance: f64,
    /// An encoder is stuck when its raw value has not changed for this long while the axis is commanded to move.
    pub stuck_after: Duration,
}

/// A sensor at the joint that the axis turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AngleSensor {
    /// The joint.
    pub joint: Joint,
    /// Which angle it measures.
    pub kind: AngleKind,
    /// Angle of one count, rad.
    pub resolution: f64,
    /// Angle at count 0, rad.
    pub zero: f64,
}

impl AngleSensor {
    /// The rotation whose angle it measures.
    pub fn rotation(&self, pose: &Pose) -> Rotation {
        match self.kind {
            AngleKind::RotaryEncoder => pose.joint(self.joint),
            AngleKind::Inclinometer => pose.body(self.joint),
        }
    }
}

/// Which angle a sensor at the joint measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AngleKind {
    /// That of the joint: from the body before; that of the boom from level.
    RotaryEncoder,
    /// That of the body from level, against gravity.
    Inclinometer,
}

/// Why a key belongs to the other kind of sensor.
const LINEAR: &str = "no such key here: the sensor is at the joint and has angle_resolution, in rad";
const ANGULAR: &str = "no such key here: the sensor is at the cylinder and has resolution, in m";

impl Encoder {
    /// `carried` is the number of the axis in the mechanism, if the mechanism moves it.
    pub(super) fn read(mut section: Section, carried: Option<usize>) -> Self {
        let kinds = [
            ("cylinder", None),
            ("rotary-encoder", Some(AngleKind::RotaryEncoder)),
            ("inclinometer", Some(AngleKind::Inclinometer)),
        ];
        let meaning = "What measures the position: a sensor at the cylinder, a rotary encoder at the joint of a \
                       [mechanism], or an inclinometer on the body that the axis turns";
        let kind = section.key("kind", meaning).choice_or(None, &kinds);
        let is_overridden = section.is_set("kind");
        let joint = carried.and_then(Joint::of_axis);
        if kind.is_some() && joint.is_none() {
            let name = kinds.iter().find(|(_, named)| *named == kind).map_or("", |(name, _)| *name);
            let reason = match carried {
                Some(_) => "the telescope of a mechanism slides and has no joint",
                None => "only boom, arm and bucket of a [mechanism] have joints",
            };
            section.refuse("kind", format!("\"{name}\""), format!("\"cylinder\": {reason}"));
        }
        let (angle, resolution) = match kind {
            None => {
                section.exclude(&["angle_resolution", "angle_zero"], is_overridden, ANGULAR);
                (None, section.key("resolution", "Length of one encoder count").number(1e-9..=0.1, "m"))
            }
            Some(kind) => {
                section.exclude(&["resolution"], is_overridden, LINEAR);
                let meaning = "Angle of one count of a sensor at the joint, in the place of resolution";
                let resolution = section.key("angle_resolution", meaning).number(1e-7..=0.1, "rad");
                let meaning = "Angle at count 0 of a sensor at the joint, counter-clockwise";
                let zero = section.key("angle_zero", meaning).number_or(0.0, -6.3..=6.3, "rad");
                // Without a joint the machine is refused, whatever stands in its place. The length of a count follows
                // when all axes are known.
                let joint = joint.unwrap_or(Joint::Boom);
                (Some(AngleSensor { joint, kind, resolution, zero }), f64::NAN)
            }
        };
        let encoder =
            Self {
                angle,
                resolution,
                tolerance: section
                    .key("tolerance", "How far outside the stroke a position is still plausible")
                    .number_or(5e-3, 0.0..=1.0, "m"),
                stuck_after: section
                    .key(
                        "stuck_after",
                        "The encoder is stuck when it does not change for this long while the axis should move",
                    )
                    .duration_or(Duration::from_millis(300), Duration::from_millis(1)..=Duration::from_secs(60)),
            };
        section.finish();
        encoder
    }
}

#[cfg(test)]
mod tests {
    use crate::machine::{BUILT_IN, Machine, MachineError};
    use std::path::Path;

    fn built_in(settings: &[(&str, &str)]) -> Result<Machine, MachineError> {
        let settings: Vec<_> = settings.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
        Machine::load(None, &settings)
    }

    /// What is said about these settings of the built-in machine, which must be refused.
    fn refusal(settings: &[(&str, &str)]) -> String {
        built_in(settings).expect_err("the machine is to be refused").to_string()
    }

    #[test]
    fn only_axes_with_a_joint_have_a_sensor_there() {
        for kind in ["rotary-encoder", "inclinometer"] {
            let angle = |axis: &str| [(format!("axis.{axis}.encoder.kind"), kind.to_owned())];
            let said = refusal(&[("axis.telescope.encoder.kind", kind)]);
            let expected = format!("axis.telescope.encoder.kind: found \"{kind}\" (from the command line); allowed: ");
            assert!(said.contains(&(expected + "\"cylinder\": the telescope")), "{said}");
            let said = Machine::four_axes(&angle("boom")).unwrap_err().to_string();
            assert!(said.contains("allowed: \"cylinder\": only boom, arm and bucket of a [mechanism]"), "{said}");
        }
        let said = refusal(&[("axis.boom.encoder.kind", "potentiometer")]);
        assert!(said.contains("allowed: \"cylinder\" or \"rotary-encoder\" or \"inclinometer\""), "{said}");
    }

    #[test]
    fn an_angle_of_a_count_is_a_number_above_zero() {
        for wrong in ["0", "-1e-4", "nan", "inf", "1"] {
            let said = refusal(&[
                ("axis.arm.encoder.kind", "inclinometer"),
                ("axis.arm.encoder.angle_resolution", wrong),
                ("axis.arm.plant.angle_bandwidth", wrong.trim_start_matches('1')),
            ]);
            let expected = format!("axis.arm.encoder.angle_resolution: found {wrong}");
            assert!(said.contains(&expected) && said.contains("allowed: a number from 0.0000001 to 0.1 rad"), "{said}");
            assert!(said.contains("axis.arm.plant.angle_bandwidth: found"), "{said}");
        }
        let said = refusal(&[("axis.arm.encoder.kind", "inclinometer")]);
        assert!(said.contains("axis.arm.encoder.angle_resolution: found nothing"), "{said}");
    }

    #[test]
    fn keys_of_the_other_kind_are_refused() {
        let rotary = [("axis.arm.encoder.kind", "rotary-encoder"), ("axis.arm.encoder.angle_resolution", "1e-4")];
        for (key, value, at_joint, allowed) in [
            ("axis.arm.encoder.angle_zero", "0.1", false, "the sensor is at the cylinder and has resolution, in m"),
            ("axis.arm.plant.angle_noise", "1e-4", false, "the sensor is at the cylinder and has encoder_noise, in m"),
            ("axis.arm.plant.angle_error", "1e-4", false, "the sensor is at the cylinder and has encoder_noise, in m"),
            ("axis.arm.plant.angle_bandwidth", "5", false, "only an inclinometer has a bandwidth"),
            ("axis.arm.plant.angle_bandwidth", "5", true, "only an inclinometer has a bandwidth"),
            (
                "axis.arm.encoder.resolution",
                "1e-4",
                true,
                "the sensor is at the joint and has angle_resolution, in rad",
            ),
            ("axis.arm.plant.encoder_noise", "1e-5", true, "the sensor is at the joint and has angle_noise, in rad"),
            ("axis.arm.plant.pressure_noise", "1e4", true, "without [axis.NAME.pressure] no pressure is measured"),
        ] {
            let settings = if at_joint { [&rotary[..], &[(key, value)]].concat() } else { vec![(key, value)] };
            let said = refusal(&settings);
            let found = format!("{key}: found {value} (from the command line)");
            assert!(said.contains(&format!("{found}; allowed: no such key here: {allowed}")), "{said}");
        }
        // A kind from the command line passes over the keys that the file has for its own kind.
        assert!(built_in(&rotary).is_ok());
        // In a file they are refused.
        let text = BUILT_IN.replacen("resolution = 1e-4", "kind = \"rotary-encoder\"\nresolution = 1e-4", 1);
        let said = Machine::parse(&text, "m.toml", Path::new("."), &[]).unwrap_err().to_string();
        assert!(said.contains("axis.boom.encoder.resolution: found 1e-4; allowed: no such key here"), "{said}");
        assert!(said.contains("axis.boom.plant.encoder_noise: found 3e-5; allowed: no such key here"), "{said}");
    }
}
