//! The equations of the mechanism against sums over all bodies, differences and energies, at arbitrary states.

use mechanism::{
    AXES, Body, CylinderDynamics, FourBar, Geometry, Joint, Linkage, Masses, Mechanism, Moments, Payload, Pose,
    Rotation, Vector, dynamics::GRAVITY,
};
use proptest::prelude::*;

/// An excavator of 20 t.
fn excavator(payload: f64) -> Mechanism {
    let body = |mass, x, z, inertia| Body { mass, center: Vector::new(x, z), inertia };
    let payload = Payload { mass: payload, center: Vector::new(0.75, 0.22), radius_of_gyration: 0.35 };
    Mechanism {
        geometry: Geometry {
            boom_foot: Vector::new(0.23, 1.96),
            boom_length: 5.65,
            boom_cylinder_base: Vector::new(0.582, -0.582),
            boom_cylinder_rod: Vector::new(2.431, 0.982),
            arm_cylinder_base: Vector::new(3.004, 0.885),
            arm_cylinder_rod: Vector::new(-0.843, 0.249),
            arm_length: 2.4,
            bucket: FourBar {
                rocker_pin: Vector::new(-0.41, 0.0),
                cylinder_base: Vector::new(-2.597, 0.711),
                rocker: 0.7,
                link: 0.6,
                link_pin: 0.466 * Rotation::by(101.5f64.to_radians()).axis(),
            },
            bucket_length: 1.51,
        },
        retracted: [1.87, 2.075, 0.0, 1.68],
        masses: Masses {
            boom: body(2130.0, 2.75, 0.55, 5450.0),
            arm: body(850.0, 0.75, 0.1, 480.0),
            inner: body(650.0, -1.0, 0.15, 280.0),
            bucket: body(660.0, 0.65, 0.28, 130.0),
            payload,
        },
    }
}

const STROKE: [f64; AXES] = [1.334, 1.49, 1.2, 1.12];

fn positions() -> impl Strategy<Value = [f64; AXES]> {
    [0.0..STROKE[0], 0.0..STROKE[1], 0.0..STROKE[2], 0.0..STROKE[3]]
}

fn rates() -> impl Strategy<Value = [f64; AXES]> {
    [-0.5..0.5, -0.5..0.5, -0.5..0.5, -0.5..0.5]
}

/// Every body with the number of the joint that moves it, and its centre of mass.
fn bodies(masses: &Masses, pose: &Pose) -> [(usize, Body, Vector); 5] {
    let load = masses.payload;
    let inertia = load.mass * load.radius_of_gyration * load.radius_of_gyration;
    let payload = Body { mass: load.mass, center: load.center, inertia };
    [
        (0, masses.boom, pose.boom_foot + pose.boom * masses.boom.center),
        (1, masses.arm, pose.arm_pin + pose.arm * masses.arm.center),
        (2, masses.inner, pose.bucket_pin + pose.arm * masses.inner.center),
        (3, masses.bucket, pose.bucket_pin + pose.bucket * masses.bucket.center),
        (3, payload, pose.bucket_pin + pose.bucket * payload.center),
    ]
}

fn expect_close(found: &[f64], expected: &[f64], tolerance: f64) -> Result<(), TestCaseError> {
    let scale = expected.iter().fold(1e-300, |most: f64, value| most.max(value.abs()));
    for (a, b) in found.iter().zip(expected) {
        prop_assert!((a - b).abs() <= tolerance * scale, "{found:?} instead of {expected:?}");
    }
    Ok(())
}

proptest! {
    #[test]
    fn mass_and_gravity_are_the_sums_over_all_bodies(x in positions(), payload in 0.0..2000.0) {
        let machine = excavator(payload);
        let pose = machine.prepared().pose(&x);
        let terms = Moments::new(&machine.masses).dynamics(&pose, &[0.0; AXES]);
        let (mut mass, mut gravity, mut energy) = ([[0.0; AXES]; AXES], [0.0; AXES], 0.0);
        for (last, body, center) in bodies(&machine.masses, &pose) {
            let jacobian = pose.jacobian(center, last);
            let turns = |i: usize| f64::from(u8::from(i <= last && i != 2));
            for i in 0..AXES {
                for j in 0..AXES {
                    mass[i][j] += body.mass * jacobian[i].dot(jacobian[j]) + body.inertia * turns(i) * turns(j);
                }
                gravity[i] += body.mass * GRAVITY * jacobian[i].z;
            }
            energy += body.mass * GRAVITY * (center.z - pose.boom_foot.z);
        }
        expect_close(&terms.mass.concat(), &mass.concat(), 1e-14)?;
        expect_close(&terms.gravity, &gravity, 1e-14)?;
        prop_assert!((terms.potential_energy - energy).abs() < 1e-9);
        prop_assert_eq!(terms.coriolis, [0.0; AXES]);
    }

    /// Lagrange: h_c = M' q' - 1/2 d(q' M q')/dq, in cylinder coordinates and with differences for the derivatives.
    #[test]
    fn loads_in_motion_are_those_of_lagrange(x in positions(), v in rates(), payload in 0.0..2000.0) {
        let machine = excavator(payload);
        let prepared = machine.prepared();
        let mass = |x: &[f64; AXES]| prepared.dynamics(&prepared.pose(x), &[0.0; AXES], Vector::default()).mass;
        let step = 1e-6;
        let derivative = |k: usize| {
            let moved = |by: f64| { let mut x = x; x[k] += by; mass(&x) };
            let (high, low) = (moved(step), moved(-step));
            let of = |i: usize, j: usize| (high[i][j] - low[i][j]) / (2.0 * step);
            std::array::from_fn::<[f64; AXES], AXES, _>(|i| std::array::from_fn(|j| of(i, j)))
        };
        let derivatives: [[[f64; AXES]; AXES]; AXES] = std::array::from_fn(derivative);
        let pairs = || (0..AXES).flat_map(|j| (0..AXES).map(move |k| (j, k)));
        let expected: [f64; AXES] = std::array::from_fn(|i| {
            pairs().map(|(j, k)| (derivatives[k][i][j] - 0.5 * derivatives[i][j][k]) * v[j] * v[k]).sum()
        });
        let pose = prepared.pose(&x);
        let at = |v: &[f64; AXES]| prepared.dynamics(&pose, v, Vector::default()).load;
        let (moving, resting) = (at(&v), at(&[0.0; AXES]));
        let found: [f64; AXES] = std::array::from_fn(|i| moving[i] - resting[i]);
        // The differences are exact to about 1e-6 of the largest derivative of the mass.
        let scale = pairs().flat_map(|(i, j)| derivatives[i][j]).fold(0.0, |most: f64, value| most.max(value.abs()));
        for (a, b) in found.iter().zip(expected) {
            prop_assert!((a - b).abs() < 1e-6 * scale, "{found:?} instead of {expected:?}");
        }
    }

    #[test]
    fn power_of_the_cylinders_goes_into_kinetic_and_potential_energy(
        x in positions(), v in rates(), force in [-1e5..1e5, -1e5..1e5, -1e5..1e5, -1e5..1e5],
        at_tip in [-1e4..1e4, -1e4..1e4],
    ) {
        let machine = excavator(500.0);
        let prepared = machine.prepared();
        let pose = prepared.pose(&x);
        let at_tip = Vector::new(at_tip[0], at_tip[1]);
        let acceleration = prepared.dynamics(&pose, &v, at_tip).acceleration(&force).unwrap();
        let energy = |time: f64| {
            let x = std::array::from_fn(|i| x[i] + time * v[i] + 0.5 * time * time * acceleration[i]);
            let v = std::array::from_fn(|i| v[i] + time * acceleration[i]);
            let (kinetic, potential) = prepared.energy(&prepared.pose(&x), &v);
            kinetic + potential
        };
        let step = 1e-5;
        let found = (energy(step) - energy(-step)) / (2.0 * step);
        let cylinders: f64 = (0..AXES).map(|i| force[i] * v[i]).sum();
        let power = cylinders + at_tip.dot(pose.tip_velocity(&v));
        let largest: f64 = (0..AXES).map(|i| (force[i] * v[i]).abs()).sum::<f64>() + 1e5;
        prop_assert!((found - power).abs() < 1e-5 * largest, "{found} instead of {power}");
    }

    #[test]
    fn positions_follow_from_the_place_of_the_teeth(x in positions()) {
        let machine = excavator(0.0);
        let pose = machine.prepared().pose(&x);
        let lengths = machine.geometry.cylinder_lengths(pose.tip, pose.bucket, x[2]).unwrap();
        expect_close(&machine.positions(&lengths), &x, 1e-12)?;
    }

    #[test]
    fn the_teeth_move_as_their_jacobian_says(x in positions(), v in rates()) {
        let prepared = excavator(0.0).prepared();
        let step = 1e-6;
        let tip = |time: f64| prepared.pose(&std::array::from_fn(|i| x[i] + time * v[i])).tip;
        let difference = 0.5 / step * (tip(step) - tip(-step));
        let velocity = prepared.pose(&x).tip_velocity(&v);
        prop_assert!((velocity - difference).norm() < 1e-6, "{velocity:?} instead of {difference:?}");
    }
}

#[test]
fn accelerations_solve_the_equation_of_motion() {
    let mass = [[4.0, 1.0, 0.5, -0.2], [1.0, 3.0, 0.1, 0.3], [0.5, 0.1, 2.0, 0.4], [-0.2, 0.3, 0.4, 1.0]];
    let terms = CylinderDynamics { mass, load: [1.0, 2.0, 3.0, 4.0] };
    let expected = [0.7, -1.2, 2.0, 0.1];
    let force = std::array::from_fn(|i| terms.load[i] + (0..AXES).map(|j| mass[i][j] * expected[j]).sum::<f64>());
    let found = terms.acceleration(&force).unwrap();
    found.iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 1e-14, "{found:?}"));
}

#[test]
fn a_pose_that_does_not_close_has_no_acceleration() {
    let prepared = excavator(0.0).prepared();
    let pose = prepared.pose(&[2.0, 0.5, 0.5, 0.5]);
    assert!(pose.rate[0].is_nan());
    assert_eq!(prepared.dynamics(&pose, &[0.0; AXES], Vector::default()).acceleration(&[0.0; AXES]), None);
}

#[test]
fn a_place_out_of_reach_is_refused() {
    let geometry = excavator(0.0).geometry;
    let at = |x, z| geometry.cylinder_lengths(Vector::new(x, z), Rotation::by(-1.6), 0.0).map_err(|e| e.to_string());
    assert_eq!(at(12.0, 0.0), Err("the bucket pin is out of reach of boom and arm".to_owned()));
    assert!(at(7.0, 0.0).is_ok());
    // With its link pin at the rocker's pin on the arm, 78.5 degrees from the arm, the bucket is beyond its linkage.
    let arm = excavator(0.0).prepared().pose(&STROKE.map(|stroke| 0.5 * stroke));
    let pitch = arm.arm * Rotation::by(78.5f64.to_radians());
    let tip = arm.bucket_pin + geometry.bucket_length * pitch.axis();
    let error = geometry.cylinder_lengths(tip, pitch, 0.6).unwrap_err();
    assert_eq!(error.to_string(), "the bucket's linkage does not close at this pitch");
}

#[test]
fn the_teeth_reach_as_far_as_the_links_allow() {
    // Farthest forward, arm and boom form the widest triangle, and the bucket points away from the boom foot.
    let prepared = excavator(0.0).prepared();
    let extent = prepared.extent(&[0.0; AXES], &STROKE, 0.6);
    let elbow = prepared.pose(&[0.0; AXES]).joints()[1];
    let to_bucket = (5.65f64.powi(2) + 3.0f64.powi(2) + 2.0 * 5.65 * 3.0 * elbow.cos()).sqrt();
    assert!((extent.reach - 0.23 - to_bucket - 1.51).abs() < 1e-6, "{extent:?} {to_bucket}");
    assert!(extent.depth > 6.6 && extent.depth < 6.8, "{extent:?}");
}

#[test]
fn length_and_rotation_of_every_joint_lead_back_to_each_other() {
    let geometry = excavator(0.0).geometry;
    let linkage = Linkage::new(&geometry);
    for i in 0..=40 {
        let part = f64::from(i) / 40.0;
        let lengths = [1.87 + 1.334 * part, 2.075 + 1.49 * part, 0.7, 1.68 + 1.12 * part];
        let pose = linkage.pose(&lengths);
        let joints = pose.joints();
        for joint in Joint::ALL {
            let (rotation, length) = (linkage.rotation(joint, lengths[joint.axis()]), lengths[joint.axis()]);
            assert!((geometry.length_of(joint, rotation) - length).abs() < 1e-12, "{joint:?}");
            assert!((rotation.angle() - joints[joint.axis()]).abs() < 1e-14, "{joint:?}");
            assert!((pose.joint(joint).angle() - rotation.angle()).abs() < 1e-14, "{joint:?}");
        }
    }
}

#[test]
fn the_telescope_has_no_joint() {
    assert_eq!([0, 1, 2, 3, 4].map(|axis| Joint::of_axis(axis).is_some()), [true, true, false, true, false]);
}
