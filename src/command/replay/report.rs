//! What a replay has found, as text and as JSON.

use serde::Serialize;

use super::{
    difference::{By, Difference},
    figures::{AxisFigures, PairFigures},
};
use crate::{
    failure::Failure,
    report::table::{number, percent, table},
};

/// A channel that a verification has, or has not, computed.
#[derive(Debug, Serialize)]
pub struct CheckedChannel {
    /// Its name.
    pub channel: &'static str,
    /// Whether its messages are computed.
    pub is_computed: bool,
    /// Messages that were compared.
    pub messages: u64,
}

/// Result of `--verify`.
#[derive(Debug, Serialize)]
pub struct VerifyReport {
    /// Whether all messages are as they were recorded.
    pub identical: bool,
    /// Ticks that were computed.
    pub ticks: u64,
    /// Their time, s.
    pub model_s: f64,
    /// The channels of the loop.
    pub channels: Vec<CheckedChannel>,
    /// Messages of these channels that the recorder has missed: the first of them is a difference.
    pub lost: u64,
    /// The first difference.
    pub difference: Option<Difference>,
    /// Where a damaged recording ends, and why.
    pub damage: Option<String>,
    /// It is whole, or only its end is missing.
    pub is_cut: bool,
}

impl VerifyReport {
    /// All of it for people.
    pub fn text(&self, file: &str) -> String {
        let mut text = damage(self.damage.as_deref());
        if self.lost > 0 {
            text += &format!("warning: {} messages were lost while the run was recorded\n", self.lost);
        }
        let mut counts = Vec::new();
        for CheckedChannel { channel, is_computed, messages } in &self.channels {
            counts.push(match is_computed {
                true => format!("{channel} {messages}"),
                false => format!("{channel} not computed"),
            });
        }
        let (ticks, seconds) = (self.ticks, number(self.model_s));
        match &self.difference {
            None => text += &format!("{file}: {ticks} ticks, {seconds} s: every message is identical\n"),
            Some(Difference { channel, tick, axis, field, recorded, replayed, by }) => {
                let of = axis.as_ref().map(|axis| format!(" (axis {axis})")).unwrap_or_default();
                let by = if *by == By::Replay { "replayed" } else { "by its checksum" };
                text += &format!(
                    "{file}: first difference: {channel}, tick {tick}, {field}{of}: recorded {recorded}, {by} \
                     {replayed}\n"
                );
            }
        }
        text + &format!("compared: {}\n", counts.join(", "))
    }

    /// A failure where there is a difference, or where the recording is damaged before its end.
    ///
    /// # Errors
    /// There is one.
    pub fn verdict(&self) -> Result<(), Failure> {
        match (&self.difference, &self.damage) {
            (None, Some(damage)) if !self.is_cut => {
                Err(Failure::run(format!("the recording is damaged, and was verified up to there only: {damage}")))
            }
            (None, _) => Ok(()),
            (Some(Difference { channel, tick, field, .. }), _) => {
                Err(Failure::run(format!("the replay differs from the recording: {channel}, tick {tick}, {field}")))
            }
        }
    }
}

/// What another estimator, model or controller would have done.
#[derive(Debug, Serialize)]
pub struct CompareReport {
    /// Ticks of the recording.
    pub ticks: u64,
    /// Their time, s.
    pub model_s: f64,
    /// The first tick of the recording: models learn from there.
    pub begins_at_tick: u64,
    /// Figures of each axis.
    pub axes: Vec<AxisFigures>,
    /// Where a damaged recording ends, and why.
    pub damage: Option<String>,
}

impl CompareReport {
    /// All of it for people.
    pub fn text(&self, file: &str) -> String {
        let mut text = damage(self.damage.as_deref());
        text += &format!("{file}: {} ticks, {} s\n", self.ticks, number(self.model_s));
        if self.begins_at_tick > 0 {
            text += &format!(
                "warning: the recording begins at tick {}; identification and controller begin anew there\n",
                self.begins_at_tick
            );
        }
        let errors: Vec<Vec<String>> = self.axes.iter().flat_map(error_rows).collect();
        let header = ["prediction error, mm rms", "steps", "ticks", "was", "now", "change"];
        text += &format!("\n{}\n", table(&header, errors));
        let commands = self.axes.iter().map(command_row).collect();
        let header = ["command, now - was", "ticks", "different", "other mode", "rms", "max", "at tick"];
        text + &format!("\n{}\n", table(&header, commands))
    }
}

fn error_rows(axis: &AxisFigures) -> [Vec<String>; 2] {
    let row = |steps: &str, pair: &PairFigures| {
        let (was, now) = (pair.was_rms.unwrap_or(f64::NAN), pair.now_rms.unwrap_or(f64::NAN));
        let change = percent(100.0 * (now / was - 1.0));
        vec![axis.axis.clone(), steps.to_owned(), pair.ticks.to_string(), number(1e3 * was), number(1e3 * now), change]
    };
    [row("one", &axis.one_step), row("horizon", &axis.h_step)]
}

fn command_row(axis: &AxisFigures) -> Vec<String> {
    let command = &axis.command;
    vec![
        axis.axis.clone(),
        command.ticks.to_string(),
        command.different.to_string(),
        command.other_mode.to_string(),
        number(command.rms.unwrap_or(f64::NAN)),
        number(command.max),
        if command.different > 0 { command.max_tick.to_string() } else { "-".to_owned() },
    ]
}

fn damage(damage: Option<&str>) -> String {
    damage.map(|damage| format!("warning: read as far as it goes: {damage}\n")).unwrap_or_default()
}
