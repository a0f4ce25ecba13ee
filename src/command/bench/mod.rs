//! `hydraxis bench control`: the same course with every controller, under every scenario.
//!
//! The machine drives [`control_proc::tuning::course`]: 8 s in which identifiers learn and the fallback controls for all that
//! need a model, then 37 s in which the error of the true position counts, at all ticks and for all controllers alike.
//! An axis that has been latched stands still and its error goes on counting. What the baselines know is the
//! commissioned model; no controller knows the scenario.

mod arguments;
mod cases;
mod parallel;
mod report;

use std::time::Duration;

use pipeline::{
    hammerstein::MAX_DELAY,
    machine::{Machine, Scenario, Source},
};

use super::check;
use crate::{arguments::load_bare, failure::Failure, report::output::Output};
pub use arguments::{Bench, BenchControlArguments};
use cases::{Case, Contest, Kind};
use report::Report;

/// Longest dead time of a simulated valve.
const LONGEST: Duration = Duration::from_millis(500);

/// Runs the command.
pub fn run(arguments: &BenchControlArguments) -> Result<(), Failure> {
    let scenarios = scenarios(arguments)?;
    let kinds = if arguments.controllers.is_empty() { Kind::ALL.to_vec() } else { arguments.controllers.clone() };
    for dead_time in &arguments.dead_time {
        expect_possible(*dead_time, &scenarios[0])?;
    }
    let output = Output::open(arguments.json.as_deref())?;
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let contest = Contest::new(scenarios, &arguments.dead_time, kinds, threads)?;
    let cases = contest.cases(arguments.seeds);
    let outcomes = parallel::map(threads, "runs", &cases, |case: &Case| contest.run(case))?;
    let report = Report::new(&contest, &cases, &outcomes);
    output.write(|| report.tables(), &report)
}

/// The machine under each of the scenarios.
fn scenarios(arguments: &BenchControlArguments) -> Result<Vec<Machine>, Failure> {
    let mut names = arguments.scenarios.clone();
    if names.is_empty() {
        let closed = Scenario::built_in().into_iter().filter(|scenario| scenario.commands.is_empty());
        names.extend(closed.map(|scenario| scenario.name));
    }
    let mut machines = Vec::new();
    for name in names {
        let machine = load_bare(&arguments.machine, Some(&name))?;
        if machine.source != Source::Sim {
            return Err(Failure::Usage("source.kind: found \"replay\"; allowed: \"sim\", to be controlled".to_owned()));
        }
        if !machine.scenario.commands.is_empty() {
            let found = format!("--scenario: found \"{name}\", which commands the valves itself");
            return Err(Failure::Usage(format!("{found}; allowed: scenarios without commands")));
        }
        check::deep(&machine)?;
        machines.push(machine);
    }
    Ok(machines)
}

fn expect_possible(dead_time: Duration, machine: &Machine) -> Result<(), Failure> {
    // One sample more than the dead time is the delay of the model.
    let longest = LONGEST.min(machine.timing.period * (MAX_DELAY as u32 - 1));
    if dead_time <= longest {
        return Ok(());
    }
    let [found, longest] = [dead_time, longest].map(humantime::format_duration);
    Err(Failure::Usage(format!("--dead-time: found {found}; allowed: up to {longest}")))
}
