//! `hydraxis tip`: plans the task of the bucket's teeth and shows it. Nothing moves.
//!
//! Runs alone, without a loop.

mod arguments;
mod picture;
mod report;

use std::{io::Write, path::Path};

use control_proc::tip::TipPlan;
use pipeline::machine::Machine;

use crate::{
    arguments::load_bare,
    command::check,
    failure::Failure,
    report::{
        output::{Output, create, expect_one_stdout, is_stdout, written},
        rows::{CsvRows, field},
    },
};
pub use arguments::TipArguments;
use report::TipReport;

/// Runs the command.
pub fn run(arguments: &TipArguments) -> Result<(), Failure> {
    let mut machine = load_bare(&arguments.machine, None)?;
    if let (Some(payload), Some(mechanism)) = (arguments.payload, &mut machine.mechanism) {
        mechanism.masses.payload.mass = payload;
    }
    let outputs = [("--json", &arguments.json), ("--plot", &arguments.plot), ("--trajectory", &arguments.trajectory)];
    expect_one_stdout(&outputs)?;
    if let Some(path) = arguments.plot.as_deref().filter(|path| !is_stdout(path) && !is_svg(path)) {
        let found = path.display();
        return Err(Failure::usage(format!(
            "--plot: found \"{found}\"; allowed: a file that ends with .svg, or - for standard output"
        )));
    }
    for warning in check::warnings_of_models(&machine) {
        eprintln!("warning: {warning}");
    }
    let plan = TipPlan::of_task(&machine).map_err(Failure::usage)?;
    let Some((plan, account)) = plan.and_then(|plan| plan.account(&machine).map(|account| (plan, account))) else {
        return Err(missing(arguments));
    };
    let mut output = Output::open(arguments.json.as_deref())?;
    if [&arguments.plot, &arguments.trajectory].iter().any(|path| path.as_deref().is_some_and(is_stdout)) {
        output = output.without_tables();
    }
    if let (Some(path), Some(mechanism)) = (&arguments.plot, &machine.mechanism) {
        let svg = picture::picture(&machine, mechanism, &plan, &account);
        let mut file = create("--plot", path)?;
        written("--plot", path, file.write_all(svg.as_bytes()).and_then(|()| file.flush()))?;
    }
    if let Some(path) = &arguments.trajectory {
        let file = create("--trajectory", path)?;
        written("--trajectory", path, write_trajectory(&machine, &plan, file))?;
    }
    let report = TipReport::new(&machine, &plan, &account);
    Ok(output.write(|| report.tables(), &report)?)
}

fn is_svg(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("svg"))
}

fn missing(arguments: &TipArguments) -> Failure {
    Failure::usage(format!(
        "{}: tip: found nothing; allowed: a table [tip] with start, pitch, speed and pieces, beside [mechanism], as \
         examples/excavator.toml has them",
        arguments.machine.name()
    ))
}

/// Teeth and cylinders at every period; each axis has a column of its name, as kind = "trajectory" reads it.
fn write_trajectory(machine: &Machine, plan: &TipPlan, file: Box<dyn Write>) -> std::io::Result<()> {
    let mut rows = CsvRows::new(file);
    let names = machine.axes.iter().map(|axis| axis.name.as_str()).take(mechanism::AXES);
    rows.write(["t", "way", "x", "z", "pitch"].into_iter().chain(names))?;
    for (k, positions) in plan.positions().iter().enumerate() {
        let t = k as f64 * plan.period();
        let place = plan.place(t);
        let teeth = [t, plan.way().travel(plan.length(t)), place.at.x, place.at.z, place.pitch.to_degrees()];
        rows.write(teeth.iter().chain(positions).map(|value| field(*value)))?;
    }
    rows.finish()
}
