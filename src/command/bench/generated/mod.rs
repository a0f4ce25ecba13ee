//! `hydraxis bench identify`: `auto` against every constant forgetting factor, on records made for it.
//!
//! | module | what it holds |
//! |---|---|
//! | [`class`] | the classes of the records |
//! | [`plant`] | the plant of a record, and how it changes |
//! | [`course`] | what moves the axis |
//! | [`record`] | the record as a logger writes it, and its settings |
//! | [`trial`] | the runs on a record |
//! | [`report`] | tables and JSON |
//!
//! A record depends on the seed and on its number alone. Records with even numbers are for design: whoever changes the
//! estimators may look at them. Those with odd numbers are for judging.

mod class;
mod course;
mod plant;
mod record;
mod report;
mod trial;

use self::{record::Record, report::GeneratedReport, trial::Trial};
use super::{BenchIdentifyArguments, Half, all_cores, parallel};
use crate::{failure::Failure, report::output::Output};

/// Periods of the table of rates, s.
const RATES: [f64; 7] = [record::SHORTEST_PERIOD, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1];
/// Number of the first plant of the table of rates. No set has so many records.
const FIRST_OF_RATES: u64 = 1_000_000;

/// Runs the command.
///
/// # Errors
/// No record is chosen, or an output cannot be written.
pub fn run(arguments: &BenchIdentifyArguments) -> Result<(), Failure> {
    let BenchIdentifyArguments { records: count, seed, half, only, plants, quick, json, threads } = arguments;
    if let Some(number) = only.iter().find(|number| *number >= count) {
        return Err(Failure::usage(format!("--only: found {number}; allowed: 0 to {}", count - 1)));
    }
    let in_half = |number: &u64| half.is_none_or(|half| half.has(*number));
    let numbers: Vec<u64> =
        (0..*count).filter(in_half).filter(|number| only.is_empty() || only.contains(number)).collect();
    if numbers.is_empty() {
        return Err(Failure::usage("--only, --half: found no record; allowed: numbers of the half that was chosen"));
    }
    let plants = if only.is_empty() { *plants } else { 0 };
    let of_rates = (FIRST_OF_RATES..FIRST_OF_RATES + plants).filter(in_half);
    let of_rates: Vec<(u64, f64)> = of_rates.flat_map(|number| RATES.map(|period| (number, period))).collect();
    let output = Output::open(json.as_deref())?;
    let threads = threads.map_or_else(all_cores, usize::from);
    let trials =
        parallel::map(threads, "records", &numbers, |number| Ok(Trial::run(&Record::draw(*seed, *number), !quick)))?;
    let trials_of_rates = parallel::map(threads, "records", &of_rates, |(number, period)| {
        Ok(Trial::run(&Record::at_period(*seed, *number, *period), !quick))
    })?;
    let report = GeneratedReport::new(*seed, half.map(Half::name), trials, trials_of_rates);
    Ok(output.write(|| report.tables(), &report)?)
}

#[cfg(test)]
mod tests;
