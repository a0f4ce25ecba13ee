//! Pins, lengths and masses of an excavator's boom, arm, telescope and bucket: `[mechanism]`.
//!
//! With this table the first four axes of the machine are the cylinders of boom, arm, telescope and bucket, whatever
//! their names are. The table says where the pins are and what the bodies weigh; the equations are those of the crate
//! `mechanism`. Pins are `[x, z]` in m: x along the body, z to the side that is up when the body lies level.
//!
//! Trap: the centre of the telescope's sliding section is given from the bucket pin, which moves with it.

use mechanism::{AXES, Body, END_STOP_WAY, FourBar, Geometry, Masses, Mechanism, Payload, Vector};

use super::{Axis, document::Section};

/// Range of coordinates and lengths, m.
const PLACES: std::ops::RangeInclusive<f64> = -100.0..=100.0;
const LENGTHS: std::ops::RangeInclusive<f64> = 1e-3..=100.0;

/// The tables inside `[mechanism]` that have a cylinder, in the order of the axes.
const BODIES: [&str; AXES] = ["boom", "arm", "telescope", "bucket"];

/// Reads the table, where it is given: the mechanism, and the mass up to which its payload is estimated, kg.
pub(super) fn read(section: &mut Section) -> Option<(Mechanism, Option<f64>)> {
    if !section.is_given() {
        return None;
    }
    let mut boom = section.section("boom");
    let mut arm = section.section("arm");
    let mut telescope = section.section("telescope");
    let mut bucket = section.section("bucket");
    let geometry = read_geometry(&mut boom, &mut arm, &mut bucket);
    let cylinder = |section: &mut Section| {
        length(section, "cylinder_length", "Length of the cylinder from pin to pin at position 0")
    };
    let retracted = [cylinder(&mut boom), cylinder(&mut arm), 0.0, cylinder(&mut bucket)];
    let from_its_pin = "Centre of mass in the frame of the body: from its pin, x along the body";
    let from_bucket_pin = "Centre of mass of the sliding section, from the bucket pin, along the arm";
    let masses = [
        body(&mut boom, from_its_pin),
        body(&mut arm, from_its_pin),
        body(&mut telescope, from_bucket_pin),
        body(&mut bucket, "Centre of mass, from the bucket pin, x towards the teeth"),
    ];
    [boom, arm, telescope, bucket].into_iter().for_each(Section::finish);
    let [boom, arm, inner, bucket] = masses;
    let (payload, heaviest) = read_payload(section.section("payload"), bucket.center);
    let masses = Masses { boom, arm, inner, bucket, payload };
    Some((Mechanism { geometry, retracted, masses }, heaviest))
}

fn read_geometry(boom: &mut Section, arm: &mut Section, bucket: &mut Section) -> Geometry {
    let foot = "Pin between machine and boom: forward of the centre of swing, above ground";
    let boom_base = "Base of the boom cylinder, from the boom foot, forward and up";
    let boom_rod = "Rod pin of the boom cylinder on the boom, from the boom foot";
    let arm_base = "Base of the arm cylinder on the boom, from the boom foot";
    let arm_rod = "Rod pin of the arm cylinder on the arm, from the arm pin";
    let bucket_base = "Base of the bucket cylinder on the arm, from the bucket pin, along the arm";
    let rocker_pin = "Pin of the rocker on the arm, from the bucket pin, along the arm";
    let link_pin = "Pin of the link on the bucket, from the bucket pin, x towards the teeth";
    Geometry {
        boom_foot: place(boom, "foot", foot),
        boom_length: length(boom, "length", "From the boom foot to the arm pin"),
        boom_cylinder_base: place(boom, "cylinder_base", boom_base),
        boom_cylinder_rod: place(boom, "cylinder_rod", boom_rod),
        arm_cylinder_base: place(arm, "cylinder_base", arm_base),
        arm_cylinder_rod: place(arm, "cylinder_rod", arm_rod),
        arm_length: length(arm, "length", "From the arm pin to the bucket pin with the telescope retracted"),
        bucket_length: length(bucket, "length", "From the bucket pin to the teeth"),
        bucket: FourBar {
            cylinder_base: place(bucket, "cylinder_base", bucket_base),
            rocker_pin: place(bucket, "rocker_pin", rocker_pin),
            rocker: length(bucket, "rocker_length", "From the rocker's pin on the arm to its other end"),
            link: length(bucket, "link_length", "From the rocker's end to the bucket"),
            link_pin: place(bucket, "link_pin", link_pin),
        },
    }
}

fn place(section: &mut Section, key: &str, meaning: &'static str) -> Vector {
    let [x, z] = section.key(key, meaning).point(PLACES, "m");
    Vector::new(x, z)
}

fn length(section: &mut Section, key: &str, meaning: &'static str) -> f64 {
    section.key(key, meaning).number(LENGTHS, "m")
}

fn body(section: &mut Section, center: &'static str) -> Body {
    Body {
        mass: section.key("mass", "Mass of the body").number(1e-3..=1e6, "kg"),
        center: place(section, "center", center),
        inertia: section.key("inertia", "Moment of inertia about the centre of mass").number(0.0..=1e9, "kg m2"),
    }
}

fn read_payload(mut section: Section, bucket: Vector) -> (Payload, Option<f64>) {
    let [x, z] = section
        .key("center", "Centre of mass of the payload, from the bucket pin, x towards the teeth")
        .rule("mechanism.bucket.center")
        .point_or([bucket.x, bucket.z], PLACES, "m");
    let payload = Payload {
        mass: section.key("mass", "Mass that the bucket carries").number_or(0.0, 0.0..=1e6, "kg"),
        center: Vector::new(x, z),
        radius_of_gyration: section
            .key("radius_of_gyration", "Radius of gyration of the payload about its centre of mass")
            .number_or(0.0, 0.0..=100.0, "m"),
    };
    let heaviest = section
        .key("heaviest", "Heaviest payload: with it the controller estimates the payload by the chamber pressures")
        .rule("none: the controller counts on mass")
        .optional_number(1.0..=1e6, "kg");
    if let Some(heaviest) = heaviest.filter(|heaviest| *heaviest < payload.mass) {
        let allowed = format!("the mass of the payload, {} kg, or more", payload.mass);
        section.refuse("heaviest", format!("{heaviest} kg"), allowed);
    }
    section.finish();
    (payload, heaviest)
}

/// Refuses an estimate of the payload on a machine that measures neither its boom's nor its arm's pressures.
pub(super) fn expect_pressures(section: &Section, axes: &[Axis]) {
    let measures = |axis: &Axis| axis.pressure.is_some() && axis.plant.is_some();
    if !axes.iter().take(2).any(measures) {
        let found = "a payload to be estimated, without chamber pressures of boom or arm";
        section.refuse(
            "payload.heaviest",
            found,
            "[axis.boom.pressure], or that of the arm, beside [axis.NAME.plant], which has the areas",
        );
    }
}

/// Refuses axes that have the name of a body and stand in the place of another one.
pub(super) fn expect_order(section: &Section, names: &[String]) {
    for (place, name) in names.iter().enumerate() {
        let body = BODIES.iter().position(|body| body == name);
        if let Some(body) = body.filter(|body| *body != place) {
            let found = format!("axis.{name} as axis {} of the machine", place + 1);
            let order = BODIES.join(", ");
            section.refuse("", found, format!("it as axis {}: the first four are {order}, in this order", body + 1));
        }
    }
}

/// Refuses a mechanism that its axes cannot move over their strokes `strokes`, m, of all axes of the machine.
pub(super) fn expect_movable(section: &Section, mechanism: &Mechanism, strokes: &[f64]) {
    let Some(strokes) = strokes.first_chunk::<AXES>() else {
        let found = format!("a machine of {} axes", strokes.len());
        section.refuse("", found, "4 axes or more; the first four are boom, arm, telescope and bucket");
        return;
    };
    if !section.is_sound() {
        return;
    }
    for (axis, flaw) in mechanism.flaws(strokes, &[END_STOP_WAY; AXES]) {
        let allowed = format!(
            "pins with which the cylinder turns the {} one way over its stroke of {} m, well away from dead centres",
            BODIES[axis], strokes[axis]
        );
        section.refuse(BODIES[axis], flaw.to_string(), allowed);
    }
}
