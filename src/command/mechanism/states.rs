//! Given states of the machine, evaluated: `--states`.
//!
//! ```text
//! in    cylinder_length, cylinder_velocity, cylinder_force, payload, tip_force
//! out   M, gravity, coriolis_and_gravity, dq_dl, d2q_dl2, q, qd, qdd, tau, M_cylinder, cylinder_acceleration,
//!       tip, tip_velocity, tip_pitch
//! qdd   = J l'' + J' l'^2          tau = F / J          tip_pitch = q_1 + q_2 + q_4
//! ```
//!
//! Symbols and units are those of the crate `mechanism`; `payload` is the mass in the bucket in kg. A file can have
//! `parameters` with pins and masses of its own, with the names of [`parameters`]; without them those of the machine
//! hold.
//!
//! Trap: JSON has no NaN and no infinity, so a file with them is not JSON.

use std::path::Path;

use mechanism::dynamics::GRAVITY;
use mechanism::{AXES, Body, FourBar, Geometry, Linkage, Masses, Mechanism, Moments, Payload, Rotation, Vector};
use serde::Serialize;
use serde_json::{Map, Value};

use crate::{failure::Failure, report::table::table};

/// Radius of gyration of the payload where `parameters` have none, m: a heap of the size of a bucket.
const PAYLOAD_RADIUS: f64 = 0.35;

/// Heaviest payload, kg.
const HEAVIEST: f64 = 1e6;

/// Largest number of problems that are shown.
const MOST_SHOWN: usize = 30;

/// The answer: the states with everything that follows from them.
#[derive(Debug, Serialize)]
pub struct Answer {
    #[serde(skip_serializing_if = "Option::is_none")]
    parameters: Option<Value>,
    states: Vec<State>,
}

/// One state, evaluated.
#[derive(Debug, Serialize)]
#[allow(non_snake_case, reason = "the names of the file")]
struct State {
    payload: f64,
    tip_force: [f64; 2],
    cylinder_length: [f64; AXES],
    cylinder_velocity: [f64; AXES],
    cylinder_force: [f64; AXES],
    q: [f64; AXES],
    qd: [f64; AXES],
    dq_dl: [f64; AXES],
    d2q_dl2: [f64; AXES],
    tau: [f64; AXES],
    M: [[f64; AXES]; AXES],
    gravity: [f64; AXES],
    coriolis_and_gravity: [f64; AXES],
    qdd: [f64; AXES],
    cylinder_acceleration: [f64; AXES],
    tip: [f64; 2],
    tip_velocity: [f64; 2],
    tip_pitch: f64,
    M_cylinder: [[f64; AXES]; AXES],
}

/// Evaluates the states of a file, with its parameters or with those of `machine`.
///
/// # Errors
/// The file cannot be read, or everything that is wrong with it.
pub fn answer(file: &Path, machine: Option<&Mechanism>) -> Result<Answer, Failure> {
    let refuse = |problem: String| Failure::usage(format!("--states: {}: {problem}", file.display()));
    let text =
        std::fs::read_to_string(file).map_err(|error| refuse(format!("found a file that cannot be read: {error}")))?;
    let value: Value = serde_json::from_str(&text)
        .map_err(|error| refuse(format!("found no JSON: {error}; allowed: JSON, which has no NaN and no infinity")))?;
    let mut problems = Problems::default();
    let answer = read(&value, machine, &mut problems);
    match answer {
        Some(answer) if problems.0.is_empty() => Ok(answer),
        _ => {
            let shown: Vec<String> = (problems.0.iter().take(MOST_SHOWN))
                .map(|problem| format!("--states: {}: {problem}", file.display()))
                .collect();
            let more = problems.0.len().saturating_sub(MOST_SHOWN);
            let more = if more > 0 { format!("\nand {more} more") } else { String::new() };
            Err(Failure::usage(shown.join("\n") + &more))
        }
    }
}

/// What is wrong with the file.
#[derive(Default)]
struct Problems(Vec<String>);

impl Problems {
    fn refuse<T>(&mut self, place: &str, found: impl std::fmt::Display, allowed: &str) -> Option<T> {
        self.0.push(format!("{place}: found {found}; allowed: {allowed}"));
        None
    }
}

fn read(value: &Value, machine: Option<&Mechanism>, problems: &mut Problems) -> Option<Answer> {
    let allowed = "a list of one or more states";
    let states = match value.get("states").and_then(Value::as_array) {
        Some(states) if !states.is_empty() => states,
        Some(_) => return problems.refuse("states", "an empty list", allowed),
        None => return problems.refuse("states", shown(value.get("states")), allowed),
    };
    let given = value.get("parameters");
    let mechanism = match (given, machine) {
        (Some(given), _) => parameters(given, problems)?,
        (None, Some(machine)) => *machine,
        (None, None) => {
            let allowed = "pins and masses in the file, or a machine with the table [mechanism]";
            return problems.refuse("parameters", "nothing", allowed);
        }
    };
    let linkage = Linkage::new(&mechanism.geometry);
    let mut answers = Vec::with_capacity(states.len());
    for (number, state) in states.iter().enumerate() {
        let place = format!("states[{number}]");
        match state.as_object() {
            Some(state) => answers.extend(evaluate(&Fields { place, of: state }, &mechanism, &linkage, problems)),
            None => problems.refuse(&place, shown(Some(state)), "an object with the values of one state").unwrap_or(()),
        }
    }
    Some(Answer { parameters: given.cloned(), states: answers })
}

fn evaluate(fields: &Fields, mechanism: &Mechanism, linkage: &Linkage, problems: &mut Problems) -> Option<State> {
    let axes = "in the order boom, arm, telescope, bucket";
    let length = fields.numbers("cylinder_length", &format!("m, {axes}"), problems);
    let velocity = fields.numbers("cylinder_velocity", &format!("m/s, {axes}"), problems);
    let force = fields.numbers("cylinder_force", &format!("N, {axes}"), problems);
    let payload = fields.number("payload", 0.0..=HEAVIEST, "kg", problems);
    let tip_force = fields.numbers("tip_force", "N, [x, z]", problems);
    let (length, velocity, force, payload, tip_force) = (length?, velocity?, force?, payload?, tip_force?);

    let pose = linkage.pose(&length);
    let names = ["boom", "arm", "telescope", "bucket"];
    if let Some(open) = (0..AXES).find(|i| !(pose.rate[*i].is_finite() && pose.curvature[*i].is_finite())) {
        let found = format!("{:?} m, with which the linkage of the {} does not close", length, names[open]);
        return problems.refuse(&fields.at("cylinder_length"), found, "lengths at which the pins can be joined");
    }
    let payload_body = Payload { mass: payload, ..mechanism.masses.payload };
    let moments = Moments::new(&Masses { payload: payload_body, ..mechanism.masses });
    let rates = pose.joint_rates(&velocity);
    let terms = moments.dynamics(&pose, &rates);
    let at_tip = Vector::new(tip_force[0], tip_force[1]);
    let Some(acceleration) = terms.of_cylinders(&pose, &velocity, at_tip).acceleration(&force) else {
        let allowed = "masses and inertias that give every joint inertia";
        return problems.refuse(&fields.place, "a mass matrix that is not positive definite", allowed);
    };
    let tip_velocity = pose.tip_velocity(&velocity);
    let q = pose.joints();
    Some(State {
        payload,
        tip_force,
        cylinder_length: length,
        cylinder_velocity: velocity,
        cylinder_force: force,
        q,
        qd: rates,
        dq_dl: pose.rate,
        d2q_dl2: pose.curvature,
        tau: std::array::from_fn(|i| force[i] / pose.rate[i]),
        M: terms.mass,
        gravity: terms.gravity,
        coriolis_and_gravity: std::array::from_fn(|i| terms.coriolis[i] + terms.gravity[i]),
        qdd: std::array::from_fn(|i| pose.rate[i] * acceleration[i] + pose.curvature[i] * velocity[i] * velocity[i]),
        cylinder_acceleration: acceleration,
        tip: [pose.tip.x, pose.tip.z],
        tip_velocity: [tip_velocity.x, tip_velocity.z],
        tip_pitch: q[0] + q[1] + q[3],
        M_cylinder: terms.cylinder_mass(&pose),
    })
}

/// Pins and masses of a file, with these names: `O1` boom foot; `L1`, `L2`, `L3` lengths of boom, arm and bucket; `P1`
/// and `B1` base and rod pin of the boom cylinder, `B2` and `A1` those of the arm cylinder; `R`, `C`, `r`, `k` rocker
/// pin, base of the bucket cylinder, rocker and link; `h` and `kappa` distance and angle of the link pin on the bucket;
/// `boom`, `arm`, `inner`, `bucket` as [mass, x, z, inertia]; `payload` as [.., x, z, ..].
fn parameters(value: &Value, problems: &mut Problems) -> Option<Mechanism> {
    let Some(of) = value.as_object() else {
        return problems.refuse("parameters", shown(Some(value)), "an object with pins and masses");
    };
    let fields = Fields { place: "parameters".to_owned(), of };
    for (key, only) in [("g", GRAVITY), ("branch", -1.0)] {
        if fields.of.contains_key(key) {
            let _ = fields.number(key, only..=only, "", problems);
        }
    }
    let mut pin = |key: &str| fields.numbers(key, "m, [x, z]", problems).map(|[x, z]| Vector::new(x, z));
    let (foot, boom_base, boom_rod, arm_base) = (pin("O1"), pin("P1"), pin("B1"), pin("B2"));
    let (arm_rod, rocker_pin, bucket_base) = (pin("A1"), pin("R"), pin("C"));
    let mut length = |key: &str| fields.number(key, 1e-3..=100.0, "m", problems);
    let (boom_length, arm_length, bucket_length) = (length("L1"), length("L2"), length("L3"));
    let (rocker, link, link_arm) = (length("r"), length("k"), length("h"));
    let angle = fields.number("kappa", -10.0..=10.0, "rad", problems);
    let mut body = |key: &str| {
        let [mass, x, z, inertia] = fields.numbers(key, "[kg, m, m, kg m2]", problems)?;
        if mass < 0.0 || inertia < 0.0 {
            return problems.refuse(&fields.at(key), format!("{mass} kg, {inertia} kg m2"), "numbers from 0 on");
        }
        Some(Body { mass, center: Vector::new(x, z), inertia })
    };
    let (boom, arm, inner, bucket) = (body("boom"), body("arm"), body("inner"), body("bucket"));
    let [_, x, z, _] = fields.numbers("payload", "[kg, m, m, kg m2]", problems)?;
    let payload = Payload { mass: 0.0, center: Vector::new(x, z), radius_of_gyration: PAYLOAD_RADIUS };
    Some(Mechanism {
        geometry: Geometry {
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
        },
        retracted: [0.0; AXES],
        masses: Masses { boom: boom?, arm: arm?, inner: inner?, bucket: bucket?, payload },
    })
}

/// An object of the file, and its place for messages.
struct Fields<'a> {
    place: String,
    of: &'a Map<String, Value>,
}

impl Fields<'_> {
    fn at(&self, key: &str) -> String {
        format!("{}.{key}", self.place)
    }

    /// A list of N numbers; `meaning` says their unit and their order.
    fn numbers<const N: usize>(&self, key: &str, meaning: &str, problems: &mut Problems) -> Option<[f64; N]> {
        let value = self.of.get(key);
        let list = value.and_then(Value::as_array);
        let numbers: Option<Vec<f64>> = list.and_then(|list| list.iter().map(Value::as_f64).collect());
        match numbers.and_then(|numbers| <[f64; N]>::try_from(numbers).ok()) {
            Some(numbers) => Some(numbers),
            None => problems.refuse(&self.at(key), shown(value), &format!("{N} numbers, {meaning}")),
        }
    }

    fn number(
        &self,
        key: &str,
        range: std::ops::RangeInclusive<f64>,
        unit: &str,
        problems: &mut Problems,
    ) -> Option<f64> {
        let value = self.of.get(key);
        match value.and_then(Value::as_f64).filter(|number| range.contains(number)) {
            Some(number) => Some(number),
            None if range.start() == range.end() => {
                problems.refuse(&self.at(key), shown(value), &range.start().to_string())
            }
            None => {
                let allowed = format!("a number from {} to {} {unit}", range.start(), range.end());
                problems.refuse(&self.at(key), shown(value), allowed.trim_end())
            }
        }
    }
}

/// A value of the file in a message.
fn shown(value: Option<&Value>) -> String {
    match value {
        None => "nothing".to_owned(),
        Some(Value::Object(_)) => "an object".to_owned(),
        Some(Value::Array(list)) if list.len() > 2 * AXES => format!("a list of {}", list.len()),
        Some(value) => value.to_string(),
    }
}

/// The accelerations and the teeth as a table, for `--states` without `--json`.
pub fn table_of(answer: &Answer) -> String {
    let rows = answer.states.iter().enumerate().map(|(number, state)| {
        let mut row = vec![number.to_string()];
        row.extend([state.tip[0], state.tip[1]].map(|value| format!("{value:.3}")));
        row.push(format!("{:.1}", state.tip_pitch.to_degrees()));
        row.extend(state.cylinder_acceleration.map(|value| format!("{value:.3}")));
        row
    });
    let header = ["state", "tip x, m", "z, m", "pitch, deg", "boom, m/s2", "arm", "telescope", "bucket"];
    format!(
        "Teeth and accelerations of the cylinders; --json has mass matrix, gravity and all other terms.\n{}\n",
        table(&header, rows.collect())
    )
}
