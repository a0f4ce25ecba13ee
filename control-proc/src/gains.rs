//! By how much the gains of the fallback may be changed while a group runs.
//!
//! ```text
//! kp' = p kp          ki' = p ki          L' = p L
//! ```
//!
//! p the part that a request asks for, kp and ki the gains of the machine file, L the open loop of [`crate::margins`].
//! With all of p the loop on the commissioned model keeps the margins that commissioning asks for. A loop that does not
//! keep them with the gains of the machine file can only be made slower, as far as it stays stable. Nobody knows the
//! margins of an axis that was not commissioned: its gains stay as they are.
//!
//! Never called in the loop: it allocates.

use pipeline::machine::{Axis, Control, Law};

use crate::margins::{LEAST_GAIN_MARGIN, Loop, Margins, mean_slope, reduced, steepest};

/// The gains stay as they are in the machine file.
pub const FIXED: [f64; 2] = [1.0; 2];
/// Least and largest part that is allowed to any axis.
const LEAST: f64 = 0.25;
const LARGEST: f64 = 4.0;

/// Least and largest part of the gains of the fallback of `axis`; `period` in s.
pub fn range(axis: &Axis, period: f64) -> [f64; 2] {
    let Some(model) = &axis.commissioned else { return FIXED };
    let with = |part: f64| {
        let Control { kp, ki, .. } = axis.control;
        Control { kp: part * kp, ki: part * ki, law: Law::Predictive, ..axis.control }
    };
    let margins = |part: f64, slope: f64| Loop::new(&with(part), model, slope, period).margins();
    let slope = steepest(model);
    // L is in proportion to p, so its gain margin is known for all p; the delay margin is not.
    let largest = (margins(1.0, slope).gain / LEAST_GAIN_MARGIN).min(LARGEST);
    let largest = if largest > 1.0 {
        reduced(&with(largest), model, slope, period, Margins::is_kept)
            .map_or(1.0, |(part, _)| (part * largest).max(1.0))
    } else {
        1.0
    };
    let is_stable = [slope, mean_slope(model)].iter().all(|slope| margins(LEAST, *slope).is_stable());
    [if is_stable { LEAST } else { 1.0 }, largest]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::models::commissioned;

    #[test]
    fn gains_are_raised_as_far_as_the_margins_are_kept() {
        let mut axis = crate::tests::machine(1).axes[0].clone();
        assert_eq!(range(&axis, 0.01), FIXED, "without a model");
        let model = commissioned();
        axis.commissioned = Some(model.clone());
        let mut raised = 0;
        for kp in [0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0] {
            axis.control = Control { kp, ki: 0.25 * kp, ..axis.control };
            let [low, high] = range(&axis, 0.01);
            assert!((LEAST..=1.0).contains(&low) && (1.0..=LARGEST).contains(&high), "{kp}: {low} to {high}");
            let at = |part: f64| {
                let control = Control { kp: part * kp, ki: 0.25 * part * kp, law: Law::Predictive, ..axis.control };
                Loop::new(&control, &model, steepest(&model), 0.01).margins()
            };
            if high > 1.0 {
                raised += 1;
                assert!(at(high).is_kept() && at(0.5 * (1.0 + high)).is_kept(), "{kp}");
            } else {
                assert!(!at(1.06).is_kept(), "{kp} could be raised");
            }
            assert!(low == 1.0 || at(low).is_stable(), "{kp}");
        }
        assert!((1..7).contains(&raised), "{raised}");
    }
}
