//! The pictures of one axis: what was measured, the model, and the loop.

use std::f64::consts::PI;

use control_proc::{
    commission::modelled,
    margins::{Loop, steepest},
    tuning::step_response,
};
use pipeline::machine::{Control, Law};
use plotters::prelude::{Color, RGBAColor, RGBColor};

use super::super::Found;
use crate::report::{
    chart::{COLOURS, Chart, HALF, Mark, Series, WIDE, tick},
    margins::LoopMargins,
};

/// Time over which a speed is measured, s: short against a stroke, long against the noise of an encoder.
const SPEED_TIME: f64 = 0.1;
/// Lags after which a speed is steady.
const SETTLED: f64 = 3.0;
/// The reference jumps by this much, m: more than what a dead band that is compensated in part leaves of an error.
const STEP: f64 = 0.05;
/// Reactions for which its answer is shown.
const REACTIONS: f64 = 12.0;
/// Points of the frequency response, and how far it goes beyond the crossover, as factors.
const POINTS: usize = 600;
const BEYOND: (f64, f64) = (30.0, 10.0);
/// Where the margins are written: above 0 dB, and below -180 degrees.
const GAIN_NOTE: f64 = 5.0;
const PHASE_NOTE: f64 = -185.0;
const GREY: RGBColor = RGBColor(120, 120, 120);

/// All pictures; without loops where the model is poor.
pub fn all(found: &Found, period: f64) -> Vec<Chart> {
    let mut charts = vec![record(found), curve(found)];
    if let Some(control) = &found.control {
        let laws: Vec<(&LoopMargins, Control, RGBColor)> = (found.loops.iter().zip(COLOURS))
            .map(|(of, colour)| {
                let law = if of.controller == "smith" { control.law } else { Law::Predictive };
                (of, Control { law, ..*control }, colour)
            })
            .collect();
        charts.push(steps(found, &laws, period));
        charts.extend(bode(found, &laws, period));
    }
    charts
}

fn line(name: &str, points: Vec<(f64, f64)>, colour: impl Into<RGBAColor>, width: u32) -> Series {
    Series { name: name.to_owned(), points, colour: colour.into(), mark: Mark::Line(width) }
}

/// Speeds of positions a period apart, m/s: one for each sample from which [`SPEED_TIME`] is left.
fn speeds(positions: &[f64], period: f64) -> (usize, Vec<f64>) {
    let ahead = ((SPEED_TIME / period).round() as usize).max(1);
    let speed = |pair: &[f64]| (pair[ahead] - pair[0]) / (ahead as f64 * period);
    (ahead, positions.windows(ahead + 1).map(speed).collect())
}

/// Speed over command: what was measured while the command stood, and the curve.
fn curve(Found { model, record, .. }: &Found) -> Chart {
    let (ahead, speeds) = speeds(&record.positions, record.period);
    let settled = ((model.dead_time + SETTLED * model.time_constant) / record.period).ceil() as usize;
    let is_steady = |k: usize| {
        let held = &record.commands[k - settled..k + ahead];
        held[0] != 0.0 && held.iter().all(|command| *command == held[0])
    };
    let points: Vec<(f64, f64)> = (settled..speeds.len())
        .filter(|k| speeds[*k].is_finite() && is_steady(*k))
        .map(|k| (record.commands[k], speeds[k]))
        .collect();
    let (low, high) = model.tested();
    let found = (0..=POINTS).map(|i| low + (high - low) * i as f64 / POINTS as f64);
    let found = found.map(|command| (command, model.speed(command))).collect();
    let measured = Series {
        name: "measured while the command stood".to_owned(),
        points,
        colour: COLOURS[0].mix(0.4),
        mark: Mark::Dot(4),
    };
    Chart {
        title: "Speed over command".to_owned(),
        size: HALF,
        labels: ["valve command", "speed, m/s"].map(String::from),
        tick,
        y_tick: None,
        series: vec![measured, line("curve that was found", found, COLOURS[1], 4)],
        notes: Vec::new(),
        frame: None,
    }
}

/// The speed in the experiment, measured and by the model from the commands alone.
fn record(Found { model, record, .. }: &Found) -> Chart {
    let of = |positions: &[f64]| {
        let (ahead, speeds) = speeds(positions, record.period);
        let points = speeds.into_iter().enumerate().step_by(ahead).filter(|(_, speed)| speed.is_finite());
        points.map(|(k, speed)| (k as f64 * record.period, speed)).collect()
    };
    Chart {
        title: "The experiment".to_owned(),
        size: WIDE,
        labels: ["time, s", "speed, m/s"].map(String::from),
        tick,
        y_tick: None,
        series: vec![
            line("measured", of(&record.positions), COLOURS[0], 3),
            line("by the model, from the commands", of(&modelled(record, model)), COLOURS[1], 2),
        ],
        notes: Vec::new(),
        frame: None,
    }
}

/// The answer of the closed loops to a jump of the reference.
fn steps(found: &Found, laws: &[(&LoopMargins, Control, RGBColor)], period: f64) -> Chart {
    let ticks = (REACTIONS * (found.model.reaction() + period) / period).ceil() as usize;
    let end = (ticks - 1) as f64 * period;
    let mut series = vec![line("reference", vec![(0.0, 1e3 * STEP), (end, 1e3 * STEP)], GREY, 2)];
    for (of, control, colour) in laws {
        let positions = step_response(control, &found.model, period, STEP, ticks);
        let points = positions.iter().enumerate().map(|(k, y)| (k as f64 * period, 1e3 * y)).collect();
        series.push(line(of.controller, points, *colour, 4));
    }
    Chart {
        title: "A jump of the reference, on the model".to_owned(),
        size: HALF,
        labels: ["time, s", "position, mm"].map(String::from),
        tick,
        y_tick: None,
        series,
        notes: Vec::new(),
        frame: None,
    }
}

/// Gain and phase of the open loops over frequency, with their margins.
fn bode(found: &Found, laws: &[(&LoopMargins, Control, RGBColor)], period: f64) -> [Chart; 2] {
    let crossovers = || laws.iter().map(|(of, ..)| of.crossover_hz).filter(|crossover| *crossover > 0.0);
    let middle = crossovers().fold(f64::INFINITY, f64::min);
    let low = if middle.is_finite() { middle / BEYOND.0 } else { 0.01 / found.model.reaction().max(period) };
    let high = (crossovers().fold(10.0 * low, f64::max) * BEYOND.1).min(0.5 / period);
    let (mut gains, mut phases, mut notes) = (Vec::new(), Vec::new(), [Vec::new(), Vec::new()]);
    for (of, control, colour) in laws {
        let open = Loop::new(control, &found.model, steepest(&found.model), period);
        let frequencies = (0..=POINTS).map(|i| low * (high / low).powf(i as f64 / POINTS as f64));
        let values: Vec<_> = frequencies.map(|frequency| (frequency.log10(), open.open(frequency))).collect();
        let gain = values.iter().map(|(x, value)| (*x, decibels(value.norm()))).collect();
        gains.push(line(of.controller, gain, *colour, 4));
        let mut phase = values[0].1.arg();
        if phase > 0.0 {
            phase -= 2.0 * PI;
        }
        let turned = values.windows(2).map(|pair| {
            phase += (pair[1].1 / pair[0].1).arg();
            (pair[1].0, phase.to_degrees())
        });
        phases.push(line(of.controller, turned.collect(), *colour, 4));
        if of.swing_hz > 0.0 && of.gain_margin.is_finite() {
            let at = of.swing_hz.log10();
            gains.push(line("", vec![(at, decibels(1.0 / of.gain_margin)), (at, 0.0)], *colour, 6));
            notes[0].push(((at, GAIN_NOTE), format!(" gain margin {:.2}", of.gain_margin)));
        }
        if of.crossover_hz > 0.0 {
            let (at, margin) = (of.crossover_hz.log10(), of.phase_margin_degrees);
            phases.push(line("", vec![(at, margin - 180.0), (at, -180.0)], *colour, 6));
            let text = format!(" {margin:.0} degrees, {:.0} ms", 1e3 * of.delay_margin_s);
            notes[1].push(((at, PHASE_NOTE), text));
        }
    }
    let edge = |y: f64| line("", vec![(low.log10(), y), (high.log10(), y)], GREY, 2);
    gains.insert(0, edge(0.0));
    phases.insert(0, edge(-180.0));
    let chart = |title: &str, label, series, notes| Chart {
        title: title.to_owned(),
        size: HALF,
        labels: ["frequency, Hz", label].map(String::from),
        tick: |exponent| tick(&10f64.powf(*exponent)),
        y_tick: None,
        series,
        notes,
        frame: None,
    };
    let [gain_notes, phase_notes] = notes;
    [
        chart("Open loop: gain", "gain, dB", gains, gain_notes),
        chart("Open loop: phase, margins in phase and dead time", "phase, degrees", phases, phase_notes),
    ]
}

fn decibels(gain: f64) -> f64 {
    20.0 * gain.log10()
}
