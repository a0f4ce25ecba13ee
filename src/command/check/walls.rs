//! Virtual walls that the machine is beyond before anything moves, and axes that they know too little of.

use control_proc::protection::walls::Walls;
use mechanism::AXES;
use pipeline::machine::{Machine, Source};

/// Warnings for a machine with `[walls]`.
pub fn doubtful(machine: &Machine) -> Vec<String> {
    let Some(walls) = Walls::of(machine) else { return Vec::new() };
    let mut warnings = Vec::new();
    let starts: Vec<f64> = machine
        .axes
        .iter()
        .take(AXES)
        .filter_map(|axis| axis.plant.as_ref())
        .map(|plant| plant.initial_position)
        .collect();
    if let (Source::Sim, Ok(positions)) = (&machine.source, <[f64; AXES]>::try_from(starts))
        && let Some((wall, beyond)) = walls.crossed(&positions)
    {
        warnings.push(format!(
            "walls.{wall}: at the start boom, arm or bucket is {beyond:.3} m beyond it; only commands that lead back \
             move the machine"
        ));
    }
    let unknown: Vec<&str> = machine
        .axes
        .iter()
        .take(AXES)
        .filter(|axis| axis.commissioned.is_none())
        .map(|axis| axis.name.as_str())
        .collect();
    if !unknown.is_empty() {
        warnings.push(format!(
            "walls: how {} stops was not measured, 1 s is taken; allowed: a commissioned model (`--model MODEL.toml`)",
            unknown.join(", ")
        ));
    }
    warnings
}
