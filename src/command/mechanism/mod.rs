//! `hydraxis mechanism`: the machine's linkage in figures, as URDF, and at given states.
//!
//! Runs alone, without a loop.

mod arguments;
mod overload;
mod report;
mod states;
mod urdf;
mod workspace;

use std::{f64::consts::TAU, io::Write};

use mechanism::{AXES, Mechanism, Pose};
use pipeline::machine::Machine;

use crate::{
    arguments::{load_bare, mechanism_only},
    failure::Failure,
    report::output::{Output, OutputError, create, is_stdout, show},
};
pub use arguments::MechanismArguments;
pub use overload::overloads;
use report::MechanismReport;
pub use report::summary;

/// The place of the telescope among the axes.
const TELESCOPE: usize = 2;

/// Runs the command.
pub fn run(arguments: &MechanismArguments) -> Result<(), Failure> {
    let machine = load_bare(&arguments.machine, None)?;
    if let Some(file) = &arguments.states {
        let answer = states::answer(file, &machine)?;
        let output = Output::open(arguments.json.as_deref())?;
        return Ok(output.write(|| states::table_of(&answer), &answer)?);
    }
    let Some(mechanism) = &machine.mechanism else { return Err(Failure::usage(mechanism_only(&arguments.machine))) };
    if let Some(path) = &arguments.urdf {
        if is_stdout(path) && arguments.json.as_deref().is_some_and(is_stdout) {
            return Err(Failure::usage("-: found for --json and --urdf; allowed: one on standard output"));
        }
        let text = urdf::urdf(&machine, mechanism);
        if is_stdout(path) {
            show(&text)?;
        } else {
            let written = create("--urdf", path)?.write_all(text.as_bytes());
            written.map_err(|source| OutputError::Write { option: "--urdf", path: path.clone(), source })?;
        }
    }
    let mut output = Output::open(arguments.json.as_deref())?;
    if arguments.urdf.as_deref().is_some_and(is_stdout) {
        output = output.without_tables();
    }
    let report = MechanismReport::new(&machine, mechanism);
    Ok(output.write(|| report.tables(), &report)?)
}

/// Strokes of the axes of the mechanism, m.
fn strokes(machine: &Machine) -> [f64; AXES] {
    std::array::from_fn(|i| machine.axes[i].stroke)
}

/// Postures on the stroke of one cylinder.
const POSTURES: usize = 100;

/// The poses along the strokes, all cylinders from position 0 to full stroke at once: each joint depends on its own
/// cylinder only.
fn along_strokes(machine: &Machine, mechanism: &Mechanism) -> impl Iterator<Item = Pose> {
    let (prepared, strokes) = (mechanism.prepared(), strokes(machine));
    (0..=POSTURES).map(move |k| prepared.pose(&strokes.map(|stroke| stroke * k as f64 / POSTURES as f64)))
}

/// Joints at position 0 and at full stroke, rad (m for the telescope). Beyond half a turn the angle counts on.
fn joint_ranges(machine: &Machine, mechanism: &Mechanism) -> [[f64; 2]; AXES] {
    let mut joints = along_strokes(machine, mechanism).map(|pose| pose.joints());
    let first = joints.next().unwrap_or_default();
    let last = joints.fold(first, |before, now| {
        std::array::from_fn(
            |i| if i == TELESCOPE { now[i] } else { before[i] + within_half_a_turn(now[i] - before[i]) },
        )
    });
    std::array::from_fn(|i| [first[i], last[i]])
}

/// An angle less the whole turns in it: from -pi to pi, rad.
fn within_half_a_turn(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}
