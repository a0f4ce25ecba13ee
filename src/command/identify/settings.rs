//! The settings of an identification, from the command line and the record.

use std::time::Duration;

use pipeline::{
    hammerstein::{Basis, InputMap, Structure},
    machine::{Estimator, Fuzzy, GREY_BOX_MEMORY, Identification, IdentifiedOutput, Split, shortest_training},
};

use super::{
    arguments::IdentifyArguments,
    held_out::{FIT_PART, HeldOut},
    record::Record,
};
use crate::{arguments::values::Samples, failure::Failure};

/// Prediction horizon of the h-step error without `--horizon`; at least one sample.
const HORIZON: Duration = Duration::from_millis(500);

/// The parts of the structure that the user typed.
#[derive(Debug, Clone, Copy)]
pub struct TypedStructure {
    na: Option<usize>,
    nb: Option<usize>,
    nk: Option<usize>,
    integrator: Option<bool>,
    drift: Option<bool>,
    dead_band: Option<(f64, f64)>,
    /// Order and basis of N: `--order` asks for powers, `--knots` for hinges.
    nonlinearity: Option<(usize, Basis)>,
}

impl TypedStructure {
    /// The parts from the command line.
    ///
    /// # Errors
    /// `--order` is not the number of `--knots`.
    pub fn new(arguments: &IdentifyArguments) -> Result<Self, Failure> {
        let nonlinearity = match (arguments.knots, arguments.order) {
            (None, order) => order.map(|order| (order, Basis::Powers)),
            (Some(knots), order) if order.is_none_or(|order| order == knots.count) => Some((knots.count, knots.basis)),
            (Some(knots), order) => {
                return Err(Failure::usage(format!(
                    "--order: found {} with {} --knots; allowed: {1}, the number of knots, or no --order",
                    order.unwrap_or_default(),
                    knots.count
                )));
            }
        };
        Ok(Self {
            na: arguments.na,
            nb: arguments.nb,
            nk: arguments.nk,
            integrator: arguments.integrator,
            drift: arguments.drift,
            dead_band: arguments.dead_band.map(|band| (band.0, band.1)),
            nonlinearity,
        })
    }

    /// `structure`, with its parts replaced by those that the user typed.
    pub fn over(&self, structure: Structure) -> Structure {
        let (order, basis) = self.nonlinearity.unwrap_or((structure.order, structure.input.basis));
        Structure {
            na: self.na.unwrap_or(structure.na),
            nb: self.nb.unwrap_or(structure.nb),
            nk: self.nk.unwrap_or(structure.nk),
            order,
            integrator: self.integrator.unwrap_or(structure.integrator),
            drift: self.drift.unwrap_or(structure.drift),
            input: InputMap { dead_band: self.dead_band.unwrap_or(structure.input.dead_band), basis },
        }
    }
}

/// All settings. Parts of the structure that the user did not type are those of the paper.
///
/// # Errors
/// The record is too short for the settings, or the settings contradict each other.
pub fn settings(
    arguments: &IdentifyArguments,
    typed: &TypedStructure,
    record: &Record,
) -> Result<Identification, Failure> {
    let rows = record.outputs.len();
    let structure = typed.over(Structure::PAPER);
    let output = if arguments.velocity { IdentifiedOutput::Velocity } else { IdentifiedOutput::Position };
    let training = record.trained.unwrap_or_else(|| arguments.train.of(rows));
    let period = Duration::from_secs_f64(record.period);
    let horizon = match arguments.horizon {
        Some(horizon) => horizon.at(period),
        None => Samples::Duration(HORIZON).at(period).max(1),
    };
    expect_enough_rows(record, structure, output, (training, horizon))?;
    expect_no_rules_for_the_paper(arguments)?;
    let mut fuzzy = match &arguments.fuzzy {
        Some(file) => Fuzzy::load(file).map_err(Failure::usage)?,
        None => Fuzzy::RESIDUALS,
    };
    fuzzy.error_universe = arguments.error_universe.or(fuzzy.error_universe);
    fuzzy.variation_universe = arguments.variation_universe.or(fuzzy.variation_universe);
    let settings = Identification {
        structure,
        output,
        period: record.period,
        training,
        horizon,
        form: arguments.form.into(),
        split: arguments.split.map_or(Split::default_of(arguments.estimator), Split::from),
        estimator: arguments.estimator,
        fuzzy,
        hysteresis: 0.0,
        start: None,
        memory: GREY_BOX_MEMORY,
    };
    check_estimator(&settings)?;
    if arguments.select {
        expect_enough_to_select(record, &settings)?;
    }
    Ok(settings)
}

/// Refuses rules or universes for the estimator `paper`, which has its own.
fn expect_no_rules_for_the_paper(arguments: &IdentifyArguments) -> Result<(), Failure> {
    let typed = [
        ("--fuzzy", arguments.fuzzy.is_some()),
        ("--error-universe", arguments.error_universe.is_some()),
        ("--variation-universe", arguments.variation_universe.is_some()),
    ];
    match typed.into_iter().find(|(_, is_typed)| *is_typed && arguments.estimator == Estimator::Paper) {
        Some((option, _)) => Err(Failure::usage(format!(
            "{option}: found with `--estimator paper`; allowed: with `--estimator rules`, which takes a table and \
             universes"
        ))),
        None => Ok(()),
    }
}

/// Refuses a record that is too short to determine the coefficients, or to test the prediction. `counts` are the rows
/// for training, and the samples of the horizon.
fn expect_enough_rows(
    record: &Record,
    structure: Structure,
    output: IdentifiedOutput,
    (training, horizon): (usize, usize),
) -> Result<(), Failure> {
    if horizon == 0 {
        return Err(Failure::usage("--horizon: found 0 samples; allowed: at least one sample"));
    }
    let (name, rows, coefficients) = (record.name(), record.outputs.len(), structure.full_len());
    let shortest = shortest_training(structure, output);
    let fewer = "(fewer with lower --na, --nb, --order)";
    if training < shortest {
        let option = if record.trained.is_some() { "" } else { " --train:" };
        return Err(Failure::usage(format!(
            "{name}:{option} found {training} of the {rows} rows; allowed: at least {shortest}, to determine \
             {coefficients} coefficients {fewer}"
        )));
    }
    if rows.saturating_sub(training) <= horizon {
        return Err(Failure::usage(format!(
            "{name}: found {rows} rows; allowed: at least {} to test {horizon} samples ahead after {training} for \
             training",
            training.saturating_add(horizon).saturating_add(1)
        )));
    }
    // A row needs so many rows before it, without a gap.
    let past = shortest - coefficients;
    let known = record.stretches().map(|stretch| stretch.end.min(training).saturating_sub(stretch.start + past));
    let known: usize = known.sum();
    if known < coefficients {
        return Err(Failure::usage(format!(
            "{name}: found {known} rows for training with {past} rows before them that have no gap; allowed: at least \
             {coefficients}, to determine as many coefficients {fewer}"
        )));
    }
    let tested = |stretch: std::ops::Range<usize>| stretch.end.saturating_sub(training.max(stretch.start + past));
    let longest = record.stretches().map(tested).max().unwrap_or_default();
    if longest <= horizon {
        return Err(Failure::usage(format!(
            "{name}: found at most {longest} rows for the test without a gap; allowed: at least {}, to test {horizon} \
             samples ahead (fewer with a shorter --horizon)",
            horizon + 1
        )));
    }
    Ok(())
}

/// Refuses a training part that is too short to fit and to judge structures.
fn expect_enough_to_select(record: &Record, settings: &Identification) -> Result<(), Failure> {
    let (training, horizon, coefficients) = (settings.training, settings.horizon, settings.structure.full_len());
    let fewest = HeldOut::fewest_rows(settings);
    if training < fewest {
        return Err(Failure::usage(format!(
            "{}: --select: found {training} rows for training; allowed: at least {fewest}, to fit {coefficients} \
             coefficients on the first {:.0} % of them and to judge {horizon} samples ahead on the rest",
            record.name(),
            100.0 * FIT_PART
        )));
    }
    Ok(())
}

/// Refuses an estimator that cannot work with the other settings.
pub fn check_estimator(settings: &Identification) -> Result<(), Failure> {
    let refusal = |(found, allowed)| Failure::usage(format!("--estimator: found {found}; allowed: {allowed}"));
    settings.check_estimator("NAME", false).map_err(refusal)
}
