//! The machine as URDF, the robot description of ROS and of libraries for dynamics.
//!
//! URDF knows trees of links only. So the file has the joints that the cylinders move, with the masses and with the
//! ranges that the strokes give them, and leaves out the cylinders and the bucket's rocker and link. Boom, arm and
//! bucket turn about the axis -y, so that x is forward, z is up, and positive angles are counter-clockwise seen from
//! the right; joint values are those of `mechanism::Pose::joints`.
//!
//! ```text
//! effort = A_1 p_r max(1/|J|)          velocity = v_max max(|J|)          over the stroke
//! ```
//!
//! A_1 area of the piston side in m2, p_r relief pressure in Pa, v_max `max_speed` in m/s, J rate of the joint per rate
//! of its cylinder. A library checks both limits in every posture, so they are the largest over the stroke; most
//! postures allow less.
//!
//! Trap: URDF wants a moment of inertia for each of the three axes. Only the one about y is known and has an effect
//! here; the other two are set to the same value, which every body can have.

use std::fmt::Write;

use mechanism::{Body, Mechanism, Vector};
use pipeline::machine::Machine;

use super::{along_strokes, joint_ranges};
use crate::report::page::escaped;

/// Width of the boxes that stand for the bodies in a viewer, m.
const BOX: f64 = 0.3;

/// Pressure for the largest effort of a joint, Pa, where the machine file has none.
const RELIEF_PRESSURE: f64 = 35e6;

/// Piston area for the largest effort of a joint, m2, where the machine file has none.
const PISTON_AREA: f64 = 0.01;

/// The text of the file.
pub fn urdf(machine: &Machine, mechanism: &Mechanism) -> String {
    let (pins, masses) = (&mechanism.geometry, &mechanism.masses);
    let limits = Limits::all(machine, mechanism);
    let along = |length: f64| Vector::new(length, 0.0);
    let mut text = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n", escaped(&machine.name));
    text += "  <link name=\"base\"/>\n";
    text += &link("boom", &masses.boom, (0.0, pins.boom_length));
    text += &link("arm", &masses.arm, (0.0, pins.arm_length));
    text += &link("telescope", &masses.inner, (-0.5 * pins.arm_length, 0.0));
    text += &link("bucket", &masses.bucket, (0.0, pins.bucket_length));
    text += &joint("boom", "base", "revolute", pins.boom_foot, Some(&limits[0]));
    text += &joint("arm", "boom", "revolute", along(pins.boom_length), Some(&limits[1]));
    text += &joint("telescope", "arm", "prismatic", along(pins.arm_length), Some(&limits[2]));
    text += &joint("bucket", "telescope", "revolute", along(0.0), Some(&limits[3]));
    if masses.payload.mass > 0.0 {
        let payload = masses.payload;
        let inertia = payload.mass * payload.radius_of_gyration * payload.radius_of_gyration;
        let body = Body { mass: payload.mass, center: Vector::default(), inertia };
        text += &link("payload", &body, (0.0, 0.0));
        text += &joint("payload", "bucket", "fixed", payload.center, None);
    }
    text += "  <link name=\"tip\"/>\n";
    text += &joint("tip", "bucket", "fixed", along(pins.bucket_length), None);
    text + "</robot>\n"
}

/// What a joint can do.
struct Limits {
    low: f64,
    high: f64,
    /// N m, or N for the telescope.
    effort: f64,
    /// rad/s, or m/s for the telescope.
    velocity: f64,
}

impl Limits {
    fn all(machine: &Machine, mechanism: &Mechanism) -> [Self; mechanism::AXES] {
        let joints = joint_ranges(machine, mechanism);
        std::array::from_fn(|i| {
            let axis = &machine.axes[i];
            let (area, pressure) = axis
                .plant
                .as_ref()
                .map_or((PISTON_AREA, RELIEF_PRESSURE), |plant| (plant.piston_area, plant.relief_pressure));
            let rates = along_strokes(machine, mechanism).map(|pose| pose.rate[i].abs());
            let (slowest, fastest) =
                rates.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), rate| (low.min(rate), high.max(rate)));
            Self {
                low: joints[i][0].min(joints[i][1]),
                high: joints[i][0].max(joints[i][1]),
                effort: area * pressure / slowest,
                velocity: axis.max_speed * fastest,
            }
        })
    }
}

fn link(name: &str, body: &Body, (from, to): (f64, f64)) -> String {
    let Body { mass, center, inertia } = body;
    let mut text = format!("  <link name=\"{name}\">\n    <inertial>\n");
    let _ = writeln!(text, "      <origin xyz=\"{} 0 {}\"/>", center.x, center.z);
    let _ = writeln!(text, "      <mass value=\"{mass}\"/>");
    let _ = writeln!(
        text,
        "      <inertia ixx=\"{inertia}\" ixy=\"0\" ixz=\"0\" iyy=\"{inertia}\" iyz=\"0\" izz=\"{inertia}\"/>"
    );
    text += "    </inertial>\n";
    if to > from {
        let _ = writeln!(text, "    <visual>\n      <origin xyz=\"{} 0 0\"/>", 0.5 * (from + to));
        let _ = writeln!(text, "      <geometry><box size=\"{} {BOX} {BOX}\"/></geometry>", to - from);
        text += "    </visual>\n";
    }
    text + "  </link>\n"
}

fn joint(child: &str, parent: &str, kind: &str, origin: Vector, limits: Option<&Limits>) -> String {
    let name = if kind == "fixed" { format!("{child}_mount") } else { format!("{child}_joint") };
    let mut text = format!("  <joint name=\"{name}\" type=\"{kind}\">\n");
    let _ = writeln!(text, "    <origin xyz=\"{} 0 {}\"/>", origin.x, origin.z);
    let _ = writeln!(text, "    <parent link=\"{parent}\"/>\n    <child link=\"{child}\"/>");
    if let Some(Limits { low, high, effort, velocity }) = limits {
        let axis = if kind == "prismatic" { "1 0 0" } else { "0 -1 0" };
        let _ = writeln!(text, "    <axis xyz=\"{axis}\"/>");
        let _ = writeln!(
            text,
            "    <limit lower=\"{low}\" upper=\"{high}\" effort=\"{effort:.0}\" velocity=\"{velocity:.3}\"/>"
        );
    }
    text + "  </joint>\n"
}
