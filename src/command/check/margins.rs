//! The loops that the control settings close around the commissioned models.

use control_proc::margins::{LEAST_DELAY_MARGIN, LEAST_GAIN_MARGIN, Margins, mean_slope, reduced};
use pipeline::machine::{Axis, Commissioned, Control, Law, Machine, SmithSettings};

use crate::report::margins::LoopMargins;

/// What the margins say of a machine.
pub struct Judgement {
    /// A table of all loops; empty without a commissioned axis.
    pub summary: String,
    /// Loops whose margins are smaller than what commissioning asks for.
    pub warnings: Vec<String>,
    /// Loops that are unstable at the mean slope of the curve.
    pub problems: Vec<String>,
}

/// Judges the loops of all commissioned axes.
pub fn judge(machine: &Machine) -> Judgement {
    let period = machine.timing.period.as_secs_f64();
    let mut judgement = Judgement { summary: String::new(), warnings: Vec::new(), problems: Vec::new() };
    let mut all = Vec::new();
    for axis in &machine.axes {
        let Some(model) = &axis.commissioned else { continue };
        for of in LoopMargins::of(axis, &axis.control, model, machine.timing.period) {
            if of.mean_gain_margin <= 1.0 {
                judgement.problems.push(unstable(axis, model, period, &of));
            } else if !of.is_kept {
                judgement.warnings.push(short(axis, &of));
            }
            all.push(of);
        }
    }
    if !all.is_empty() {
        judgement.summary = format!("{}\n", LoopMargins::table(&all));
    }
    judgement
}

/// The key of a loop's gain, and its value.
fn gain(axis: &Axis, of: &LoopMargins) -> (&'static str, f64) {
    match axis.control.law {
        Law::Smith(SmithSettings { kp, .. }) if of.controller == "smith" => ("smith_kp", kp),
        _ => ("kp", axis.control.kp),
    }
}

fn unstable(axis: &Axis, model: &Commissioned, period: f64, of: &LoopMargins) -> String {
    let (key, kp) = gain(axis, of);
    let law = if of.controller == "smith" { axis.control.law } else { Law::Predictive };
    let allowed = match reduced(&Control { law, ..axis.control }, model, mean_slope(model), period, Margins::is_stable)
    {
        Some((part, _)) => format!("up to {:.3} 1/m, with the integral gain in proportion", part * kp),
        None => "settings with which the loop is stable".to_owned(),
    };
    format!(
        "axis.{}.control.{key}: found {kp:.3} 1/m, with which the loop of the commissioned model is unstable at the \
         mean slope of its curve; allowed: {allowed}",
        axis.name
    )
}

fn short(axis: &Axis, of: &LoopMargins) -> String {
    let (key, kp) = gain(axis, of);
    format!(
        "axis.{}.control.{key}: found {kp:.3} 1/m, {}; asked for: at least {LEAST_GAIN_MARGIN} and {:.0} %",
        axis.name,
        of.found(),
        100.0 * LEAST_DELAY_MARGIN
    )
}
