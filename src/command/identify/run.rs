//! Runs a record through the core of ident-proc and measures the time of an update.

use std::time::Instant;

use ident_proc::Identifier;
use pipeline::machine::Identification;

use super::{record::Record, residuals::Residuals};

/// Samples between two calls of `seen`.
const SAMPLES_PER_CALL: usize = 65_536;

/// Returns the identifier after the record, and the time per sample after training, ns: the update and the errors of
/// all models. `seen` is called now and then with the number of samples so far; `residuals` gets the samples after
/// training.
pub fn identify(
    settings: &Identification,
    record: &Record,
    seen: impl Fn(u64),
    residuals: &mut Residuals,
) -> (Identifier, f64) {
    let mut identifier = Identifier::new(settings);
    residuals.clear(record.outputs.len());
    let mut test_started = Instant::now();
    for (k, y) in record.outputs.iter().enumerate() {
        if k == settings.training {
            test_started = Instant::now();
        }
        // After a gap, the command of the sample before is not known.
        let applied = (!record.begins[k]).then(|| record.inputs[k - 1]);
        identifier.update(Some(*y), applied);
        if let Some(innovations) = identifier.innovations() {
            residuals.push(innovations, record.inputs[k]);
        }
        if k % SAMPLES_PER_CALL == 0 {
            seen(k as u64);
        }
    }
    let elapsed = test_started.elapsed().as_secs_f64();
    let tested = record.outputs.len() - settings.training;
    (identifier, 1e9 * elapsed / tested as f64)
}
