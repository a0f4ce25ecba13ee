//! Values with which a closed loop fails as soon as it begins, though each of them is in its range.

use std::time::Duration;

use control_proc::{
    protection::motion::{NOISE_COUNTS, STALL_TIME},
    tuning::{LEAST_FIT, is_poor},
};
use pipeline::machine::{Axis, DeadBand, Drive, Machine, ModelChoice, ReferenceSource, Source};

use crate::report::table::percent;

/// Least `following_error` in counts of the encoder: noise and rounding move a position that stands by one count
/// either way, and one more is the error itself.
const ERROR_COUNTS: f64 = 3.0;
/// Part of `max_speed` below which motion may be too slow to be told from a stall by the counts of the encoder.
const SLOWEST_SEEN: f64 = 0.1;
/// Longest time for a command to cross both dead bands. The axis stands meanwhile and the reference goes on.
const LONGEST_CROSSING: Duration = Duration::from_secs(1);

/// One problem for each value with which no loop of the machine can work.
pub fn impossible(machine: &Machine) -> Vec<String> {
    if machine.drive == Drive::None {
        return Vec::new();
    }
    let checks = [coarse, tight, slow, idle];
    machine.axes.iter().flat_map(|axis| checks.into_iter().filter_map(move |check| check(axis))).collect()
}

/// One warning for each value with which a loop may fail.
pub fn doubtful(machine: &Machine) -> Vec<String> {
    let is_simulated = machine.source == Source::Sim;
    let outside = machine.axes.iter().filter(|_| is_simulated).filter_map(outside);
    poor(machine).into_iter().chain(outside).chain(unmeasured(machine)).collect()
}

/// A warning for axes that are to move the teeth and were never commissioned.
fn unmeasured(machine: &Machine) -> Option<String> {
    let of_teeth = machine.axes.iter().filter(|axis| axis.reference == ReferenceSource::Tip);
    let axes = of_teeth.filter(|axis| axis.commissioned.is_none());
    let names: Vec<String> = axes.map(|axis| format!("axis.{}", axis.name)).collect();
    (!names.is_empty()).then(|| {
        format!(
            "tip: found no commissioned model of {}. Without one an axis lags behind its part of the way, the teeth \
             stray by some tens of millimetres, and axes may be latched: `hydraxis commission` measures it",
            names.join(", ")
        )
    })
}

/// One warning for each model that explains too little of the motion.
pub fn poor(machine: &Machine) -> Vec<String> {
    let models = machine.axes.iter().filter_map(|axis| Some((&axis.name, axis.commissioned.as_ref()?)));
    let warning = |(name, fit)| {
        format!(
            "axis.{name}.commissioned.fit_percent: found {}; allowed: {LEAST_FIT} % and more. Do not control with this \
             model: `hydraxis commission` measures another one, with a longer --duration or a wider --travel",
            percent(fit)
        )
    };
    models.filter(|(_, model)| is_poor(model)).map(|(name, model)| warning((name, model.fit_percent))).collect()
}

/// An encoder that cannot tell slow motion from a stall.
fn coarse(axis: &Axis) -> Option<String> {
    let Axis { name, encoder, max_speed, .. } = axis;
    let slowest = SLOWEST_SEEN * max_speed;
    let longest = slowest * STALL_TIME / NOISE_COUNTS;
    let found = encoder.resolution;
    let key = if encoder.angle.is_some() { "angle_resolution" } else { "resolution" };
    // The length of a count of a sensor at a joint is not known where its mechanism has a problem.
    (found > longest).then(|| {
        format!(
            "axis.{name}.encoder.{key}: found counts of {found} m; allowed: up to {longest:.6} m: an axis that moves \
             is told from one that has stalled by {NOISE_COUNTS} counts, which take {STALL_TIME} s at {slowest} m/s \
             then, a tenth of max_speed",
        )
    })
}

/// A bound of the following error that the noise of the encoder reaches.
fn tight(axis: &Axis) -> Option<String> {
    let Axis { name, encoder, control, .. } = axis;
    let (found, least) = (control.following_error, ERROR_COUNTS * encoder.resolution);
    (found < least).then(|| {
        format!(
            "axis.{name}.control.following_error: found {found} m; allowed: {least:.6} m or more, {ERROR_COUNTS} \
             counts of the encoder: a smaller error cannot be told from its noise"
        )
    })
}

/// A command that is too slow to cross the dead bands.
fn slow(axis: &Axis) -> Option<String> {
    let (name, found) = (&axis.name, axis.control.command_rate);
    let measured = axis.commissioned.iter().map(|model| ("commissioned", model.dead_band));
    let all = measured.chain(axis.plant.iter().map(|plant| ("plant", plant.dead_band)));
    let widths = all.map(|(table, DeadBand { extend, retract })| (table, extend + retract));
    let (table, width) = widths.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let longest = LONGEST_CROSSING.as_secs_f64();
    (found * longest < width).then(|| {
        format!(
            "axis.{name}.control.command_rate: found {found} 1/s, with which a command needs {:.2} s to cross the dead \
             bands of [axis.{name}.{table}]; allowed: {:.4} 1/s or more, {longest} s: the axis stands meanwhile",
            width / found,
            width / longest
        )
    })
}

/// A fallback that never commands anything, where no model can control in its place.
fn idle(axis: &Axis) -> Option<String> {
    let Axis { name, control, commissioned, .. } = axis;
    let has_model = commissioned.is_some() && control.model != ModelChoice::None;
    (control.kp == 0.0 && control.ki == 0.0 && !control.feedforward && !has_model).then(|| {
        format!(
            "axis.{name}.control.kp: found 0 1/m with a ki of 0, with which the axis never moves; allowed: more than \
             0 for one of the two"
        )
    })
}

/// A simulated axis that begins where it must not be led.
fn outside(axis: &Axis) -> Option<String> {
    let Axis { name, plant, soft_limits: (low, high), .. } = axis;
    let found = plant.as_ref()?.initial_position;
    (!(*low..=*high).contains(&found)).then(|| {
        format!(
            "axis.{name}.plant.initial_position: found {found} m, outside the soft limits; allowed: {low} to {high} m: \
             from there the axis is moved inwards only"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_of_the_teeth_that_were_never_commissioned_are_named() {
        let mut machine = Machine::load(None, &[]).unwrap();
        machine.axes[2].commissioned = None;
        assert_eq!(unmeasured(&machine), None, "it does not move the teeth");
        machine.axes.iter_mut().for_each(|axis| axis.reference = ReferenceSource::Tip);
        assert!(unmeasured(&machine).is_some_and(|warning| warning.contains("model of axis.telescope. Without")));
    }
}
