//! Commands like those of an operator or of a controller.

use std::f64::consts::TAU;

use pipeline::machine::Scenario;

/// Commands of `axes` axes at `time` s: those of the scenario if it has commands.
pub fn commands(scenario: &Scenario, axes: usize, time: f64) -> Vec<f64> {
    let sines = scenario.commands.iter();
    let own: f64 = sines.map(|sine| sine.amplitude * (TAU * sine.frequency * time + sine.phase).sin()).sum();
    (0..axes).map(|axis| if scenario.commands.is_empty() { operator(axis, time) } else { own }).collect()
}

/// Reversals, neutral, slow motion around the dead band, and full strokes into both stops.
///
/// Every axis begins at a different part of this sequence. Each axis therefore meets the changes of a scenario during
/// different commands, and the pump at times feeds one axis and at times has too little flow for four.
fn operator(axis: usize, time: f64) -> f64 {
    let phase = axis as f64;
    let wave = |amplitude: f64, frequency: f64| amplitude * (TAU * frequency * time + phase).sin();
    match (time + 5.0 * phase) % 20.0 {
        ..5.0 => wave(0.5, 0.4) + wave(0.3, 1.1) + wave(0.1, 2.3),
        ..6.0 => 0.0,
        ..9.0 => wave(0.11, 0.35) + wave(0.04, 1.3),
        ..14.5 => 1.0,
        ..15.0 => 0.0,
        _ => -1.0,
    }
}
