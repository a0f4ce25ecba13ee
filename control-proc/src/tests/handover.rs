//! The Smith predictor takes over from the fallback.

use pipeline::{
    machine::{Law, SmithSettings},
    message::{ControlMode, ValveCommand},
};

use super::{
    Loop, SINES, machine_with,
    models::{actuator, commission_without_dead_band},
};

/// Ticks by the fallback on a ramp: its integral has half of the command.
const BEFORE: usize = 1500;

#[test]
fn a_smith_predictor_takes_over_an_axis_that_has_changed_without_a_kick() {
    let ramp = "kind = \"ramps\"\ntimes = [0.0, 1.0, 21.0, 41.0]\npositions = [0.6, 0.6, 1.2, 0.6]\n";
    let mut machine = machine_with(SINES, ramp);
    let axis = &mut machine.axes[0];
    // Half as fast as the plant.
    commission_without_dead_band(axis, [0.03, 0.3]);
    (axis.control.kp, axis.control.ki) = (4.0, 8.0);
    axis.control.law = Law::Smith(SmithSettings { kp: 4.0, ki: 8.0, observer_time: 0.1 });
    let mut as_commissioned = actuator();
    as_commissioned.b[0] *= 0.5;

    let mut axis = Loop::new(&machine, 0.0);
    let largest =
        |commands: &[ValveCommand]| commands.iter().map(|command| command.axes[0].error.abs()).fold(0.0, f64::max);
    let before = axis.run(BEFORE, None);
    let after = axis.run(300, Some(as_commissioned));
    let by_model = after.iter().filter(|command| command.axes[0].mode == ControlMode::Model as u32).count();
    let (usual, kick) = (largest(&before[BEFORE - 200..]), largest(&after));
    assert!(usual < 0.5e-3 && by_model > 250, "{usual} m by the fallback, {by_model} ticks by the model");
    assert!(kick < 1e-3, "{kick} m, {usual} m by the fallback");
}
