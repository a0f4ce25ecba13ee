//! `hydraxis bench`: controllers and estimators against each other. [`generated`] is about `bench identify`.
//!
//! `hydraxis bench control`: every controller drives one course, under every scenario, on the simulated machine.
//!
//! The machine drives [`control_proc::tuning::course`]: in the first 8 s the identifiers learn, and the fallback
//! controls for every controller that needs a model. In the next 37 s the error of the true position counts, at every
//! tick and for every controller. A latched axis stands still, and its error counts as well. The baselines are tuned on
//! the commissioned model; no controller knows the scenario.
//!
//! All runs are simulated in this process. Nothing here runs beside a loop in real time.

mod arguments;
mod contest;
mod drawn;
mod generated;
mod parallel;
mod report;
pub mod tip;

use std::time::Duration;

use pipeline::{
    hammerstein::MAX_DELAY,
    machine::{Machine, Scenario, Source},
};

use super::check;
use crate::{
    arguments::{load_bare, simulated_only},
    failure::Failure,
    report::output::Output,
};
pub use arguments::{Bench, BenchControlArguments, BenchIdentifyArguments};
use contest::{Case, Contest, ControllerKind};
use drawn::{Choice, Half};
pub use generated::run as identify;
use report::BenchReport;

/// Longest dead time of a simulated valve.
const LONGEST: Duration = Duration::from_secs(1);

/// Runs the command.
pub fn run(arguments: &BenchControlArguments) -> Result<(), Failure> {
    let threads = arguments.threads.map_or_else(all_cores, usize::from);
    if let Some(count) = arguments.machines {
        let BenchControlArguments { seed, half, only, write, json, wrong_models, .. } = arguments;
        let choice = Choice { count, seed: *seed, half: *half, only: only.clone() };
        if *wrong_models {
            return drawn::run_wrong(&choice, json.as_deref(), threads);
        }
        return drawn::run(&choice, write.as_deref(), json.as_deref(), threads);
    }
    let scenarios = scenarios(arguments)?;
    let kinds =
        if arguments.controllers.is_empty() { ControllerKind::ALL.to_vec() } else { arguments.controllers.clone() };
    for dead_time in &arguments.dead_time {
        expect_possible(*dead_time, &scenarios[0])?;
    }
    for warning in check::warnings(&scenarios[0]).into_iter().chain(check::unstable(&scenarios[0])) {
        eprintln!("warning: {warning}");
    }
    let output = Output::open(arguments.json.as_deref())?;
    let contest = Contest::new(scenarios, &arguments.dead_time, kinds, threads)?;
    let cases = contest.cases(arguments.seeds);
    let results = parallel::map(threads, "runs", &cases, |case: &Case| contest.run(case))?;
    let report = BenchReport::new(&contest, &cases, &results);
    Ok(output.write(|| report.tables(), &report)?)
}

fn all_cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// The machine under each of the scenarios.
fn scenarios(arguments: &BenchControlArguments) -> Result<Vec<Machine>, Failure> {
    let mut names = arguments.scenarios.clone();
    if names.is_empty() {
        names.extend(closed_loops());
    }
    let mut machines = Vec::new();
    for name in names {
        let machine = load_bare(&arguments.machine, Some(&name))?.into_twin();
        if machine.source != Source::Sim {
            return Err(Failure::usage(format!("{}, to be controlled", simulated_only(&machine))));
        }
        expect_closed_loop(&name, &machine)?;
        check::deep(&machine)?;
        check::expect_possible(&machine)?;
        machines.push(machine);
    }
    Ok(machines)
}

/// Refuses the scenario `name` of this machine where it leaves nothing to a controller.
fn expect_closed_loop(name: &str, machine: &Machine) -> Result<(), Failure> {
    if machine.scenario.commands.is_empty() {
        return Ok(());
    }
    let closed: Vec<String> = closed_loops().collect();
    Err(Failure::usage(format!(
        "--scenario: found \"{name}\", which commands the valves itself; allowed: scenarios without commands, as {}",
        closed.join(", ")
    )))
}

/// Names of the built-in scenarios with a controller.
fn closed_loops() -> impl Iterator<Item = String> {
    let closed = Scenario::built_in().into_iter().filter(|scenario| scenario.commands.is_empty());
    closed.map(|scenario| scenario.name)
}

/// Refuses a dead time for which the model has no delay, or that no simulated valve has.
fn expect_possible(dead_time: Duration, machine: &Machine) -> Result<(), Failure> {
    // The delay of the model is one sample more than the dead time.
    let longest = LONGEST.min(machine.timing.period * (MAX_DELAY as u32 - 1));
    if dead_time <= longest {
        return Ok(());
    }
    let [found, longest] = [dead_time, longest].map(humantime::format_duration);
    Err(Failure::usage(format!("--dead-time: found {found}; allowed: up to {longest}")))
}
