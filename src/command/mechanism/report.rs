//! The figures of a mechanism: where it reaches, its joints, and what its cylinders feel.

use std::fmt::Write;

use mechanism::{AXES, Mechanism, Moments, Vector};
use pipeline::machine::Machine;
use serde::Serialize;

use super::{
    TELESCOPE, along_strokes, joint_ranges, strokes,
    workspace::{Felt, Spread, Workspace, frequencies_at},
};
use crate::report::table::table;

/// The figures.
#[derive(Debug, Serialize)]
pub struct MechanismReport {
    machine: String,
    /// kg.
    payload: f64,
    /// With the telescope in, half out and out.
    extents: Vec<ExtentReport>,
    axes: Vec<AxisReport>,
    /// Natural frequencies of the coupled cylinders in the posture of the start, Hz.
    start_frequencies: Option<[f64; AXES]>,
    workspace: Option<Workspace>,
}

/// Farthest places of the teeth, m.
#[derive(Debug, Serialize)]
struct ExtentReport {
    telescope: f64,
    reach: f64,
    depth: f64,
    height: f64,
}

/// One cylinder and its joint.
#[derive(Debug, Serialize)]
struct AxisReport {
    name: String,
    /// Joint at position 0 and at full stroke, rad; m for the telescope.
    joint: [f64; 2],
    /// Smallest and largest moment arm over the stroke, m; none for the telescope.
    moment_arm: Option<[f64; 2]>,
    rest: Rest,
    #[serde(flatten)]
    felt: Option<Felt>,
}

/// What holds a cylinder at rest.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Rest {
    /// Where: the position at the start, or the middle of the stroke without a simulated plant, m.
    pub position: f64,
    /// N.
    pub force: f64,
    /// Pressure of the side that carries the force, with none on the other side, Pa; none without a simulated plant.
    pub pressure: Option<f64>,
}

/// Reach, depth, joint ranges and the load at rest in three lines.
pub fn summary(machine: &Machine, mechanism: &Mechanism) -> String {
    let report = MechanismReport::of_strokes(machine, mechanism);
    let [inside, _, outside] = &report.extents[..] else { unreachable!("three lengths of the telescope") };
    let of_axes = |of: fn(&AxisReport) -> String| {
        let all: Vec<String> = report.axes.iter().map(|axis| format!("{} {}", axis.name, of(axis))).collect();
        all.join(", ")
    };
    let rest = |axis: &AxisReport| {
        let pressure = axis.rest.pressure.map(|pressure| format!(" ({:.1} MPa)", pressure / 1e6));
        format!("{} kN{}", kilonewtons(axis.rest.force), pressure.unwrap_or_default())
    };
    format!(
        "mechanism: the teeth reach {:.1} m forward and {:.1} m deep, {:.1} and {:.1} m with the telescope out\n\
         joints: {}\nload at rest, {:.0} kg in the bucket: {}\n",
        inside.reach,
        inside.depth,
        outside.reach,
        outside.depth,
        of_axes(AxisReport::joint),
        report.payload,
        of_axes(rest)
    )
}

/// Positions at the start, m; without a simulated plant those in the middle of the strokes.
fn start(machine: &Machine) -> [f64; AXES] {
    std::array::from_fn(|i| {
        let axis = &machine.axes[i];
        axis.plant.as_ref().map_or(0.5 * axis.stroke, |plant| plant.initial_position)
    })
}

/// The load at rest of each cylinder of the mechanism.
fn at_rest(machine: &Machine, mechanism: &Mechanism) -> [Rest; AXES] {
    let positions = start(machine);
    let pose = mechanism.prepared().pose(&positions);
    let terms = Moments::new(&mechanism.masses).dynamics(&pose, &[0.0; AXES]);
    let force = terms.holding_force(&pose, Vector::default());
    std::array::from_fn(|i| {
        let plant = machine.axes[i].plant.as_ref();
        let area = |plant: &pipeline::machine::Plant| if force[i] > 0.0 { plant.piston_area } else { plant.rod_area };
        Rest { position: positions[i], force: force[i], pressure: plant.map(|plant| force[i].abs() / area(plant)) }
    })
}

impl MechanismReport {
    /// Evaluates the mechanism over strokes and workspace.
    pub fn new(machine: &Machine, mechanism: &Mechanism) -> Self {
        let mut report = Self::of_strokes(machine, mechanism);
        report.workspace = Workspace::new(machine, mechanism);
        report.start_frequencies = frequencies_at(machine, mechanism, &start(machine));
        if let Some(workspace) = &report.workspace {
            for (axis, felt) in report.axes.iter_mut().zip(&workspace.cylinders) {
                axis.felt = Some(*felt);
            }
        }
        report
    }

    /// Evaluates the mechanism over the strokes only.
    fn of_strokes(machine: &Machine, mechanism: &Mechanism) -> Self {
        let (prepared, stroke) = (mechanism.prepared(), strokes(machine));
        let extents = [0.0, 0.5, 1.0].map(|part| {
            let telescope = part * stroke[2];
            let extent = prepared.extent(&[0.0; AXES], &stroke, telescope);
            ExtentReport { telescope, reach: extent.reach, depth: extent.depth, height: extent.height }
        });
        let joints = joint_ranges(machine, mechanism);
        let rest = at_rest(machine, mechanism);
        let axes = (0..AXES).map(|i| {
            let arms = along_strokes(machine, mechanism).map(|pose| pose.rate[i].abs().recip());
            let moment_arm =
                arms.fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], arm| [low.min(arm), high.max(arm)]);
            AxisReport {
                name: machine.axes[i].name.clone(),
                joint: joints[i],
                moment_arm: (i != TELESCOPE).then_some(moment_arm),
                rest: rest[i],
                felt: None,
            }
        });
        Self {
            machine: machine.name.clone(),
            payload: mechanism.masses.payload.mass,
            extents: extents.into(),
            axes: axes.collect(),
            start_frequencies: None,
            workspace: None,
        }
    }

    /// The figures as tables.
    pub fn tables(&self) -> String {
        let mut text = format!("{}, {:.0} kg in the bucket.\n\n", self.machine, self.payload);
        text += "Farthest places of the teeth, m: forward of the centre of swing, below and above ground\n";
        let rows = self.extents.iter().map(|at| [at.telescope, at.reach, at.depth, at.height]);
        let rows = rows.map(|row| row.map(|value| format!("{value:.2}")).to_vec());
        text += &format!("{}\n\n", table(&["telescope", "reach", "depth", "height"], rows.collect()));
        text += "Joints and moment arms over the stroke, and the load at rest at the start\n";
        let rows = self.axes.iter().map(AxisReport::row).collect();
        let header = ["axis", "joint", "moment arm, m", "position, m", "force, kN", "pressure, MPa"];
        text += &format!("{}\n\n", table(&header, rows));
        text + &self.workspace_table()
    }

    fn workspace_table(&self) -> String {
        let Some(workspace) = &self.workspace else {
            return "Within the soft limits the teeth are under the machine everywhere.\n".to_owned();
        };
        let mut text = format!(
            "What each cylinder feels in {} postures within the soft limits: 5, 50 and 95 % are below\n",
            workspace.postures
        );
        let rows = self.axes.iter().filter_map(|axis| {
            let felt = axis.felt.as_ref()?;
            let frequency =
                |spread: &Option<Spread>| spread.as_ref().map_or("-".to_owned(), |spread| three(spread, 1.0));
            Some(vec![
                axis.name.clone(),
                three(&felt.reflected_mass, 1e-3),
                three(&felt.gravity, 1e-3),
                frequency(&felt.natural_frequency),
                frequency(&felt.ideal_frequency),
                three(&felt.tip_ratio, 1.0),
            ])
        });
        let header = ["axis", "mass, t", "gravity, kN", "natural frequency, Hz", "ideal, Hz", "teeth, mm per mm"];
        text += &format!("{}\n", table(&header, rows.collect()));
        if let Some(modes) = &workspace.coupled_frequencies {
            let modes: Vec<String> = modes.iter().map(|mode| three(mode, 1.0)).collect();
            let _ = writeln!(text, "Coupled, with all valves shut, Hz: {}", modes.join("; "));
        }
        if let Some(modes) = &self.start_frequencies {
            let _ = writeln!(text, "Coupled, in the posture of the start, Hz: {}", modes.map(digits).join("; "));
        }
        text + LEGEND
    }
}

/// What the columns mean.
const LEGEND: &str = "
mass               mass that the cylinder moves while the other cylinders are held
gravity            force that carries the load at rest; positive: the piston side carries it
natural frequency  of this mass on the oil of chambers and hoses at the pressures at rest, with the valve shut
ideal              natural frequency on the oil of the chambers alone, at 5 MPa
teeth              way of the teeth per way of this piston
";

impl AxisReport {
    /// The range of the joint.
    fn joint(&self) -> String {
        let [from, to] = self.joint;
        match self.moment_arm {
            Some(_) => format!("{:.1} .. {:.1} deg", from.to_degrees(), to.to_degrees()),
            None => format!("{from:.2} .. {to:.2} m"),
        }
    }

    fn row(&self) -> Vec<String> {
        let moment_arm = self.moment_arm.map_or("-".to_owned(), |[low, high]| format!("{low:.3} .. {high:.3}"));
        let rest = &self.rest;
        let pressure = rest.pressure.map_or("-".to_owned(), |pressure| format!("{:.1}", pressure / 1e6));
        let (position, force) = (format!("{:.2}", rest.position), kilonewtons(rest.force));
        vec![self.name.clone(), self.joint(), moment_arm, position, force, pressure]
    }
}

/// The three values times `unit`, with three digits.
fn three(spread: &Spread, unit: f64) -> String {
    [spread.p5, spread.p50, spread.p95].map(|value| digits(value * unit)).join(" / ")
}

/// A force in kN, without a sign where it rounds to zero.
fn kilonewtons(force: f64) -> String {
    format!("{:.0}", (force / 1e3).round() + 0.0)
}

fn digits(value: f64) -> String {
    let decimals = match value.abs() {
        0.0..9.995 => 2,
        9.995..99.95 => 1,
        _ => 0,
    };
    format!("{value:.decimals$}")
}
