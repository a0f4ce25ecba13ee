//! A structure in words, and as the options that choose it.

use pipeline::{
    hammerstein::{Basis, InputMap, Structure},
    machine::IdentifiedOutput,
};

/// The orders of a structure, and its parts that differ from the paper.
pub fn description(structure: &Structure, output: IdentifiedOutput) -> String {
    let Structure { na, nb, nk, order, .. } = structure;
    let mut text = format!("na {na}, nb {nb}, nk {nk}, order {order}");
    let (low, high) = structure.input.dead_band;
    if structure.integrator {
        text += ", integrator";
    }
    if structure.drift {
        text += ", drift";
    }
    if (low, high) != InputMap::PAPER.dead_band {
        let sign = if low > 0.0 { "-" } else { "" };
        text += &format!(", dead band {sign}{low} to {high}");
    }
    if let Some(knots) = knots(structure) {
        text += &format!(", knots {}", knots.join(" "));
    }
    if output == IdentifiedOutput::Velocity {
        text += ", velocity";
    }
    text
}

/// The options that choose the structure.
pub fn flags(structure: &Structure, output: IdentifiedOutput) -> String {
    let Structure { na, nb, nk, order, .. } = structure;
    let mut text = format!("--na {na} --nb {nb} --nk {nk}");
    match knots(structure) {
        Some(knots) => text += &format!(" --knots {}", knots.join(",")),
        None => text += &format!(" --order {order}"),
    }
    if structure.integrator {
        text += " --integrator";
    }
    if structure.drift {
        text += " --drift";
    }
    let (low, high) = structure.input.dead_band;
    if (low, high) != InputMap::PAPER.dead_band {
        text += &format!(" --dead-band {low},{high}");
    }
    if output == IdentifiedOutput::Velocity {
        text += " --velocity";
    }
    text
}

fn knots(structure: &Structure) -> Option<Vec<String>> {
    match &structure.input.basis {
        Basis::Powers => None,
        Basis::Hinges(knots) => Some(knots[..structure.order].iter().map(f64::to_string).collect()),
    }
}
