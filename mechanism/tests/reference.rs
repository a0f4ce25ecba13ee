//! The mechanism against states that another program has evaluated: the file that `HYDRAXIS_MECHANISM_STATES` names.

use mechanism::{AXES, Body, Dynamics, FourBar, Geometry, Masses, Payload, Pose, Rotation, Vector};
use serde_json::Value;

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    let list = value.as_array().unwrap();
    std::array::from_fn(|i| list[i].as_f64().unwrap())
}

fn vector(value: &Value) -> Vector {
    let [x, z] = numbers(value);
    Vector::new(x, z)
}

fn body(value: &Value) -> Body {
    let [mass, x, z, inertia] = numbers(value);
    Body { mass, center: Vector::new(x, z), inertia }
}

fn geometry(p: &Value) -> Geometry {
    let number = |name: &str| p[name].as_f64().unwrap();
    Geometry {
        boom_foot: vector(&p["O1"]),
        boom_length: number("L1"),
        boom_cylinder_base: vector(&p["P1"]),
        boom_cylinder_rod: vector(&p["B1"]),
        arm_cylinder_base: vector(&p["B2"]),
        arm_cylinder_rod: vector(&p["A1"]),
        arm_length: number("L2"),
        bucket: FourBar {
            rocker_pin: vector(&p["R"]),
            cylinder_base: vector(&p["C"]),
            rocker: number("r"),
            link: number("k"),
            link_pin: number("h") * Rotation::by(number("kappa")).axis(),
        },
        bucket_length: number("L3"),
    }
}

fn masses(p: &Value, payload: f64) -> Masses {
    let center = Vector::new(0.75, 0.22);
    Masses {
        boom: body(&p["boom"]),
        arm: body(&p["arm"]),
        inner: body(&p["inner"]),
        bucket: body(&p["bucket"]),
        payload: Payload { mass: payload, center, radius_of_gyration: 0.35 },
    }
}

/// Largest difference by the largest magnitude of what is expected.
fn difference(found: &[f64], expected: &[f64]) -> f64 {
    let scale = expected.iter().fold(0.0f64, |most, value| most.max(value.abs()));
    let worst = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, |most: f64, value| {
        assert!(value.is_finite());
        most.max(value)
    });
    worst / scale
}

#[test]
#[ignore = "needs reference states beside the project, named by HYDRAXIS_MECHANISM_STATES"]
fn all_states_agree() {
    let file = std::env::var("HYDRAXIS_MECHANISM_STATES").expect("HYDRAXIS_MECHANISM_STATES names no file");
    let file: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let geometry = geometry(&file["parameters"]);
    let mut worst = std::collections::BTreeMap::<&str, f64>::new();
    for state in file["states"].as_array().unwrap() {
        let lengths: [f64; AXES] = numbers(&state["cylinder_length"]);
        let rates: [f64; AXES] = numbers(&state["cylinder_velocity"]);
        let force: [f64; AXES] = numbers(&state["cylinder_force"]);
        let masses = masses(&file["parameters"], state["payload"].as_f64().unwrap());
        let pose = Pose::new(&geometry, &lengths);
        let joint_rates = pose.joint_rates(&rates);
        let terms = Dynamics::new(&masses, &pose, &joint_rates);
        let tip_force = vector(&state["tip_force"]);
        let acceleration = terms.of_cylinders(&pose, &rates, tip_force).acceleration(&force).unwrap();
        let tip_velocity = pose.tip_velocity(&rates);
        let both: [f64; AXES] = std::array::from_fn(|i| terms.gravity[i] + terms.coriolis[i]);
        let rows = |matrix: [[f64; AXES]; AXES]| matrix.concat();
        let expected_rows =
            |name: &str| state[name].as_array().unwrap().iter().flat_map(numbers::<AXES>).collect::<Vec<f64>>();
        let back = geometry.cylinder_lengths(pose.tip, pose.bucket, lengths[2]).unwrap();
        let mut check = |name, found: &[f64], expected: &[f64]| {
            let entry = worst.entry(name).or_default();
            *entry = entry.max(difference(found, expected));
        };
        check("q", &pose.joints(), &numbers::<AXES>(&state["q"]));
        check("qd", &joint_rates, &numbers::<AXES>(&state["qd"]));
        check("dq_dl", &pose.rate, &numbers::<AXES>(&state["dq_dl"]));
        check("d2q_dl2", &pose.curvature, &numbers::<AXES>(&state["d2q_dl2"]));
        check("M", &rows(terms.mass), &expected_rows("M"));
        check("M_cylinder", &rows(terms.cylinder_mass(&pose)), &expected_rows("M_cylinder"));
        check("gravity", &terms.gravity, &numbers::<AXES>(&state["gravity"]));
        check("coriolis_and_gravity", &both, &numbers::<AXES>(&state["coriolis_and_gravity"]));
        check("cylinder_acceleration", &acceleration, &numbers::<AXES>(&state["cylinder_acceleration"]));
        check("tip", &[pose.tip.x, pose.tip.z], &numbers::<2>(&state["tip"]));
        check("tip_velocity", &[tip_velocity.x, tip_velocity.z], &numbers::<2>(&state["tip_velocity"]));
        check("inverse", &back, &lengths);
    }
    println!("{worst:#?}");
    assert!(worst.values().all(|difference| *difference < 1e-12), "{worst:#?}");
}
