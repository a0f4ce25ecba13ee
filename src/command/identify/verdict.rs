//! Whether the adaptive model of a recording is usable, and why not.
//!
//! ```text
//! worse than holding still  <=>  E >= rmse of y(k) - y(k-h)
//! no effect within horizon  <=>  E >= 0.95 E_y
//! ```
//!
//! E rmse of y(k) - y(k | k-h), y output, h horizon; the prediction is that of the published model. E_y rmse of
//! the best prediction from the past outputs alone ([`without_commands`]). Traps: the reduction compares the adaptive
//! model with the classical one only. Against a classical model that has lost the axis every model looks good. Holding
//! still is beaten by any model of a smooth output, also by one whose commands are those of another axis.

use console::style;
use ident_proc::Identifier;
use pipeline::{machine::Identification, message::model_fault};
use serde::Serialize;

use super::{
    record::Record,
    standing::LARGEST_STANDING,
    wild::{WildCommand, wildest},
};
use crate::{
    model::without_commands,
    report::table::{number, percent},
};

/// Largest part of the rows that may be outliers, or have an irregular time.
const LARGEST_PART: f64 = 0.01;
/// Least number of predictions that an error rests on: that of 30 errors is known to about an eighth.
const LEAST_PREDICTIONS: u64 = 30;
/// E in parts of E_y from which on the commands explain nothing: a tenth of what the past outputs leave.
const NO_EFFECT: f64 = 0.95;

/// The verdict, as JSON has it.
#[derive(Debug, Serialize)]
pub struct Verdict {
    usable: bool,
    reasons: Vec<Reason>,
    /// h-step rmse of the adaptive model, as published, over that of holding still.
    to_holding_still: f64,
    /// h-step rmse of the adaptive model over that of the best prediction from the past outputs alone; none where there
    /// are too few rows, and for a model from another record.
    #[serde(skip_serializing_if = "Option::is_none")]
    to_past_outputs: Option<f64>,
    /// The largest command, where it is wild.
    #[serde(skip_serializing_if = "Option::is_none")]
    wild_command: Option<WildCommand>,
}

/// Why a model is not usable.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Reason {
    /// A prediction grows more than e-fold over the horizon, or a coefficient is not finite.
    Unstable,
    /// The model predicts no better than the last output.
    WorseThanHoldingStill,
    /// The model predicts no better than the past outputs do without any command: the command has no effect, or none
    /// that shows within the horizon.
    NoEffect,
    /// Fewer commands of the training open the valve than there are coefficients, or the output never changes.
    NotExcited,
    /// The training does not determine every coefficient.
    RankDeficient,
    /// The output stands in more than [`LARGEST_STANDING`] of the rows though the command moves it elsewhere.
    StandingOutput,
    /// A command is far beyond all others ([`super::wild`]).
    WildCommand,
    /// More outliers than [`LARGEST_PART`] of the rows.
    Outliers,
    /// Fewer than [`LEAST_PREDICTIONS`] predictions over the horizon: the record is short, or has many gaps.
    FewPredictions,
    /// The period changes, or more steps of time than [`LARGEST_PART`] of the rows are too short or do not rise.
    IrregularTime,
}

impl Verdict {
    /// The verdict after the last sample.
    pub fn new(settings: &Identification, record: &Record, identifier: &Identifier) -> Self {
        let snapshot = identifier.snapshot();
        let (still, model) = (snapshot.persistence.rmse(), snapshot.adaptive_errors.h_step.rmse());
        let opens = |u: &&f64| settings.structure.input.opening(**u) != 0.0;
        let opened = record.inputs[..settings.training].iter().filter(opens).count();
        let stands = record.outputs.iter().all(|y| *y == record.outputs[0]);
        let many = |rows: f64| rows > LARGEST_PART * record.outputs.len() as f64;
        let fault = |bits| snapshot.faults & bits != 0;
        let wild_command = wildest(&record.inputs);
        // False where the prediction is not finite.
        let is_better = model < still;
        let found = [
            (Reason::WildCommand, wild_command.is_some()),
            (Reason::Unstable, fault(model_fault::UNSTABLE | model_fault::NOT_FINITE)),
            (Reason::WorseThanHoldingStill, !stands && !is_better),
            (Reason::NotExcited, stands || opened < settings.structure.full_len()),
            (Reason::RankDeficient, fault(model_fault::RANK_DEFICIENT)),
            (Reason::StandingOutput, record.standing(settings.horizon) > LARGEST_STANDING),
            (Reason::Outliers, many(snapshot.outliers as f64)),
            (Reason::FewPredictions, !stands && snapshot.adaptive_errors.h_step.count < LEAST_PREDICTIONS),
            (Reason::IrregularTime, record.is_irregular(LARGEST_PART)),
        ];
        let outputs = record.identified(settings.output);
        let (outputs, begins) = (&outputs[settings.training..], &record.begins[settings.training..]);
        let past = without_commands::rmse(outputs, begins, settings.horizon, settings.structure.na);
        let verdict = Self { wild_command, ..Self::of(found, model / still) };
        verdict.beside_past_outputs(past.map(|past| model / past))
    }

    /// The verdict from the reasons that hold among those `found`, and from the error over that of holding still.
    pub fn of(found: impl IntoIterator<Item = (Reason, bool)>, to_holding_still: f64) -> Self {
        let reasons: Vec<Reason> = found.into_iter().filter(|(_, holds)| *holds).map(|(reason, _)| reason).collect();
        Self { usable: reasons.is_empty(), reasons, to_holding_still, to_past_outputs: None, wild_command: None }
    }

    /// This verdict beside the best prediction from the past outputs alone, with the error of the model over
    /// that of this prediction.
    fn beside_past_outputs(mut self, to_past_outputs: Option<f64>) -> Self {
        self.to_past_outputs = to_past_outputs;
        // Another reason says more: a model that is worse than holding still is worse than the past outputs as well.
        if self.usable && to_past_outputs.is_some_and(|part| part >= NO_EFFECT) {
            self.reasons.push(Reason::NoEffect);
            self.usable = false;
        }
        self
    }

    /// Whether the model is usable.
    pub fn is_usable(&self) -> bool {
        self.usable
    }

    /// The verdict as a line, whose first words are coloured on a terminal. `ahead` is the horizon.
    pub fn line(&self, ahead: &str) -> String {
        let (word, rest) = self.words(ahead);
        let word = if self.usable { style(word).green() } else { style(word).red() };
        format!("{}: {rest}\n", word.bold())
    }

    /// The verdict, and what it rests on.
    pub fn words(&self, ahead: &str) -> (&'static str, String) {
        let ratio = self.to_holding_still;
        if self.usable {
            return (
                "usable",
                format!("{ahead} ahead the error is {} of that of holding still", percent(100.0 * ratio)),
            );
        }
        let reason = |reason: &Reason| {
            match reason {
            Reason::Unstable => "unstable".to_owned(),
            Reason::WorseThanHoldingStill if ratio.is_finite() => {
                format!("worse than holding still ({} times its error {ahead} ahead)", number(ratio))
            }
            Reason::WorseThanHoldingStill => "worse than holding still".to_owned(),
            Reason::NoEffect => format!(
                "the past positions alone predict as well {ahead} ahead; is it the command of this axis? Is the \
                 --horizon long enough for it to move the axis?"
            ),
            Reason::NotExcited => "not excited".to_owned(),
            Reason::RankDeficient => "rank-deficient".to_owned(),
            Reason::StandingOutput => "the output stands while it is driven: a stuck sensor, or an end stop".to_owned(),
            Reason::WildCommand => self.wild_command.map_or_else(String::new, |WildCommand { row, command, others }| {
                let (found, others) = (number(command), number(others));
                format!(
                    "a wild command ({found} in row {row}, nearly all others within {others}: mend this row, or leave \
                     its command empty)"
                )
            }),
            Reason::Outliers => "outliers".to_owned(),
            Reason::FewPredictions => format!("fewer than {LEAST_PREDICTIONS} predictions {ahead} ahead"),
            Reason::IrregularTime => "irregular time".to_owned(),
        }
        };
        ("not usable", self.reasons.iter().map(reason).collect::<Vec<_>>().join(", "))
    }
}
