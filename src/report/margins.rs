//! Margins of the loops of an axis, as tables and JSON have them.

use std::time::Duration;

use control_proc::{
    margins::{LEAST_DELAY_MARGIN, LEAST_GAIN_MARGIN, Loop, mean_slope, steepest},
    tuning::rest::RestLoop,
};
use pipeline::machine::{Axis, Commissioned, Control, Law};
use serde::Serialize;

use super::table::table;

/// The loop of one controller of an axis. Figures that are infinite are null in JSON.
#[derive(Debug, Clone, Serialize)]
pub struct LoopMargins {
    /// Name of the axis.
    pub axis: String,
    /// `fallback` or `smith`.
    pub controller: &'static str,
    /// Factor in the gain of the plant at which the loop swings.
    pub gain_margin: f64,
    /// Frequency with which it then swings.
    pub swing_hz: f64,
    /// The gain margin at the mean slope of the curve: all else is at its steepest piece.
    pub mean_gain_margin: f64,
    /// Additional dead time at which the loop swings.
    pub delay_margin_s: f64,
    /// The delay margin as a part of the dead time.
    pub delay_margin: f64,
    /// Phase margin.
    pub phase_margin_degrees: f64,
    /// Ms.
    pub largest_sensitivity: f64,
    /// Highest frequency at which the open loop has a gain of 1.
    pub crossover_hz: f64,
    /// Frequency at which the closed loop has a gain of -3 dB.
    pub bandwidth_hz: f64,
    /// The gain margin of the whole loop about a reference that stands.
    pub rest_gain_margin: f64,
    /// The delay margin of the whole loop about a reference that stands.
    pub rest_delay_margin_s: f64,
    /// Whether the margins, about rest too, are those that commissioning asks for.
    pub is_kept: bool,
}

impl LoopMargins {
    /// The loops of an axis with these settings on this model: the fallback's, and the Smith predictor's where it has
    /// one.
    pub fn of(axis: &Axis, control: &Control, model: &Commissioned, period: Duration) -> Vec<Self> {
        let (period, resolution) = (period.as_secs_f64(), axis.encoder.resolution);
        let row = |controller, law| {
            let control = &Control { law, ..*control };
            let at = |slope| Loop::new(control, model, slope, period).margins();
            let (margins, mean) = (at(steepest(model)), at(mean_slope(model)));
            let rest = RestLoop { control, model, resolution, period }.margins();
            let is_quiet = rest.gain >= LEAST_GAIN_MARGIN && rest.delay >= LEAST_DELAY_MARGIN * model.dead_time;
            Self {
                axis: axis.name.clone(),
                controller,
                gain_margin: margins.gain,
                swing_hz: margins.swing,
                mean_gain_margin: mean.gain,
                delay_margin_s: margins.delay,
                delay_margin: margins.delay_part,
                phase_margin_degrees: margins.phase.to_degrees(),
                largest_sensitivity: margins.sensitivity,
                crossover_hz: margins.crossover,
                bandwidth_hz: margins.bandwidth,
                rest_gain_margin: rest.gain,
                rest_delay_margin_s: rest.delay,
                is_kept: margins.is_kept() && is_quiet,
            }
        };
        let mut loops = vec![row("fallback", Law::Predictive)];
        if matches!(control.law, Law::Smith(_)) {
            loops.push(row("smith", control.law));
        }
        loops
    }

    /// A table of loops.
    pub fn table(loops: &[Self]) -> String {
        let header = Self::header();
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        table(&header, loops.iter().map(Self::row).collect()).to_string()
    }

    /// The header of a table.
    pub fn header() -> Vec<String> {
        let names = [
            "axis",
            "controller",
            "gain margin",
            "at mean slope",
            "delay margin",
            "of dead time",
            "Ms",
            "crossover",
            "bandwidth",
        ];
        let kept = format!("{LEAST_GAIN_MARGIN} and {:.0} %", 100.0 * LEAST_DELAY_MARGIN);
        names.into_iter().map(str::to_owned).chain([kept]).collect()
    }

    /// A row of a table.
    pub fn row(&self) -> Vec<String> {
        vec![
            self.axis.clone(),
            self.controller.to_owned(),
            short(self.gain_margin),
            short(self.mean_gain_margin),
            milliseconds(self.delay_margin_s),
            part(self.delay_margin),
            short(self.largest_sensitivity),
            hertz(self.crossover_hz),
            hertz(self.bandwidth_hz),
            if self.is_kept { "yes" } else { "no" }.to_owned(),
        ]
    }

    /// What is short of the margins that commissioning asks for, in words.
    pub fn found(&self) -> String {
        format!(
            "a gain margin of {} and a delay margin of {}, {} of the dead time; about rest {} and {}",
            short(self.gain_margin),
            milliseconds(self.delay_margin_s),
            part(self.delay_margin),
            short(self.rest_gain_margin),
            milliseconds(self.rest_delay_margin_s)
        )
    }
}

/// A ratio with two decimals.
fn short(value: f64) -> String {
    if value.is_finite() { format!("{value:.2}") } else { "-".to_owned() }
}

/// A part of a dead time, which may be next to nothing.
fn part(value: f64) -> String {
    match 100.0 * value {
        percent if percent > 999.0 => "> 999 %".to_owned(),
        percent if percent.is_finite() => format!("{percent:.0} %"),
        _ => "-".to_owned(),
    }
}

/// A frequency; 0 for none.
fn hertz(frequency: f64) -> String {
    if frequency > 0.0 { format!("{frequency:.2} Hz") } else { "-".to_owned() }
}

fn milliseconds(seconds: f64) -> String {
    if seconds.is_finite() { format!("{:.0} ms", 1e3 * seconds) } else { "-".to_owned() }
}
