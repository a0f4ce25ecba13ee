//! Pins and masses of a file of states, in the place of those of the machine.
//!
//! | key | meaning |
//! |---|---|
//! | `O1` | boom foot, m |
//! | `L1`, `L2`, `L3` | lengths of boom, arm and bucket, m |
//! | `P1`, `B1` | base and rod pin of the boom cylinder, m |
//! | `B2`, `A1` | base and rod pin of the arm cylinder, m |
//! | `R`, `C`, `r`, `k` | rocker pin, base of the bucket cylinder, lengths of rocker and link, m |
//! | `h`, `kappa` | distance and angle of the link pin on the bucket, m and rad |
//! | `boom`, `arm`, `inner`, `bucket` | [mass, x, z, inertia] of the bodies; kg, m, m, kg m2 |
//! | `payload` | the same of the payload where a state has no `payload` of its own |
//! | `lmin`, `stroke` | length of each cylinder at position 0, and its stroke, m; may be left out |
//! | `branch`, `g` | -1, the outer side of the bucket's linkage, and 9.81 m/s2; may be left out |
//! | `width` | of the bucket; without a meaning here |
//!
//! Pins are in the frames of [`mechanism::Geometry`]. A payload keeps its radius of gyration when its mass changes; one
//! without a mass has that of a heap of the size of a bucket.

use mechanism::{AXES, Body, FourBar, Geometry, Masses, Mechanism, Payload, Rotation, Vector, dynamics::GRAVITY};
use serde_json::Value;

use super::{
    HEAVIEST,
    fields::{Fields, Notes, shown},
};

/// Radius of gyration of a payload without a mass, m.
const PAYLOAD_RADIUS: f64 = 0.35;

/// Largest distance and coordinate, m: those of the machine file.
const FARTHEST: f64 = 100.0;

/// Largest moment of inertia, kg m2: that of the machine file.
const LARGEST_INERTIA: f64 = 1e9;

const KEYS: [&str; 24] = [
    "O1", "L1", "P1", "B1", "B2", "A1", "L2", "R", "C", "r", "k", "h", "branch", "kappa", "L3", "width", "lmin",
    "stroke", "boom", "arm", "inner", "bucket", "payload", "g",
];

/// Pins, masses and strokes of the file.
pub struct Parameters {
    pub mechanism: Mechanism,
    /// m; `None` where the file does not give them.
    pub strokes: Option<[f64; AXES]>,
}

/// Reads the object.
pub fn read(value: &Value, notes: &mut Notes) -> Option<Parameters> {
    let Some(of) = value.as_object() else {
        return notes.refuse("parameters", shown(Some(value)), "an object with pins and masses");
    };
    let fields = Fields { place: "parameters".to_owned(), of };
    fields.expect_only(&KEYS, notes);
    for (key, only) in [("g", GRAVITY), ("branch", -1.0)] {
        if fields.has(key) {
            let _ = fields.number(key, only..=only, "", notes);
        }
    }
    let has_strokes = fields.has("lmin") || fields.has("stroke");
    let mut of_cylinders =
        |key| has_strokes.then(|| fields.numbers(key, 0.0..=FARTHEST, "m, boom, arm, telescope, bucket", notes));
    let (retracted, strokes) = (of_cylinders("lmin"), of_cylinders("stroke"));
    let geometry = read_geometry(&fields, notes);
    let masses = read_masses(&fields, notes);
    Some(Parameters {
        mechanism: Mechanism {
            geometry: geometry?,
            retracted: retracted.flatten().unwrap_or([0.0; AXES]),
            masses: masses?,
        },
        strokes: strokes.flatten(),
    })
}

fn read_geometry(fields: &Fields, notes: &mut Notes) -> Option<Geometry> {
    let mut pin = |key: &str| {
        let [x, z] = fields.numbers(key, -FARTHEST..=FARTHEST, "m, [x, z]", notes)?;
        Some(Vector::new(x, z))
    };
    let (foot, boom_base, boom_rod, arm_base) = (pin("O1"), pin("P1"), pin("B1"), pin("B2"));
    let (arm_rod, rocker_pin, bucket_base) = (pin("A1"), pin("R"), pin("C"));
    let mut length = |key: &str| fields.number(key, 1e-3..=FARTHEST, "m", notes);
    let (boom_length, arm_length, bucket_length) = (length("L1"), length("L2"), length("L3"));
    let (rocker, link, link_arm) = (length("r"), length("k"), length("h"));
    let angle = fields.number("kappa", -10.0..=10.0, "rad", notes);
    Some(Geometry {
        boom_foot: foot?,
        boom_length: boom_length?,
        boom_cylinder_base: boom_base?,
        boom_cylinder_rod: boom_rod?,
        arm_cylinder_base: arm_base?,
        arm_cylinder_rod: arm_rod?,
        arm_length: arm_length?,
        bucket: FourBar {
            rocker_pin: rocker_pin?,
            cylinder_base: bucket_base?,
            rocker: rocker?,
            link: link?,
            link_pin: link_arm? * Rotation::by(angle?).axis(),
        },
        bucket_length: bucket_length?,
    })
}

fn read_masses(fields: &Fields, notes: &mut Notes) -> Option<Masses> {
    let mut body = |key: &str| {
        let [mass, x, z, inertia] =
            fields.numbers(key, -LARGEST_INERTIA..=LARGEST_INERTIA, "[kg, m, m, kg m2]", notes)?;
        if mass < 0.0 || inertia < 0.0 {
            return notes.refuse(&fields.at(key), format!("{mass} kg, {inertia} kg m2"), "numbers from 0 on");
        }
        if mass > HEAVIEST || x.abs() > FARTHEST || z.abs() > FARTHEST {
            let allowed = format!("up to {HEAVIEST} kg, and distances up to {FARTHEST} m");
            return notes.refuse(&fields.at(key), format!("{mass} kg at [{x}, {z}] m"), &allowed);
        }
        Some(Body { mass, center: Vector::new(x, z), inertia })
    };
    let (boom, arm, inner, bucket) = (body("boom"), body("arm"), body("inner"), body("bucket"));
    let Body { mass, center, inertia } = body("payload")?;
    let radius_of_gyration = if mass > 0.0 { (inertia / mass).sqrt() } else { PAYLOAD_RADIUS };
    if radius_of_gyration > FARTHEST || mass == 0.0 && inertia > 0.0 {
        let allowed = format!("an inertia from 0 to the mass times {FARTHEST} m squared");
        return notes.refuse(&fields.at("payload"), format!("{inertia} kg m2 for {mass} kg"), &allowed);
    }
    let payload = Payload { mass, center, radius_of_gyration };
    Some(Masses { boom: boom?, arm: arm?, inner: inner?, bucket: bucket?, payload })
}
