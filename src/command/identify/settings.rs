//! What to identify, from what was typed and what the record is.

use std::time::Duration;

use pipeline::{
    hammerstein::{Basis, InputMap, Structure},
    machine::{Fuzzy, Identification, IdentifiedOutput, shortest_training},
};
use sensor_proc::record::{Record, RecordError};

use super::{
    arguments::IdentifyArguments,
    held_out::{FIT_PART, HeldOut},
};
use crate::{arguments::values::Samples, failure::Failure};

/// How far ahead the h-step error looks unless it is said; at least one sample.
const HORIZON: Duration = Duration::from_millis(500);

/// What of the structure was typed.
#[derive(Debug, Clone, Copy)]
pub struct Typed {
    na: Option<usize>,
    nb: Option<usize>,
    nk: Option<usize>,
    integrator: Option<bool>,
    drift: Option<bool>,
    dead_band: Option<(f64, f64)>,
    /// Order and basis of N: `--order` asks for powers, `--knots` for hinges.
    nonlinearity: Option<(usize, Basis)>,
}

impl Typed {
    /// From the command line.
    pub fn new(arguments: &IdentifyArguments) -> Result<Self, Failure> {
        let nonlinearity = match (arguments.knots, arguments.order) {
            (None, order) => order.map(|order| (order, Basis::Powers)),
            (Some(knots), order) if order.is_none_or(|order| order == knots.count) => Some((knots.count, knots.basis)),
            (Some(knots), order) => {
                return Err(Failure::Usage(format!(
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

    /// `structure` with what was typed in the place of its own.
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

/// All settings, with the paper's structure where nothing was typed.
pub fn settings(arguments: &IdentifyArguments, typed: &Typed, record: &Record) -> Result<Identification, Failure> {
    let rows = record.outputs.len();
    let structure = typed.over(Structure::PAPER);
    let output = if arguments.velocity { IdentifiedOutput::Velocity } else { IdentifiedOutput::Position };
    let training = arguments.train.of(rows);
    let period = Duration::from_secs_f64(record.period);
    let horizon = match arguments.horizon {
        Some(horizon) => horizon.at(period),
        None => Samples::Duration(HORIZON).at(period).max(1),
    };
    if horizon == 0 {
        return Err(Failure::usage("--horizon: found 0 samples; allowed: at least one sample"));
    }
    let coefficients = structure.full_len();
    let shortest = shortest_training(structure, output);
    if training < shortest {
        return Err(Failure::Usage(format!(
            "{}: --train: found {training} of the {rows} rows; allowed: at least {shortest}, to determine {coefficients} \
             coefficients (fewer with lower --na, --nb, --order)",
            arguments.data.display()
        )));
    }
    if rows.saturating_sub(training) <= horizon {
        return Err(Failure::usage(RecordError::TooFewRows {
            file: arguments.data.clone(),
            rows,
            needed: training.saturating_add(horizon).saturating_add(1),
            why: format!("to test {horizon} samples ahead after {training} for training"),
        }));
    }
    let mut fuzzy = match &arguments.fuzzy {
        Some(file) => Fuzzy::load(file).map_err(Failure::usage)?,
        None => Fuzzy::PAPER,
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
        split: arguments.split.into(),
        estimator: arguments.estimator,
        fuzzy,
    };
    check_estimator(&settings)?;
    let fewest = HeldOut::fewest_rows(&settings);
    if arguments.select && training < fewest {
        return Err(Failure::Usage(format!(
            "{}: --select: found {training} rows for training; allowed: at least {fewest}, to fit {coefficients} \
             coefficients on the first {:.0} % of them and to judge {horizon} samples ahead on the rest",
            arguments.data.display(),
            100.0 * FIT_PART
        )));
    }
    Ok(settings)
}

/// A window shorter than the coefficients of its structure determines none of them.
pub fn check_estimator(settings: &Identification) -> Result<(), Failure> {
    let refusal = |(found, allowed)| Failure::Usage(format!("--estimator: found {found}; allowed: {allowed}"));
    settings.check_estimator("NAME", false).map_err(refusal)
}
