//! Given states of the machine, evaluated: `--states`.
//!
//! ```text
//! in    cylinder_length, cylinder_velocity, cylinder_force, payload, tip_force
//! out   M, gravity, coriolis_and_gravity, dq_dl, d2q_dl2, q, qd, qdd, tau, M_cylinder, cylinder_acceleration,
//!       tip, tip_velocity, tip_pitch
//! qdd   = J l'' + J' l'^2          tau = F / J          tip_pitch = q_1 + q_2 + q_4
//! ```
//!
//! Symbols and units are those of the crate `mechanism`; `payload` is the mass in the bucket in kg. A state may have
//! the keys of the answer as well, which are computed anew. A file can have [`parameters`] with pins and masses of its
//! own; without them those of the machine hold.
//!
//! | file | what it holds |
//! |---|---|
//! | `source` | the text of the file, and its JSON |
//! | `fields` | one object of the file, read key by key |
//! | `parameters` | pins and masses of the file |
//!
//! Trap: a linkage can close beyond the strokes of its cylinders. Such states are evaluated with a warning, because
//! the equations hold there; states at which the linkage does not close are refused.

mod fields;
mod parameters;
mod source;

use std::path::Path;

use mechanism::{AXES, Linkage, Masses, Moments, Payload, Vector};
use pipeline::machine::Machine;
use serde::Serialize;
use serde_json::Value;

use super::strokes;
use crate::{failure::Failure, report::table::table};
use fields::{Fields, Notes, shown};
use parameters::Parameters;

/// Heaviest payload, kg.
const HEAVIEST: f64 = 1e6;

/// Longest cylinder, m: twice the largest distance of a pin.
const LONGEST: f64 = 200.0;

/// Fastest cylinder, m/s: that of the machine file.
const FASTEST: f64 = 1e3;

/// Largest force, N: a hundred times that of a cylinder of 1 m2 at 10 MPa.
const STRONGEST: f64 = 1e9;

/// Way beyond a stroke that is none, m: sums of lengths are rounded.
const ROUNDING: f64 = 1e-9;

/// Largest number of problems, and of warnings, that are shown.
const MOST_SHOWN: usize = 30;

/// Names of the cylinders, in the order of the file.
const CYLINDERS: [&str; AXES] = ["boom", "arm", "telescope", "bucket"];

/// Keys of a state: those that are read, and those that the answer adds.
const KEYS: [&str; 19] = [
    "cylinder_length",
    "cylinder_velocity",
    "cylinder_force",
    "payload",
    "tip_force",
    "q",
    "qd",
    "dq_dl",
    "d2q_dl2",
    "tau",
    "M",
    "gravity",
    "coriolis_and_gravity",
    "qdd",
    "cylinder_acceleration",
    "tip",
    "tip_velocity",
    "tip_pitch",
    "M_cylinder",
];

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

/// Evaluates the states of a file, with its parameters or with those of `machine`. Warnings go to standard error.
///
/// # Errors
/// The file cannot be read, or everything that is wrong with it.
pub fn answer(file: &Path, machine: &Machine) -> Result<Answer, Failure> {
    let place = format!("--states: {}", file.display());
    let value = source::read(file).map_err(|problem| Failure::usage(format!("{place}: {problem}")))?;
    let mut notes = Notes::default();
    let answer = read(&value, machine, &mut notes);
    match answer {
        Some(answer) if notes.problems.is_empty() => {
            if !notes.warnings.is_empty() {
                eprintln!("{}", listed(&notes.warnings, &format!("warning: {place}")));
            }
            Ok(answer)
        }
        _ => Err(Failure::usage(listed(&notes.problems, &place))),
    }
}

/// The first [`MOST_SHOWN`] lines with `place` in front, and how many more there are.
fn listed(lines: &[String], place: &str) -> String {
    let shown: Vec<String> = lines.iter().take(MOST_SHOWN).map(|line| format!("{place}: {line}")).collect();
    match lines.len().saturating_sub(MOST_SHOWN) {
        0 => shown.join("\n"),
        more => format!("{}\n{place}: and {more} more", shown.join("\n")),
    }
}

fn read(value: &Value, machine: &Machine, notes: &mut Notes) -> Option<Answer> {
    if let Some(of) = value.as_object() {
        Fields { place: String::new(), of }.expect_only(&["about", "parameters", "states"], notes);
    }
    let allowed = "a list of one or more states";
    let states = match value.get("states").and_then(Value::as_array) {
        Some(states) if !states.is_empty() => states,
        Some(_) => return notes.refuse("states", "an empty list", allowed),
        None => return notes.refuse("states", shown(value.get("states")), allowed),
    };
    let given = value.get("parameters");
    let parameters = match (given, machine.mechanism) {
        (Some(given), _) => parameters::read(given, notes)?,
        (None, Some(mechanism)) => Parameters { mechanism, strokes: Some(strokes(machine)) },
        (None, None) => {
            let allowed = "pins and masses in the file, or a machine with the table [mechanism]";
            return notes.refuse("parameters", "nothing", allowed);
        }
    };
    let evaluator =
        Evaluator { linkage: Linkage::new(&parameters.mechanism.geometry), has_payload: given.is_some(), parameters };
    let mut answers = Vec::with_capacity(states.len());
    for (number, state) in states.iter().enumerate() {
        let place = format!("states[{number}]");
        match state.as_object() {
            Some(state) => answers.extend(evaluator.evaluate(&Fields { place, of: state }, notes)),
            None => notes.refuse(&place, shown(Some(state)), "an object with the values of one state").unwrap_or(()),
        }
    }
    Some(Answer { parameters: given.cloned(), states: answers })
}

/// What all states of a file share.
struct Evaluator {
    linkage: Linkage,
    parameters: Parameters,
    /// Whether a state without a payload has that of the parameters.
    has_payload: bool,
}

impl Evaluator {
    fn evaluate(&self, fields: &Fields, notes: &mut Notes) -> Option<State> {
        fields.expect_only(&KEYS, notes);
        let axes = "in the order boom, arm, telescope, bucket";
        let length = fields.numbers("cylinder_length", -LONGEST..=LONGEST, &format!("m, {axes}"), notes);
        let velocity = fields.numbers("cylinder_velocity", -FASTEST..=FASTEST, &format!("m/s, {axes}"), notes);
        let force = fields.numbers("cylinder_force", -STRONGEST..=STRONGEST, &format!("N, {axes}"), notes);
        let masses = &self.parameters.mechanism.masses;
        let payload = if self.has_payload && !fields.has("payload") {
            Some(masses.payload.mass)
        } else {
            fields.number("payload", 0.0..=HEAVIEST, "kg", notes)
        };
        let tip_force = fields.numbers("tip_force", -STRONGEST..=STRONGEST, "N, [x, z]", notes);
        let (length, velocity, force, payload, tip_force) = (length?, velocity?, force?, payload?, tip_force?);
        self.expect_closed(fields, &length, notes)?;

        let pose = self.linkage.pose(&length);
        let moments = Moments::new(&Masses { payload: Payload { mass: payload, ..masses.payload }, ..*masses });
        let rates = pose.joint_rates(&velocity);
        let terms = moments.dynamics(&pose, &rates);
        let at_tip = Vector::new(tip_force[0], tip_force[1]);
        let Some(acceleration) = terms.of_cylinders(&pose, &velocity, at_tip).acceleration(&force) else {
            let allowed = "masses and inertias that give every joint inertia";
            return notes.refuse(&fields.place, "a mass matrix that is not positive definite", allowed);
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
            qdd: std::array::from_fn(|i| {
                pose.rate[i] * acceleration[i] + pose.curvature[i] * velocity[i] * velocity[i]
            }),
            cylinder_acceleration: acceleration,
            tip: [pose.tip.x, pose.tip.z],
            tip_velocity: [tip_velocity.x, tip_velocity.z],
            tip_pitch: q[0] + q[1] + q[3],
            M_cylinder: terms.cylinder_mass(&pose),
        })
    }

    /// Refuses lengths at which the linkage does not close, and warns of lengths beyond the strokes.
    fn expect_closed(&self, fields: &Fields, length: &[f64; AXES], notes: &mut Notes) -> Option<()> {
        let pose = self.linkage.pose(length);
        // A cylinder has a length, and the bucket pin is beyond the arm pin.
        let least = [0.0, 0.0, -self.parameters.mechanism.geometry.arm_length, 0.0];
        for (i, cylinder) in CYLINDERS.into_iter().enumerate() {
            let place = format!("{}[{i}]", fields.at("cylinder_length"));
            let is_closed = pose.rate[i].is_finite() && pose.curvature[i].is_finite();
            if !is_closed || length[i] <= least[i] {
                let found = format!("{:?} m, with which the linkage of the {cylinder} does not close", length[i]);
                return notes.refuse(&place, found, "lengths at which the pins can be joined");
            }
            let retracted = self.parameters.mechanism.retracted[i];
            let extended = self.parameters.strokes.map_or(f64::INFINITY, |strokes| retracted + strokes[i]);
            if length[i] < retracted - ROUNDING || length[i] > extended + ROUNDING {
                let stroke = format!("beyond the stroke of the {cylinder}, {retracted:.3} to {extended:.3} m");
                notes.warnings.push(format!("{place}: found {:?} m, {stroke}", length[i]));
            }
        }
        Some(())
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
