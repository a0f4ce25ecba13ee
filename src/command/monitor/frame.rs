//! What a browser gets, as JSON. SI units; times in ns where the name says so.

use mechanism::{AXES, Mechanism, Vector};
use pipeline::{
    channel::Prefix,
    machine::Machine,
    message::{ControlMode, MachineState},
};
use serde::Serialize;

use crate::{
    group::live::unix_ms,
    report::{
        motion::side::Side,
        status::{AxisFigures, StageFigures, StatusReport, TeethNow},
    },
    teeth::can_move,
};

/// Free space around the drawing of the machine, m.
const MARGIN: f64 = 0.6;

/// A value as one line of JSON.
pub fn line(value: &impl Serialize) -> String {
    // Maps here have texts as keys, so it cannot fail; a browser takes an empty object for nothing.
    serde_json::to_string(value).unwrap_or_else(|_| "{}".to_owned())
}

/// Group and machine; or why there are none.
#[derive(Debug, Serialize)]
pub struct Hello {
    version: &'static str,
    /// Number of the attachment: another one says that everything begins anew.
    attachment: u64,
    group: Option<String>,
    /// The page may operate axes.
    controls: bool,
    /// Why there is no group, or no machine.
    why: Option<String>,
    machine: Option<String>,
    period_s: Option<f64>,
    axes: Vec<AxisFacts>,
    /// The machine has teeth, and its axes follow programs, so that a person can move them.
    moves_teeth: bool,
    /// Lowest x, lowest z, highest x, highest z of the drawing, m.
    view: Option<[f64; 4]>,
}

#[derive(Debug, Serialize)]
struct AxisFacts {
    name: String,
    stroke: f64,
    soft_limits: (f64, f64),
}

impl Hello {
    /// No group, for this reason.
    pub fn absent(attachment: u64, why: String, controls: bool) -> Self {
        Self {
            version: env!("HYDRAXIS_VERSION"),
            attachment,
            group: None,
            controls,
            why: Some(why),
            machine: None,
            period_s: None,
            axes: Vec::new(),
            moves_teeth: false,
            view: None,
        }
    }

    /// A group, with its machine or why that is not known.
    pub fn of(attachment: u64, prefix: &Prefix, machine: &Result<Machine, String>, controls: bool) -> Self {
        let known = machine.as_ref().ok();
        let facts = |machine: &Machine| {
            let of_axis = |axis: &pipeline::machine::Axis| AxisFacts {
                name: axis.name.clone(),
                stroke: axis.stroke,
                soft_limits: axis.soft_limits,
            };
            machine.axes.iter().map(of_axis).collect()
        };
        Self {
            group: Some(prefix.to_string()),
            why: machine.as_ref().err().cloned(),
            machine: known.map(|machine| machine.name.clone()),
            period_s: known.map(|machine| machine.timing.period.as_secs_f64()),
            axes: known.map(facts).unwrap_or_default(),
            moves_teeth: known.is_some_and(can_move),
            view: known.and_then(|machine| Some(view(machine.mechanism.as_ref()?, machine))),
            ..Self::absent(attachment, String::new(), controls)
        }
    }
}

/// The rectangle that holds the machine in all poses.
fn view(mechanism: &Mechanism, machine: &Machine) -> [f64; 4] {
    let side = Side::new(mechanism);
    let mut edges = [0.0f64, 0.0, 0.0, 0.0];
    // Each cylinder is at one end, in the middle, or at the other end.
    for pose in 0..3usize.pow(AXES as u32) {
        let part = |axis: usize| (pose / 3usize.pow(axis as u32) % 3) as f64 / 2.0;
        let positions: [f64; AXES] = std::array::from_fn(|i| part(i) * machine.axes[i].stroke);
        for at in side.drawn(&positions).points().filter(|at| at.x.is_finite() && at.z.is_finite()) {
            edges = [edges[0].min(at.x), edges[1].min(at.z), edges[2].max(at.x), edges[3].max(at.z)];
        }
    }
    [edges[0] - MARGIN, edges[1] - MARGIN, edges[2] + MARGIN, edges[3] + MARGIN]
}

#[derive(Debug, Serialize)]
struct Named<'a, T: Serialize> {
    name: &'a str,
    #[serde(flatten)]
    figures: &'a T,
}

/// Axes and pose.
#[derive(Debug, Serialize)]
pub struct AxesFrame<'a> {
    unix_ms: u64,
    tick: Option<u64>,
    /// Age of the newest state of the axes, ns.
    age_ns: Option<u64>,
    axes: Vec<Named<'a, AxisFigures>>,
    pose: Option<PoseFrame>,
    /// Place, pitch, and distance from the way.
    teeth: Option<&'a TeethNow>,
}

/// The machine from the side: points as x and z, m.
#[derive(Debug, Serialize)]
struct PoseFrame {
    bodies: Vec<Vec<[f64; 2]>>,
    cylinders: Vec<Vec<[f64; 2]>>,
    links: Vec<[f64; 2]>,
    tip: [f64; 2],
    /// Where the references put the teeth, while a controller follows them.
    target: Option<[f64; 2]>,
}

impl<'a> AxesFrame<'a> {
    /// The axes of a report.
    pub fn new(report: &'a StatusReport, state: Option<&MachineState>, now_ns: u64, side: Option<&Side>) -> Self {
        Self {
            unix_ms: unix_ms(),
            tick: state.map(|state| state.header.sequence),
            age_ns: state.map(|state| now_ns.saturating_sub(state.header.sent_ns)),
            axes: report.axes().map(|(name, figures)| Named { name, figures }).collect(),
            pose: state.zip(side).and_then(|(state, side)| pose(state, side)),
            teeth: report.teeth(),
        }
    }
}

/// The pose of a state; none where a position of the linkage is unknown.
fn pose(state: &MachineState, side: &Side) -> Option<PoseFrame> {
    let mut positions = [0.0; AXES];
    for (position, axis) in positions.iter_mut().zip(&state.axes) {
        *position = axis.sample.last_plausible()?;
    }
    let follows = |mode: u32| mode == ControlMode::Fallback as u32 || mode == ControlMode::Model as u32;
    let is_followed = state.axes[..AXES].iter().any(|axis| follows(axis.command.mode));
    let references: [f64; AXES] = std::array::from_fn(|i| {
        let command = &state.axes[i].command;
        if follows(command.mode) { command.reference } else { positions[i] }
    });
    let drawn = side.drawn(&positions);
    let all = |points: &[Vec<Vector>]| points.iter().map(|points| pairs(points)).collect();
    Some(PoseFrame {
        bodies: all(&drawn.bodies),
        cylinders: all(&drawn.cylinders),
        links: pairs(&drawn.links),
        tip: pair(&drawn.tip),
        target: is_followed.then(|| pair(&side.tip(&references))),
    })
}

/// x and z in whole mm.
fn pair(at: &Vector) -> [f64; 2] {
    [at.x, at.z].map(|value| (1e3 * value).round() / 1e3)
}

fn pairs(points: &[Vector]) -> Vec<[f64; 2]> {
    points.iter().map(pair).collect()
}

/// Stages with channels and latencies.
#[derive(Debug, Serialize)]
pub struct StagesFrame<'a> {
    stages: Vec<Named<'a, StageFigures>>,
    silent: Vec<&'a str>,
    warnings: &'a [String],
}

impl<'a> StagesFrame<'a> {
    /// The stages of a report.
    pub fn new(report: &'a StatusReport) -> Self {
        Self {
            stages: report.stages().map(|(name, figures)| Named { name, figures }).collect(),
            silent: report.silent(),
            warnings: report.warnings(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_view_holds_the_pose_and_a_pose_needs_all_positions() {
        let machine = Machine::load(None, &[]).unwrap();
        let mechanism = machine.mechanism.unwrap();
        let side = Side::new(&mechanism);
        let [left, bottom, right, top] = view(&mechanism, &machine);
        let mut state = MachineState::default();
        assert!(pose(&state, &side).is_some(), "an axis at 0 without a fault is at 0");
        for (axis, machine) in state.axes.iter_mut().zip(&machine.axes) {
            axis.sample.position = 0.4 * machine.stroke;
        }
        let drawn = pose(&state, &side).unwrap();
        assert!(drawn.target.is_none());
        for [x, z] in drawn.bodies.iter().chain(&drawn.cylinders).flatten() {
            assert!(*x > left && *x < right && *z > bottom && *z < top);
        }
        state.axes[1].command.mode = ControlMode::Model as u32;
        state.axes[1].command.reference = 0.5 * machine.axes[1].stroke;
        assert!(pose(&state, &side).unwrap().target.is_some_and(|target| target != drawn.tip));
        state.axes[2].sample.position = f64::NAN;
        assert!(pose(&state, &side).is_none());
    }

    #[test]
    fn a_group_without_a_known_machine_says_why() {
        let hello = Hello::of(3, &"demo".parse().unwrap(), &Err("no file".to_owned()), false);
        let json: serde_json::Value = serde_json::from_str(&line(&hello)).unwrap();
        assert_eq!((json["group"].as_str(), json["why"].as_str()), (Some("demo"), Some("no file")));
        let json: serde_json::Value = serde_json::from_str(&line(&Hello::absent(1, "none".to_owned(), true))).unwrap();
        assert!(json["group"].is_null() && json["why"] == "none");
    }
}
