//! `hydraxis bench tip`: the simulated excavator's teeth follow lines, slopes and a circle.
//!
//! | task | what the teeth do |
//! |---|---|
//! | `level-still` | 3.5 m towards the machine on the ground, telescope still |
//! | `level` | the same line, the telescope moves |
//! | `slope-in`, `slope-out` | 3.5 m towards the machine, falling by 30 degrees, and rising |
//! | `circle` | a circle of 1 m about [6, -0.5] m |
//! | `dig` | down, along the ground, bucket curled in, up, away and open again |
//!
//! Each task is planned for the machine under its scenario, with the payload in the bucket, and driven by the
//! controller that the machine file says and by its fallback. `--without` adds the fallback with single measures
//! switched off. The error is the distance of the true teeth from the nearest place of the way, its ends
//! included.
//!
//! | module | what it holds |
//! |---|---|
//! | [`task`] | the six tasks |
//! | `drawn` | tasks that are drawn at random |
//! | [`controller`] | what drives them, and the measures |
//! | [`case`] | one run |
//! | [`report`] | the tables |
//! | `picture` | the picture of one task |

mod arguments;
mod case;
mod controller;
mod drawn;
mod picture;
mod report;
mod task;

use std::io::Write;

use pipeline::machine::{Machine, Source};

use super::{closed_loops, expect_closed_loop, parallel};
use crate::{
    arguments::{load_bare, mechanism_only, simulated_only},
    command::check,
    failure::Failure,
    report::output::{Output, create, written},
};
pub use arguments::BenchTipArguments;
use case::Case;
use controller::Controller;
use drawn::DrawnTask;
use picture::{MOST_RUNS, picture};
use report::TipReport;
use task::TipTaskKind;

/// Time of the motion in parts of the planned one: teeth that lag behind slow it.
const PATIENCE: f64 = 1.5;
/// Time in which the axes settle and come to the begin of the way, s: over a whole stroke with half of a slow axis'
/// speed.
const BEFORE: f64 = 45.0;

/// Runs the command.
pub fn run(arguments: &BenchTipArguments) -> Result<(), Failure> {
    let machines = machines(arguments)?;
    for warning in check::warnings_of_models(&machines[0]) {
        eprintln!("warning: {warning}");
    }
    let controllers = Controller::chosen(&arguments.without);
    let cases = match arguments.drawn {
        Some(count) => drawn(count, arguments, &machines, &controllers),
        None => named(arguments, &machines, &controllers),
    };
    if arguments.picture.is_some() && (cases.len() != controllers.len() || cases.len() > MOST_RUNS) {
        return Err(Failure::usage(format!(
            "--picture: found {} runs; allowed: one task, speed, payload, scenario and seed, by at most {MOST_RUNS} \
             controllers",
            cases.len()
        )));
    }
    let output = Output::open(arguments.json.as_deref())?;
    let threads = arguments.threads.map_or_else(super::all_cores, usize::from);
    let drawn_with = arguments.drawn.map(|_| arguments.seed);
    let names = controllers.iter().map(|controller| controller.name).collect();
    let report = TipReport::new(drawn_with, names, parallel::map(threads, "runs", &cases, Case::drive)?);
    if let (Some(file), Some(mechanism)) = (&arguments.picture, &machines[0].mechanism) {
        let rows = report.rows();
        let row = &rows[0];
        let title = format!("{}, {} m/s, {} kg, {}", row.task, row.speed, row.payload, row.scenario);
        let text = picture(mechanism, &title, rows);
        written("--picture", file, create("--picture", file)?.write_all(text.as_bytes()))?;
    }
    Ok(output.write(|| report.tables(), &report)?)
}

/// The chosen ones of the six tasks, at each speed, with each load, under each scenario.
fn named<'m>(arguments: &BenchTipArguments, machines: &'m [Machine], controllers: &[Controller]) -> Vec<Case<'m>> {
    let or = |given: &[f64], all: &[f64]| if given.is_empty() { all.to_vec() } else { given.to_vec() };
    let kinds = if arguments.tasks.is_empty() { TipTaskKind::ALL.to_vec() } else { arguments.tasks.clone() };
    let (speeds, payloads) = (or(&arguments.speeds, &[0.2, 0.35, 0.5]), or(&arguments.payloads, &[0.0, 1e3, 1.5e3]));
    let mut cases = Vec::new();
    for kind in kinds {
        for (speed, payload) in speeds.iter().flat_map(|speed| payloads.iter().map(move |payload| (*speed, *payload))) {
            for (machine, controller) in
                machines.iter().flat_map(|machine| controllers.iter().map(move |by| (machine, *by)))
            {
                let case = |seed| {
                    let (name, task) = (kind.name().to_owned(), kind.task(speed));
                    Case { name, task, payload, machine, controller, seed }
                };
                cases.extend((1..=arguments.seeds).map(case));
            }
        }
    }
    cases
}

/// Tasks that are drawn, each by all controllers.
fn drawn<'m>(
    count: u64,
    arguments: &BenchTipArguments,
    machines: &'m [Machine],
    controllers: &[Controller],
) -> Vec<Case<'m>> {
    let of = |number: u64| {
        let DrawnTask { task, payload, scenario } = DrawnTask::new(arguments.seed, number);
        let machine = &machines[((scenario * machines.len() as f64) as usize).min(machines.len() - 1)];
        let case = move |controller: &Controller| {
            let (name, task, controller) = (number.to_string(), task.clone(), *controller);
            Case { name, task, payload, machine, controller, seed: 1 + number }
        };
        controllers.iter().map(case)
    };
    (0..count).flat_map(of).collect()
}

/// The machine under each of the scenarios.
fn machines(arguments: &BenchTipArguments) -> Result<Vec<Machine>, Failure> {
    let names = match &arguments.scenarios[..] {
        [] => closed_loops().collect(),
        given => given.to_vec(),
    };
    let one = |name: &String| {
        let machine = load_bare(&arguments.machine, Some(name))?.into_twin();
        if machine.source != Source::Sim {
            return Err(Failure::usage(format!("{}, to be controlled", simulated_only(&machine))));
        }
        expect_closed_loop(name, &machine)?;
        if machine.mechanism.is_none() {
            return Err(Failure::usage(mechanism_only(&arguments.machine)));
        }
        check::deep(&machine)?;
        Ok(machine)
    };
    names.iter().map(one).collect()
}
