//! Why the fallback controls an axis, in words, and what to do about it.

use pipeline::machine::ModelChoice;
use pipeline::message::{AxisCommand, ControlMode, REFUSALS, control_flag, model_fault};

/// What each of [`REFUSALS`] says of a model.
const REASONS: [&str; REFUSALS.len()] = [
    "it has coefficients that are no numbers",
    "it has another structure than the machine file",
    "it is unstable",
    "it moves the axis against the command",
    "it cannot reach the speeds that are asked for",
    "it is faster than max_speed",
    "it predicts worse than the model before it",
];

/// Why the fallback controls; none where it does not. `choice`: which model the machine file has chosen, where that is
/// known. `model_faults`: those of the newest snapshot.
pub fn why_fallback(
    name: &str,
    choice: Option<ModelChoice>,
    command: &AxisCommand,
    model_faults: u32,
) -> Option<String> {
    if command.mode != ControlMode::Fallback as u32 {
        return None;
    }
    let has = |flag: u32| command.flags & flag != 0;
    let again = format!("type: hydraxis commission --enable --axis {name}");
    Some(if choice == Some(ModelChoice::None) {
        format!(
            "no model is to control it (axis.{name}.control.model); commissioning says so where none would be better"
        )
    } else if has(control_flag::NO_MODEL) && model_faults & model_fault::TRAINING != 0 {
        format!(
            "the identifier is still training; let the axis move, both ways and at several speeds, for the samples of \
             axis.{name}.identification.training, or commission it: its model then controls while others train"
        )
    } else if has(control_flag::NO_MODEL) {
        "no model has come from ident-proc; hydraxis status shows whether it works".to_owned()
    } else if has(control_flag::CAUTION) {
        format!(
            "the axis swung though its reference did not ask for it; more is tried after 30 s without a swing. Look \
             for air in the oil and for gains that are too high, or {again}"
        )
    } else if has(control_flag::MODEL_TRIAL) {
        "the model is on trial: the fallback controls for some seconds and is compared with it".to_owned()
    } else if has(control_flag::MODEL_WORSE) {
        format!(
            "the model followed worse than the fallback, as a trial has shown; it is tried again later. If this comes \
             back, {again}"
        )
    } else if has(control_flag::MODEL_STALE) {
        "the last model is too old; hydraxis status shows whether ident-proc works".to_owned()
    } else if has(control_flag::MODEL_REFUSED) {
        let refusals = command.rejected_snapshots.iter().zip(REASONS).filter(|(count, _)| **count > 0);
        let reasons: Vec<String> = refusals.map(|(count, reason)| format!("{reason} ({count} times)")).collect();
        let reasons =
            if reasons.is_empty() { "the axis lagged behind under it".to_owned() } else { reasons.join(", ") };
        format!("the model was refused: {reasons}; let the axis move more, or {again}")
    } else {
        format!("a model has just come and is on probation, or axis.{name}.control.model is \"none\"")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_has_words_of_its_own() {
        let fallback = |flags| AxisCommand { mode: ControlMode::Fallback as u32, flags, ..AxisCommand::default() };
        let why = |flags, faults| why_fallback("boom", None, &fallback(flags), faults).unwrap();
        let texts: std::collections::BTreeSet<String> = [
            why(0, 0),
            why_fallback("boom", Some(ModelChoice::None), &fallback(0), 0).unwrap(),
            why(control_flag::NO_MODEL, 0),
            why(control_flag::NO_MODEL, model_fault::TRAINING),
            why(control_flag::MODEL_WORSE, 0),
            why(control_flag::MODEL_TRIAL, 0),
            why(control_flag::CAUTION, 0),
            why(control_flag::MODEL_STALE | control_flag::HALF_SPEED, 0),
            why(control_flag::MODEL_REFUSED, 0),
        ]
        .into();
        assert_eq!(texts.len(), 9);
    }

    #[test]
    fn refusals_are_named_with_their_numbers() {
        let mut command = AxisCommand {
            mode: ControlMode::Fallback as u32,
            flags: control_flag::MODEL_REFUSED,
            ..AxisCommand::default()
        };
        command.rejected_snapshots[2] = 7;
        assert!(why_fallback("boom", None, &command, 0).unwrap().contains("it is unstable (7 times)"));
    }

    #[test]
    fn an_axis_that_the_fallback_does_not_control_needs_no_reason() {
        for mode in [ControlMode::Neutral, ControlMode::Model, ControlMode::Manual] {
            let command = AxisCommand { mode: mode as u32, ..AxisCommand::default() };
            assert_eq!(why_fallback("boom", None, &command, 0), None);
        }
    }
}
