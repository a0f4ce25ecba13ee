//! `hydraxis mechanism`: the machine's linkage in figures, as URDF, and at given states.
//!
//! Runs alone, without a loop.

mod arguments;
mod report;
mod states;
mod urdf;
mod workspace;

use std::io::Write;

use mechanism::Mechanism;
use pipeline::machine::Machine;

use crate::{
    arguments::load_bare,
    failure::Failure,
    report::output::{Output, OutputError, create, is_stdout, show},
};
pub use arguments::MechanismArguments;
use report::MechanismReport;
pub use report::summary;

/// Runs the command.
pub fn run(arguments: &MechanismArguments) -> Result<(), Failure> {
    let machine = load_bare(&arguments.machine, None)?;
    if let Some(file) = &arguments.states {
        let answer = states::answer(file, machine.mechanism.as_ref())?;
        let output = Output::open(arguments.json.as_deref())?;
        return Ok(output.write(|| states::table_of(&answer), &answer)?);
    }
    let Some(mechanism) = &machine.mechanism else { return Err(missing(arguments)) };
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

fn missing(arguments: &MechanismArguments) -> Failure {
    let file = arguments.machine.machine.as_ref().map(|file| file.display().to_string());
    Failure::usage(format!(
        "{}: mechanism: found nothing; allowed: the tables [mechanism.boom], .arm, .telescope and .bucket with pins \
         and masses, as examples/excavator.toml has them",
        file.as_deref().unwrap_or("built-in machine")
    ))
}

/// Strokes of the axes of the mechanism, m.
fn strokes(machine: &Machine) -> [f64; mechanism::AXES] {
    std::array::from_fn(|i| machine.axes[i].stroke)
}

/// The poses of the machine at both ends of all strokes.
fn ends(machine: &Machine, mechanism: &Mechanism) -> [mechanism::Pose; 2] {
    let prepared = mechanism.prepared();
    [prepared.pose(&[0.0; mechanism::AXES]), prepared.pose(&strokes(machine))]
}
